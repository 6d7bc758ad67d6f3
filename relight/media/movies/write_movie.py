"""Writing movies through PyAV.

What we write is BT.709 throughout: primaries, transfer function and matrix, limited range. An .mp4 is H.264,
yuv420p, for looking at; a .mov is ProRes, 4444 with straight alpha or 422 HQ without, for going on.
"""

import contextlib
import functools
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.container import OutputContainer
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc
from av.video.stream import VideoStream
from numpy.typing import ArrayLike

from relight.media import colour, encodings
from relight.media.images import scene_linear
from relight.media.images.write_image import encoded
from relight.media.movies.read_movie import RATE
from relight.media.movies.tracks import SoundCopier, Tracks
from relight.media.pixel_aspect import is_square
from relight.media.video_frames import EXACT
from shadow import files
from shadow.files import AnyPath

WRITTEN = (".mov", ".mp4")
SLOWEST, FASTEST = 0.01, 1000  # frames a second
AHEAD = 4  # frames that are converted, on as many threads at most, while one is encoded
WHITE = 4.0  # light that a movie shows as white, the same at all frames: two stops above a white surface


def write_movie(
    path: AnyPath,
    frames: Iterable[ArrayLike],
    *,
    rate: float | Fraction = RATE,
    view: str | None = None,
    exposure: float = 0.0,
    white: float = WHITE,
    comment: str | None = None,
    pixel_aspect: float = 1.0,
    tracks: Tracks | None = None,
) -> None:
    """Write a movie, .mp4 or .mov. The file appears when it is complete.

    `frames`: any number of images of one size, (H, W, 3|4), linear Rec.709, premultiplied. An odd row or
    column is repeated in an .mp4, which has even sizes only. `rate`: frames a second, 0.01 to 1000; 23.976,
    29.97 and 59.94 are taken for the NTSC rates. `view`, `exposure`, `white`: how light becomes what a
    display shows; see `relight.media.colour.encode`. Without a view the movie is the same picture as a PNG,
    in BT.709's encoding. White = 1 clips, and light up to 1 comes back exact but for the movie's own
    rounding. `comment`: a text that the file carries; see `read_comment`. `pixel_aspect`: how many times as
    wide as high the frames' pixels are, which the file states. `tracks`: timecode, tags and sound of another
    movie, see `relight.media.movies.tracks`.

    The same frames give the same file, on any number of torch's threads, which convert them.

    Raises ValueError for another suffix, no frames, several sizes, alpha in an .mp4 or a rate out of range;
    OSError if the folder does not exist or the file cannot be written.
    """
    convert = functools.partial(frame_codes, path, view=view, exposure=exposure, white=white)
    write_codes(
        path, _ahead(convert, frames), rate=rate, comment=comment, pixel_aspect=pixel_aspect, tracks=tracks
    )


def write_codes(
    path: AnyPath,
    frames: Iterable[np.ndarray],
    *,
    rate: float | Fraction = RATE,
    comment: str | None = None,
    pixel_aspect: float = 1.0,
    tracks: Tracks | None = None,
) -> None:
    """Write a movie of frames that `frame_codes` has encoded; see `write_movie`, whose errors it raises."""
    path = files.check_writable(path, WRITTEN)
    rate, tracks = frame_rate(rate), tracks or Tracks()
    with files.replacing(path) as beside:
        try:
            kind = path.suffix[1:].lower()
            flags = "faststart+use_metadata_tags" if tracks.tags else "faststart"
            with (
                av.open(str(beside), "w", format=kind, options={"movflags": flags}) as file,
                contextlib.ExitStack() as closing,
            ):
                file.metadata.update(tracks.tags)
                if comment is not None:
                    file.metadata["comment"] = comment
                stream: VideoStream | None = None
                for number, codes in enumerate(frames):
                    if stream is None:
                        stream = _stream(file, path, codes.shape, rate, pixel_aspect)
                        if tracks.timecode is not None:
                            stream.metadata["timecode"] = tracks.timecode
                        sound = closing.enter_context(SoundCopier(file, path, tracks))
                    if codes.shape[:2] != (stream.height, stream.width):
                        raise ValueError(f"{path}: frame {number + 1} has another size than the first")
                    picture = _picture(codes, str(stream.pix_fmt))
                    picture.pts = number
                    file.mux(stream.encode(picture))
                    sound.copy_until((number + 1) / rate)
                if stream is None:
                    raise ValueError(f"{path}: there are no frames to write")
                file.mux(stream.encode())
        except av.error.FFmpegError as error:
            raise OSError(f"{path}: cannot be written: {error}") from error


