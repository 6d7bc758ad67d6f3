"""Writing movies through PyAV.

What we write is BT.709 throughout, or HLG or PQ in BT.2020 where that is asked for: primaries, transfer
function and matrix, limited range. An .mp4 is H.264, yuv420p, for looking at; a .mov is ProRes, 4444 with
straight alpha or 422 HQ without, for going on. Other codecs are in `relight.media.movies.forms`.
"""

import contextlib
import functools
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import TypeVar, cast

import av
import numpy as np
from av.container import OutputContainer
from av.video.reformatter import ColorRange
from av.video.stream import VideoStream
from numpy.typing import ArrayLike

from relight.media import colour, encodings
from relight.media.colour import Display
from relight.media.images import scene_linear
from relight.media.images.write_image import composited, encoded
from relight.media.movies.forms import BY_SUFFIX, ENCODERS, Colours, Form
from relight.media.movies.read_movie import RATE
from relight.media.movies.tracks import SoundCopier, Tracks
from relight.media.pixel_aspect import is_square
from relight.media.video_frames import EXACT
from shadow import files
from shadow.files import AnyPath

WRITTEN = (".mov", ".mp4")
SLOWEST, FASTEST = 0.01, 1000  # frames a second
SCALER_WHITE = 65280 / 65535  # FFmpeg's scaler takes 255 * 256 of 16 bits for the white of limited range
Item = TypeVar("Item")
Result = TypeVar("Result")
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
    form: Form = BY_SUFFIX,
) -> None:
    """Write a movie, .mp4 or .mov. The file appears when it is complete.

    `frames`: any number of images of one size, (H, W, 3|4), linear Rec.709, premultiplied. An odd row or
    column is repeated in an .mp4, which has even sizes only. `rate`: frames a second, 0.01 to 1000; 23.976,
    29.97 and 59.94 are taken for the NTSC rates. `view`, `exposure`, `white`: how light becomes what a
    display shows; see `relight.media.colour.encode`. Without a view the movie is the same picture as a PNG,
    in BT.709's encoding. White = 1 clips, and light up to 1 comes back exact but for the movie's own
    rounding. `comment`: a text that the file carries; see `read_comment`. `pixel_aspect`: how many times as
    wide as high the frames' pixels are, which the file states. `tracks`: timecode, tags and sound of another
    movie, see `relight.media.movies.tracks`. `form`: codec and colours.

    The same frames give the same file, on any number of torch's threads, which convert them. Only
    those of HEVC may differ in some bits.

    Raises ValueError for another suffix, no frames, several sizes, alpha in an .mp4 or a rate out of range;
    OSError if the folder does not exist or the file cannot be written.
    """
    convert = functools.partial(frame_codes, path, view=view, exposure=exposure, white=white, form=form)
    write_codes(
        path,
        _ahead(convert, frames),
        rate=rate,
        comment=comment,
        pixel_aspect=pixel_aspect,
        tracks=tracks,
        form=form,
    )


