"""Decoded video frames as code values over the full range of 16 bits, whatever layout they came in.

FFmpeg's scaler converts layouts and upsamples chroma. It does not bring white to full scale for every layout,
so that each conversion is calibrated with a black and a white frame of the same layout, range and matrix.
"""

import functools
from collections.abc import Iterator

import av
import numpy as np
from av.sidedata.sidedata import Type
from av.video.format import VideoFormatComponent
from av.video.reformatter import ColorRange, Colorspace, Interpolation

# Matrix coefficients of ITU-T H.273, table 4, that FFmpeg's scaler undoes. 0 is RGB; 2 and 3 say nothing.
MATRICES = {
    1: Colorspace.ITU709,
    4: Colorspace.FCC,
    5: Colorspace.ITU601,
    6: Colorspace.ITU601,
    7: Colorspace.SMPTE240M,
    9: Colorspace.BT2020,
}
YCGCO = 8
UNSPECIFIED = (0, 2, 3)
UNDECODED = {
    10: "BT.2020 with constant luminance",
    11: "SMPTE ST 2085",
    12: "a matrix derived from its primaries",
    13: "a matrix derived from its primaries, with constant luminance",
    14: "ICtCp",
    15: "IPT-C2",
    16: "YCgCo-Re",
    17: "YCgCo-Ro",
}
CHROMA_RANGE = 224 / 219  # of limited chroma codes to limited luma codes
# (x', y') of a display matrix, as signs of a, b, c, d with x' = a x + c y, y' = b x + d y: Exif's orientation
ORIENTATIONS = {
    (1, 0, 0, 1): 1,
    (-1, 0, 0, 1): 2,
    (-1, 0, 0, -1): 3,
    (1, 0, 0, -1): 4,
    (0, 1, 1, 0): 5,
    (0, 1, -1, 0): 6,
    (0, -1, -1, 0): 7,
    (0, -1, 1, 0): 8,
}
SLANT = 0.02  # share of a display matrix that counts as zero: one degree
EXACT = Interpolation.BILINEAR | Interpolation.ACCURATE_RND
HD = 720  # rows from which an undeclared matrix is taken to be BT.709's, as players do; BT.601's below
FULL = 65535
# Codecs in which an undeclared range means the limited one for grey, too, by their specifications.
LIMITED = ("av1", "h264", "hevc", "libdav1d", "vvc")
UNPACKED = {"pal8": "rgba", "monob": "gray", "monow": "gray"}  # what palettes and single bits are unpacked to
PATCH = 16  # pixels a side of the frames that calibrate


def read_codes(frame: av.VideoFrame, codec: str) -> np.ndarray:
    """Return a frame's red, green and blue, and alpha if there is one: (H, W, 3|4) uint16, white at 65535.

    `codec` is the name of the decoder, which decides what a range that is not declared means. ValueError for
    matrix coefficients that are not decoded.
    """
    if frame.format.name in UNPACKED:
        frame = frame.reformat(format=UNPACKED[frame.format.name])
    name = frame.format.name
    alpha = any(component.is_alpha for component in frame.format.components)
    full = _is_full_range(frame, codec)
    if frame.colorspace == YCGCO and not frame.format.is_rgb:
        return _from_ycgco(frame, full)
    matrix = _matrix(frame)
    codes = _convert(frame, alpha, matrix, full)
    if any(component.bits > 16 for component in frame.format.components):  # floats, which convert exactly
        return codes
    black, white = _calibration(name, alpha, matrix, full)
    if not black.any() and (white == FULL).all():
        return codes
    scaled = (codes - black) * (FULL / (white - black))
    return np.rint(scaled.clip(0, FULL)).astype(np.uint16)


def _matrix(frame: av.VideoFrame) -> Colorspace:
    """Return a frame's matrix coefficients. ValueError for those that FFmpeg's scaler does not undo."""
    stated = frame.colorspace
    if frame.format.is_rgb or stated in UNSPECIFIED:
        return Colorspace.ITU709 if frame.height >= HD else Colorspace.ITU601
    if stated not in MATRICES:
        name = UNDECODED.get(stated, "of no known meaning")
        raise ValueError(
            f"has the matrix coefficients {stated} of ITU-T H.273 ({name}), which are not decoded; convert "
            "it to BT.709's or BT.2020's"
        )
    return MATRICES[stated]


def _from_ycgco(frame: av.VideoFrame, full: bool) -> np.ndarray:
    """Return red, green and blue, and alpha, of a frame in YCgCo (ITU-T H.273, section 8.3, equation 67)."""
    alpha = any(component.is_alpha for component in frame.format.components)
    black, white = (_planes(_filled(frame.format.name, code, full, Colorspace.ITU709), alpha)[:1, :1]
                    for code in (False, True))  # fmt: skip
    planes = (_planes(frame, alpha) - black) / (white[..., :1] - black[..., :1])
    luma, green, orange = (planes[..., channel] for channel in range(3))
    if not full:
        green, orange = green / CHROMA_RANGE, orange / CHROMA_RANGE
    rest = luma - green
    codes = [rest + orange, luma + green, rest - orange]
    if alpha:
        codes.append(planes[..., 3] * (white[..., 0] - black[..., 0]) / FULL)
    return np.rint(np.stack(codes, axis=-1).clip(0, 1) * FULL).astype(np.uint16)