def _ahead(function: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
    """Yield a function of each item, in order; the next few are computed in threads meanwhile."""
    import torch

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


def frame_rate(rate: float | Fraction) -> Fraction:
    """Return exact frames per second. Raises ValueError for a rate that `write_movie` does not take."""
    if not SLOWEST <= rate <= FASTEST:
        raise ValueError(f"rate: expected {SLOWEST} to {FASTEST} frames a second, got {rate}")
    whole = round(rate * 1.001)
    if isinstance(rate, float) and abs(rate - whole / 1.001) < 0.005 and rate != round(rate):
        return Fraction(whole * 1000, 1001)
    return Fraction(rate).limit_denominator(1001)


def _stream(
    file: OutputContainer, path: Path, shape: tuple[int, ...], rate: Fraction, pixel_aspect: float
) -> VideoStream:
    """Add the only stream of pictures of the movie, its colours and pixel shape declared."""
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
    if not is_square(pixel_aspect):
        context.sample_aspect_ratio = Fraction(pixel_aspect).limit_denominator(1000)
    context.color_primaries, context.color_trc = ColorPrimaries.BT709, ColorTrc.BT709
    context.colorspace, context.color_range = Colorspace.ITU709, ColorRange.MPEG
    return stream


def frame_codes(
    path: AnyPath,
    frame: ArrayLike,
    background: np.ndarray | None = None,
    *,
    view: str | None = None,
    exposure: float = 0.0,
    white: float = WHITE,
) -> np.ndarray:
    """Encode a frame as the movie `path` holds it: (H, W, 3|4) uint16, BT.709's code values, alpha straight.

    `frame`: (H, W, 3|4), linear Rec.709, premultiplied. `background`: (H, W, 3), linear, what stands behind
    it; where the frame's alpha is 0, code values that were read from a movie in BT.709 come back bit for bit,
    see `relight.media.colour.encode_over`. An .mp4 has even sizes: an odd row or column is repeated. `view`,
    `exposure`, `white`: see `write_movie`. Raises ValueError for alpha in an .mp4.
    """
    pixels, path = scene_linear("frames", frame), Path(path)
    opaque = pixels.shape[-1] == 3 or background is not None
    if path.suffix.lower() == ".mp4" and not opaque:
        if pixels[..., 3].min() < 1:
            raise ValueError(f"{path}: .mp4 holds no alpha; give a background, or write a .mov")
        pixels = pixels[..., :3]
    display: dict[str, Any] = {"view": view, "exposure": exposure, "white": white}
    if view is None:
        codes = encoded(pixels, background, transfer=encodings.encode_bt709, **display)
    else:
        codes = encoded(pixels, background, **display)
        if "srgb" in colour.find_view(view)[1].lower():
            codes[..., :3] = _srgb_to_bt709()[np.rint(codes[..., :3] * 65535).astype(np.uint16)]
    if path.suffix.lower() == ".mp4":
        codes = np.pad(codes, ((0, codes.shape[0] % 2), (0, codes.shape[1] % 2), (0, 0)), mode="edge")
    return np.rint(codes * 65535).astype(np.uint16)


@functools.cache
def _srgb_to_bt709() -> np.ndarray:
    """BT.709's code, float32, of each of sRGB's 65536: the same light on the display."""
    light = encodings.decode_srgb(np.arange(65536) / 65535)
    return encodings.encode_bt709(light).astype(np.float32)


def _picture(codes: np.ndarray, layout: str) -> av.VideoFrame:
    """Return a frame in the layout of the encoder, with its colours declared."""
    given = av.VideoFrame.from_ndarray(codes, format="rgba64le" if codes.shape[-1] == 4 else "rgb48le")
    return given.reformat(
        format=layout, interpolation=EXACT,
        src_color_range=ColorRange.JPEG, dst_color_range=ColorRange.MPEG,
        dst_colorspace=Colorspace.ITU709, dst_color_trc=ColorTrc.BT709,
        dst_color_primaries=ColorPrimaries.BT709,
    )  # fmt: skip
