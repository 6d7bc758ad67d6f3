"""Decoded video frames as code values over the full range of 16 bits, whatever layout they came in.

FFmpeg's scaler converts layouts and upsamples chroma. It does not bring white to full scale for every layout,
so that each conversion is calibrated with a black and a white frame of the same layout, range and matrix.
"""

import functools
from collections.abc import Iterator
from typing import Any

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace, Interpolation

EXACT = Interpolation.BILINEAR | Interpolation.ACCURATE_RND
HD = 720  # rows from which an undeclared matrix is taken to be BT.709's, as players do; BT.601's below
FULL = 65535
# Codecs in which an undeclared range means the limited one for grey, too, by their specifications.
LIMITED = ("av1", "h264", "hevc", "libdav1d", "vvc")
UNPACKED = {"pal8": "rgba", "monob": "gray", "monow": "gray"}  # what palettes and single bits are unpacked to
PATCH = 16  # pixels a side of the frames that calibrate


def read_codes(frame: av.VideoFrame, codec: str) -> np.ndarray:
    """Return a frame's red, green and blue, and alpha if there is one: (H, W, 3|4) uint16, white at 65535.

    `codec` is the name of the decoder, which decides what a range that is not declared means.
    """
    if frame.format.name in UNPACKED:
        frame = frame.reformat(format=UNPACKED[frame.format.name])
    name = frame.format.name
    alpha = any(component.is_alpha for component in frame.format.components)
    matrix = Colorspace(frame.colorspace) if frame.colorspace in list(Colorspace) else None
    if matrix in (None, Colorspace.DEFAULT) and not frame.format.is_rgb:
        matrix = Colorspace.ITU709 if frame.height >= HD else Colorspace.ITU601
    full = _is_full_range(frame, codec)
    codes = _convert(frame, alpha, matrix, full)
    if any(component.bits > 16 for component in frame.format.components):  # floats, which convert exactly
        return codes
    black, white = _calibration(name, alpha, matrix, full)
    if not black.any() and (white == FULL).all():
        return codes
    scaled = (codes - black) * (FULL / (white - black))
    return np.rint(scaled.clip(0, FULL)).astype(np.uint16)


def _is_full_range(frame: av.VideoFrame, codec: str) -> bool:
    """Return whether black is code 0 and white the highest code."""
    name = frame.format.name
    if frame.format.is_rgb or name.startswith("yuvj") or frame.color_range == ColorRange.JPEG:
        return True
    grey = name.startswith(("gray", "ya8", "ya16"))
    return grey and frame.color_range != ColorRange.MPEG and codec not in LIMITED


def _convert(frame: av.VideoFrame, alpha: bool, matrix: Any, full: bool) -> np.ndarray:
    """Return a frame as FFmpeg's scaler converts it: (H, W, 3|4) uint16."""
    return frame.reformat(
        format="rgba64le" if alpha else "rgb48le", interpolation=EXACT, src_colorspace=matrix,
        src_color_range=ColorRange.JPEG if full else ColorRange.MPEG, dst_color_range=ColorRange.JPEG,
    ).to_ndarray()  # fmt: skip


@functools.lru_cache(maxsize=64)
def _calibration(name: str, alpha: bool, matrix: Any, full: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return what the scaler makes of black and of white in a layout: (3|4,) float32 each.

    Alpha is 0 with black and 1 with white.
    """
    ends = []
    for white in (False, True):
        codes = _convert(_filled(name, white, full, matrix), alpha, matrix, full)
        ends.append(codes[PATCH // 2, PATCH // 2].astype(np.float32))
    return ends[0], ends[1]


def _filled(name: str, white: bool, full: bool, matrix: Any) -> av.VideoFrame:
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


def _codes(components: list, white: bool, full: bool, is_rgb: bool) -> Iterator[tuple[Any, int]]:
    """Yield each component with its code value of black or white (ITU-R BT.601, BT.709, BT.2100)."""
    for component in components:
        highest, shift = 2**component.bits - 1, max(component.bits - 8, 0)
        if component.is_alpha or is_rgb or (component.is_luma and full):
            yield component, highest if white else 0
        elif component.is_luma:
            yield component, (235 if white else 16) << shift
        else:
            yield component, 1 << (component.bits - 1)
