"""Movies in and out through PyAV, their colours declared as ITU-T H.273 numbers them.

What we write is BT.709 throughout: primaries, transfer function and matrix, limited range. An .mp4 is H.264,
yuv420p, for looking at; a .mov is ProRes, 4444 with straight alpha or 422 HQ without, for going on.
"""

import functools
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import torch
from av.container import InputContainer, OutputContainer
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc, Interpolation
from av.video.stream import VideoStream
from numpy.typing import ArrayLike

from relight.media import colour as colours
from relight.media.colour import colour
from relight.media.identity import identity
from relight.media.images import scene_linear
from shadow import files
from shadow.files import AnyPath

WRITTEN = (".mov", ".mp4")
READ = (*WRITTEN, ".avi", ".m4v", ".mkv", ".mxf", ".webm")
EXACT = Interpolation.BILINEAR | Interpolation.ACCURATE_RND
SLOWEST, FASTEST = 0.01, 1000  # frames a second
HD = 720  # rows from which an undeclared matrix is taken to be BT.709's, as players do; BT.601's below
AHEAD = 4  # frames that are converted, on as many threads at most, while one is encoded
WHITE = 4.0  # light that a movie shows as white, the same at all frames: two stops above a white surface
PRIMARIES: dict[int, str] = {  # H.273 code to linear colour space of colour-science; BT.709 if undeclared
    ColorPrimaries.BT709: "ITU-R BT.709",
    ColorPrimaries.UNSPECIFIED: "ITU-R BT.709",
    ColorPrimaries.BT470BG: "ITU-R BT.470 - 625",
    ColorPrimaries.SMPTE170M: "SMPTE C",
    ColorPrimaries.SMPTE240M: "SMPTE C",
    ColorPrimaries.BT2020: "ITU-R BT.2020",
    ColorPrimaries.SMPTE431: "DCI-P3",
    ColorPrimaries.SMPTE432: "Display P3",
}
TRANSFERS: dict[
    int, Callable[[np.ndarray], Any]
] = {  # H.273 code to the function from code values to light; BT.709's if undeclared
    ColorTrc.BT709: colour.models.oetf_inverse_BT709,
    ColorTrc.UNSPECIFIED: colour.models.oetf_inverse_BT709,
    ColorTrc.SMPTE170M: colour.models.oetf_inverse_BT709,
    ColorTrc.BT2020_10: colour.models.oetf_inverse_BT709,
    ColorTrc.BT2020_12: colour.models.oetf_inverse_BT709,
    ColorTrc.GAMMA22: lambda code: code**2.2,
    ColorTrc.GAMMA28: lambda code: code**2.8,
    ColorTrc.LINEAR: lambda code: code,
    ColorTrc.IEC61966_2_1: colour.models.eotf_sRGB,
}


def is_movie(path: AnyPath) -> bool:
    """Whether a file's name is a movie's."""
    return Path(path).suffix.lower() in READ