def _planes(frame: av.VideoFrame, alpha: bool) -> np.ndarray:
    """Return a frame's luma, chroma and alpha as they are, at full size: (H, W, 3|4) float32 of 16 bits."""
    range_ = ColorRange.MPEG
    planar = frame.reformat(
        format="yuva444p16le" if alpha else "yuv444p16le", interpolation=EXACT,
        src_colorspace=Colorspace.ITU709, dst_colorspace=Colorspace.ITU709,
        src_color_range=range_, dst_color_range=range_,
    )  # fmt: skip
    rows = [
        np.frombuffer(bytes(plane), "<u2").reshape(-1, plane.line_size // 2)[: frame.height, : frame.width]
        for plane in planar.planes
    ]
    return np.stack(rows, axis=-1).astype(np.float32)


def read_orientation(frame: av.VideoFrame) -> int:
    """Return the orientation that a frame's display matrix asks for, as Exif counts them: 1 is upright.

    ValueError for a matrix that turns by another angle than quarters of a circle, or shears.
    """
    data = frame.side_data.get(Type.DISPLAYMATRIX)  # type: ignore[call-overload]
    if data is None:
        return 1
    a, b, _, c, d = (float(value) for value in np.frombuffer(data, np.int32)[:5])
    largest = max(map(abs, (a, b, c, d))) or 1.0
    signs = tuple(int(np.sign(value)) if abs(value) > SLANT * largest else 0 for value in (a, b, c, d))
    if signs not in ORIENTATIONS:
        raise ValueError(
            "has a display matrix that does not turn by quarters of a circle; turn its pictures upright"
        )
    return ORIENTATIONS[signs]


def has_mastering_metadata(frame: av.VideoFrame) -> bool:
    """Return whether a frame has the metadata of HDR10: the mastering display, or light levels."""
    return any(
        frame.side_data.get(kind) is not None  # type: ignore[call-overload]
        for kind in (Type.MASTERING_DISPLAY_METADATA, Type.CONTENT_LIGHT_LEVEL)
    )


def _is_full_range(frame: av.VideoFrame, codec: str) -> bool:
    """Return whether black is code 0 and white the highest code."""
    name = frame.format.name
    if frame.format.is_rgb or name.startswith("yuvj") or frame.color_range == ColorRange.JPEG:
        return True
    grey = name.startswith(("gray", "ya8", "ya16"))
    return grey and frame.color_range != ColorRange.MPEG and codec not in LIMITED


def _convert(frame: av.VideoFrame, alpha: bool, matrix: Colorspace, full: bool) -> np.ndarray:
    """Return a frame as FFmpeg's scaler converts it: (H, W, 3|4) uint16."""
    return frame.reformat(
        format="rgba64le" if alpha else "rgb48le", interpolation=EXACT, src_colorspace=matrix,
        src_color_range=ColorRange.JPEG if full else ColorRange.MPEG, dst_color_range=ColorRange.JPEG,
    ).to_ndarray()  # fmt: skip


@functools.lru_cache(maxsize=64)
def _calibration(name: str, alpha: bool, matrix: Colorspace, full: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return what the scaler makes of black and of white in a layout: (3|4,) float32 each.

    Alpha is 0 with black and 1 with white.
    """
    ends = []
    for white in (False, True):
        codes = _convert(_filled(name, white, full, matrix), alpha, matrix, full)
        ends.append(codes[PATCH // 2, PATCH // 2].astype(np.float32))
    return ends[0], ends[1]


def _filled(name: str, white: bool, full: bool, matrix: Colorspace) -> av.VideoFrame:
    """Return a frame of black or white in a layout."""
    frame = av.VideoFrame(PATCH, PATCH, name)
    components = list(frame.format.components)
    if frame.format.is_rgb and not frame.format.is_planar:  # code 0 and the highest code in any order
        for plane in frame.planes:
            plane.update((b"\xff" if white else b"\0") * plane.buffer_size)
        return frame
    if len({component.plane for component in components}) < len(components):  # packed: by way of planes
        range_ = ColorRange.JPEG if full else ColorRange.MPEG
        return _filled("yuva444p16le", white, full, matrix).reformat(
            format=name, interpolation=EXACT, src_colorspace=matrix, dst_colorspace=matrix,
            src_color_range=range_, dst_color_range=range_,
        )  # fmt: skip
    for component, code in _codes(components, white, full, frame.format.is_rgb):
        depth = "u1" if component.bits <= 8 else (">u2" if name.endswith("be") else "<u2")
        plane = frame.planes[component.plane]
        plane.update(np.full(plane.buffer_size // np.dtype(depth).itemsize, code, depth).tobytes())
    return frame


def _codes(
    components: list[VideoFormatComponent], white: bool, full: bool, is_rgb: bool
) -> Iterator[tuple[VideoFormatComponent, int]]:
    """Yield each component with its code value of black or white (ITU-R BT.601, BT.709, BT.2100)."""
    for component in components:
        highest, shift = 2**component.bits - 1, max(component.bits - 8, 0)
        if component.is_alpha or is_rgb or (component.is_luma and full):
            yield component, highest if white else 0
        elif component.is_luma:
            yield component, (235 if white else 16) << shift
        else:
            yield component, 1 << (component.bits - 1)