def write_codes(
    path: AnyPath,
    frames: Iterable[np.ndarray],
    *,
    rate: float | Fraction = RATE,
    comment: str | None = None,
    pixel_aspect: float = 1.0,
    tracks: Tracks | None = None,
    form: Form = BY_SUFFIX,
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
                        form.check_size(path, codes.shape)
                        stream = _stream(file, path, codes.shape, rate, pixel_aspect, form)
                        if tracks.timecode is not None:
                            stream.metadata["timecode"] = tracks.timecode
                        sound = closing.enter_context(SoundCopier(file, path, tracks))
                    if codes.shape[:2] != (stream.height, stream.width):
                        raise ValueError(f"{path}: frame {number + 1} has another size than the first")
                    picture = _picture(codes, str(stream.pix_fmt), form.colours)
                    picture.pts = number
                    file.mux(stream.encode(picture))
                    sound.copy_until((number + 1) / rate)
                if stream is None:
                    raise ValueError(f"{path}: there are no frames to write")
                file.mux(stream.encode())
        except av.error.FFmpegError as error:
            raise OSError(f"{path}: cannot be written: {error}") from error


def _ahead(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
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
    file: OutputContainer,
    path: Path,
    shape: tuple[int, ...],
    rate: Fraction,
    pixel_aspect: float,
    form: Form,
) -> VideoStream:
    """Add the only stream of pictures of the movie, its colours and pixel shape declared."""
    encoder = ENCODERS[form.codec_of(path)]
    layout, options = encoder.layout, encoder.options
    if shape[2] == 4 and encoder.with_alpha is not None:
        layout, options = encoder.with_alpha
    stream = cast(VideoStream, file.add_stream(encoder.name, rate, options=dict(options)))
    stream.pix_fmt = layout
    if encoder.tag is not None:
        stream.codec_context.codec_tag = encoder.tag
    stream.height, stream.width = shape[:2]
    context = stream.codec_context
    if not is_square(pixel_aspect):
        context.sample_aspect_ratio = Fraction(pixel_aspect).limit_denominator(1000)
    colours = form.colours
    context.color_primaries, context.color_trc = colours.primaries, colours.transfer
    context.colorspace, context.color_range = colours.matrix, ColorRange.MPEG
    return stream


def frame_codes(
    path: AnyPath,
    frame: ArrayLike,
    background: np.ndarray | None = None,
    *,
    view: str | None = None,
    exposure: float = 0.0,
    white: float | None = WHITE,
    form: Form = BY_SUFFIX,
) -> np.ndarray:
    """Encode a frame as the movie `path` holds it: (H, W, 3|4) uint16, BT.709's code values, alpha straight.

    `frame`: (H, W, 3|4), linear Rec.709, premultiplied. `background`: (H, W, 3), linear, what stands behind
    it; where the frame's alpha is 0, code values that were read from a movie in BT.709 come back bit for bit,
    see `relight.media.colour.encode_over`. An .mp4 has even sizes: an odd row or column is repeated. `view`,
    `exposure`, `white`, `form`: see `write_movie`; light in HLG or PQ is not compressed. Raises ValueError
    for alpha where the form holds none, and for a view of HDR.
    """
    pixels, path = scene_linear("frames", frame), Path(path)
    opaque = pixels.shape[-1] == 3 or background is not None
    if not opaque and not form.holds_alpha(path):
        if pixels[..., 3].min() < 1:
            kind = path.suffix if form.codec is None else form.codec
            raise ValueError(f"{path}: {kind} holds no alpha; give a background, or write a .mov")
        pixels = pixels[..., :3]
    display: Display = {"view": view, "exposure": exposure, "white": white}
    if form.hdr is not None:
        codes = _hdr_codes(pixels, background, view, exposure, form)
    elif view is None:
        codes = encoded(pixels, background, transfer=encodings.encode_bt709, **display)
    else:
        codes = encoded(pixels, background, **display)
        if "srgb" in colour.find_view(view)[1].lower():
            codes[..., :3] = _srgb_to_bt709()[np.rint(codes[..., :3] * 65535).astype(np.uint16)]
    if path.suffix.lower() == ".mp4":
        codes = np.pad(codes, ((0, codes.shape[0] % 2), (0, codes.shape[1] % 2), (0, 0)), mode="edge")
    return np.rint(codes * 65535).astype(np.uint16)


def _hdr_codes(
    pixels: np.ndarray, background: np.ndarray | None, view: str | None, exposure: float, form: Form
) -> np.ndarray:
    """Return code values (H, W, 3|4) of HLG or PQ in BT.2020, alpha straight."""
    if view is not None:
        raise ValueError(f"view: expected none with hdr, whose light no view shapes, got {view!r}")
    if background is not None:
        pixels = composited(pixels, background)
    rgb, alpha = pixels[..., :3], pixels[..., 3:]
    if alpha.shape[-1]:
        rgb = np.divide(rgb, alpha, out=np.zeros_like(rgb), where=alpha > 0)
    to_rec2020 = np.linalg.inv(encodings.to_rec709(encodings.REC2020).astype(np.float64))
    codes = form.colours.encode((rgb * 2.0**exposure) @ to_rec2020.T)
    return np.concatenate([codes, alpha], axis=-1).astype(np.float32)


@functools.cache
def _srgb_to_bt709() -> np.ndarray:
    """BT.709's code, float32, of each of sRGB's 65536: the same light on the display."""
    light = encodings.decode_srgb(np.arange(65536) / 65535)
    return encodings.encode_bt709(light).astype(np.float32)


def _picture(codes: np.ndarray, layout: str, colours: Colours) -> av.VideoFrame:
    """Return a frame in the layout of the encoder, with its colours declared."""
    codes = codes.copy()
    codes[..., :3] = np.rint(codes[..., :3] * SCALER_WHITE)
    given = av.VideoFrame.from_ndarray(codes, format="rgba64le" if codes.shape[-1] == 4 else "rgb48le")
    # The codes mean already what they are to mean: without this, the scaler would convert them.
    given.color_trc, given.color_primaries = colours.transfer, colours.primaries
    return given.reformat(
        format=layout, interpolation=EXACT,
        src_color_range=ColorRange.JPEG, dst_color_range=ColorRange.MPEG,
        dst_colorspace=colours.matrix, dst_color_trc=colours.transfer, dst_color_primaries=colours.primaries,
    )  # fmt: skip