class Movie:
    """A movie, frame by frame. Frames are numbered from 1, in the order they are shown.

    Reading in order decodes each frame once; going back starts over.

    Parameters
    ----------
    path: a file that FFmpeg reads.
    colour_space: of its red, green and blue, where it does not declare it, or declares what is wrong.

    Raises
    ------
    FileNotFoundError: no such file. ValueError: no movie.
    """

    def __init__(self, path: AnyPath, *, colour_space: str | None = None) -> None:
        self.path = Path(path)
        self.colour_space = colour_space
        if not self.path.exists():
            raise FileNotFoundError(f"{path}: no such file")
        try:
            with _opened(path) as container:
                stream = container.streams.video[0]
                if stream.codec_context is None:
                    raise ValueError(f"{path}: is in a codec that FFmpeg does not decode")
                self.rate = stream.average_rate
                shown = {packet.pts for packet in container.demux(stream) if not packet.is_discard}
        except (av.error.FFmpegError, IndexError) as error:
            raise ValueError(f"{path}: cannot be read as a movie: {error}") from error
        times = sorted(time for time in shown if time is not None)
        self._order = {time: number for number, time in enumerate(times, 1)}
        if not self._order:
            raise ValueError(f"{path}: is damaged or truncated: it has no frames")
        self._frames: Iterator[tuple[int, av.VideoFrame]] = iter(())
        self._frame: av.VideoFrame | None = None
        self._number = len(self._order) + 1  # of the frame that is decoded: beyond the last, so start over

    @property
    def numbers(self) -> range:
        """The frames there are."""
        return range(1, len(self._order) + 1)

    def read(self, number: int) -> np.ndarray:
        """A frame: (H, W, 3|4) float32, linear Rec.709, premultiplied, upright.

        ValueError: there is no such frame, it is damaged, or its transfer function or primaries are none of
        those we know (HDR, for one).
        """
        if number not in self.numbers:
            raise ValueError(f"{self.path}: expected a frame of 1 to {len(self._order)}, got {number}")
        if self._number > number:
            self._frames, self._number = self._decoded(), 0
        while self._number < number:
            self._number, self._frame = next(self._frames, (len(self._order) + 1, None))
        if self._number > number or self._frame is None or self._frame.is_corrupt:
            raise ValueError(f"{self.path}: frame {number} is damaged")
        try:
            return _linear(self._frame, self.colour_space)
        except ValueError as error:
            raise ValueError(f"{self.path}: {error}") from error

    def file(self, number: int) -> Path | None:
        """Where a frame is read."""
        return self.path

    def identity(self, number: int) -> str:
        """Differs where the movie's file or the frame does."""
        return identity(self.path, number)

    def _decoded(self) -> Iterator[tuple[int, av.VideoFrame]]:
        """Numbers and frames, as far as they can be decoded.

        An AVI has no times of presentation. Where its frames are not stored in the order they are shown, as
        B-frames are not, they are counted as they are decoded, which ends at the first that is damaged.
        """
        with _opened(self.path, err_detect="explode") as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            counted = container.format.name == "avi" and stream.codec_context.has_b_frames
            count = 0
            for packet in container.demux(stream):
                try:
                    frames = packet.decode()
                except av.error.FFmpegError:
                    if counted:
                        return
                    continue  # its frame's number is missed and reported when it is asked for
                for frame in frames:
                    count += 1
                    if counted:
                        yield count, frame
                    elif frame.pts in self._order:
                        yield self._order[frame.pts], frame


def write_movie(
    path: AnyPath,
    frames: Iterable[ArrayLike],
    *,
    rate: float | Fraction = 24,
    view: str | None = None,
    exposure: float = 0.0,
    white: float = WHITE,
    comment: str | None = None,
) -> None:
    """Write a movie. The file appears when it is complete.

    Parameters
    ----------
    path: .mp4 or .mov. Its folder must exist.
    frames: any number of images of one size, (H, W, 3|4), linear Rec.709, premultiplied. An odd row or column
        is repeated in an .mp4, which has even sizes only.
    rate: frames a second, 0.01 to 1000; 23.976, 29.97 and 59.94 are taken for the NTSC rates.
    view, exposure, white: how light becomes what a display shows; see `relight.media.colour.encode`. Without
        a view the movie is the same picture as a PNG, in BT.709's encoding. White = 1 clips, and light up to
        1 comes back exact but for the movie's own rounding.
    comment: a text that the file carries; see `read_comment`.

    The same frames give the same file, on any number of torch's threads, which convert them.

    Raises
    ------
    ValueError: another suffix, no frames, several sizes, alpha in an .mp4, a rate out of range.
    OSError: the folder does not exist or the file cannot be written.
    """
    path = check_writable(path)
    rate = frame_rate(rate)
    with files.replacing(path) as beside:
        try:
            kind = path.suffix[1:].lower()
            with av.open(str(beside), "w", format=kind, options={"movflags": "faststart"}) as file:
                if comment is not None:
                    file.metadata["comment"] = comment
                stream = None
                convert = functools.partial(_codes, path, view=view, exposure=exposure, white=white)
                for number, codes in enumerate(_ahead(convert, frames)):
                    stream = stream or _stream(file, path, codes.shape, rate)
                    if codes.shape[:2] != (stream.height, stream.width):
                        raise ValueError(f"{path}: frame {number + 1} has another size than the first")
                    picture = _picture(codes, str(stream.pix_fmt))
                    picture.pts = number
                    file.mux(stream.encode(picture))
                if stream is None:
                    raise ValueError(f"{path}: there are no frames to write")
                file.mux(stream.encode())
        except av.error.FFmpegError as error:
            raise OSError(f"{path}: cannot be written: {error}") from error


def _ahead(function: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
    """A function of each item, in order; the next few are worked on while one is used."""
    threads = min(AHEAD, torch.get_num_threads())
    if threads == 1:
        yield from map(function, items)
        return
    with ThreadPoolExecutor(threads) as pool:
        coming: deque = deque()
        for item in items:
            coming.append(pool.submit(function, item))
            if len(coming) == AHEAD:
                yield coming.popleft().result()
        while coming:
            yield coming.popleft().result()


def read_comment(path: AnyPath) -> str | None:
    """The comment that a movie carries; None where there is none, or no movie."""
    try:
        with _opened(path) as file:
            return file.metadata.get("comment")
    except (OSError, av.error.FFmpegError):
        return None


def _opened(path: AnyPath, **options: str) -> InputContainer:
    """A movie to read. Its tags, which nobody needs, may be in any encoding, as those of an old AVI are."""
    return av.open(str(path), options=options, metadata_errors="replace")


def check_writable(path: AnyPath) -> Path:
    """`path` as a Path; raises as `write_movie` does if a movie cannot be written there."""
    return files.check_writable(path, WRITTEN)


def frame_rate(rate: float | Fraction) -> Fraction:
    """Frames a second, exactly. ValueError for a rate that `write_movie` does not take."""
    if not SLOWEST <= rate <= FASTEST:
        raise ValueError(f"rate: expected {SLOWEST} to {FASTEST} frames a second, got {rate}")
    whole = round(rate * 1.001)
    if isinstance(rate, float) and abs(rate - whole / 1.001) < 0.005 and rate != round(rate):
        return Fraction(whole * 1000, 1001)
    return Fraction(rate).limit_denominator(1001)


def _stream(file: OutputContainer, path: Path, shape: tuple[int, ...], rate: Fraction) -> VideoStream:
    """The movie's one stream, its colours declared."""
    if path.suffix.lower() == ".mp4":
        # The same frames give the same file, on any machine: one number of threads, and no macroblock tree,
        # whose AVX-512 routines read memory that nobody has written.
        options = {"crf": "16", "preset": "medium", "threads": "4", "mbtree": "0"}
        stream = file.add_stream("libx264", rate, options=options)
        stream.pix_fmt = "yuv420p"
    else:
        alpha = shape[2] == 4
        options = {"profile": "4" if alpha else "3", "vendor": "apl0"}
        stream = file.add_stream("prores_ks", rate, options=options)
        stream.pix_fmt = "yuva444p10le" if alpha else "yuv422p10le"
    stream.height, stream.width = shape[:2]
    context = stream.codec_context
    context.color_primaries, context.color_trc = ColorPrimaries.BT709, ColorTrc.BT709
    context.colorspace, context.color_range = Colorspace.ITU709, ColorRange.MPEG
    return stream


def _codes(path: Path, frame: ArrayLike, view: str | None, exposure: float, white: float) -> np.ndarray:
    """Linear premultiplied light to BT.709's code values, straight, over the full range of uint16."""
    pixels = scene_linear("frames", frame)
    if path.suffix.lower() == ".mp4":
        if pixels.shape[-1] == 4 and pixels[..., 3].min() < 1:
            raise ValueError(f"{path}: .mp4 holds no alpha; give a background, or write a .mov")
        height, width = pixels.shape[:2]
        pixels = np.pad(pixels[..., :3], ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    rgb, alpha = pixels[..., :3], pixels[..., 3:]
    if alpha.size:
        rgb = np.divide(rgb, alpha, out=np.zeros_like(rgb), where=alpha > 0)
    codes = colours.encode(rgb, view=view, exposure=exposure, white=white)
    if view is None or "srgb" in colours.find_view(view)[1].lower():
        codes = _srgb_to_bt709()[np.rint(codes * 65535).astype(np.uint16)]
    return np.rint(np.concatenate([codes, alpha], axis=-1) * 65535).astype(np.uint16)


@functools.cache
def _srgb_to_bt709() -> np.ndarray:
    """BT.709's code, float32, of each of sRGB's 65536: the same light on the display."""
    light = colour.models.eotf_sRGB(np.arange(65536) / 65535)
    return colour.models.oetf_BT709(light).astype(np.float32)


def _picture(codes: np.ndarray, layout: str) -> av.VideoFrame:
    """A frame in the encoder's layout, its colours declared."""
    given = av.VideoFrame.from_ndarray(codes, format="rgba64le" if codes.shape[-1] == 4 else "rgb48le")
    return given.reformat(
        format=layout, interpolation=EXACT,
        src_color_range=ColorRange.JPEG, dst_color_range=ColorRange.MPEG,
        dst_colorspace=Colorspace.ITU709, dst_color_trc=ColorTrc.BT709,
        dst_color_primaries=ColorPrimaries.BT709,
    )  # fmt: skip


def _linear(frame: av.VideoFrame, colour_space: str | None) -> np.ndarray:
    """A decoded frame to (H, W, 3|4) linear Rec.709, premultiplied."""
    alpha = any(component.is_alpha for component in frame.format.components)
    matrix = Colorspace(frame.colorspace) if frame.colorspace in list(Colorspace) else None
    if matrix is None and not frame.format.is_rgb:
        matrix = Colorspace.ITU709 if frame.height >= HD else Colorspace.ITU601
    full = frame.color_range == ColorRange.JPEG or frame.format.is_rgb or frame.format.name.startswith("yuvj")
    codes = frame.reformat(
        format="rgba64le" if alpha else "rgb48le", interpolation=EXACT, src_colorspace=matrix,
        src_color_range=ColorRange.JPEG if full else ColorRange.MPEG, dst_color_range=ColorRange.JPEG,
    ).to_ndarray()  # fmt: skip
    codes = np.rot90(codes, round(frame.rotation / 90))
    if colour_space is not None:
        rgb = colours.decode(codes[..., :3], colour_space)
    else:
        rgb = _light(frame.color_trc)[codes[..., :3]] @ _to_rec709(frame.color_primaries)
    if not alpha:
        return np.ascontiguousarray(rgb)
    coverage = codes[..., 3:] / np.float32(65535)
    return np.concatenate([rgb * coverage, coverage], axis=-1)


@functools.cache
def _light(transfer: int) -> np.ndarray:
    """The light, float32, of each of 65536 codes."""
    if transfer not in TRANSFERS:
        name = ColorTrc(transfer).name if transfer in list(ColorTrc) else transfer
        raise ValueError(f"has the transfer function {name}; convert it to BT.709's first")
    return TRANSFERS[transfer](np.arange(65536) / 65535).astype(np.float32)


@functools.cache
def _to_rec709(primaries: int) -> np.ndarray:
    """(3, 3) float32, for row vectors."""
    if primaries not in PRIMARIES:
        name = ColorPrimaries(primaries).name if primaries in list(ColorPrimaries) else primaries
        raise ValueError(f"has the primaries {name}; convert it to BT.709's first")
    if PRIMARIES[primaries] == "ITU-R BT.709":
        return np.eye(3, dtype=np.float32)
    return colour.matrix_RGB_to_RGB(PRIMARIES[primaries], "ITU-R BT.709", "Bradford").T.astype(np.float32)
