"""Reading movies through PyAV, as they say: alpha, colour, fields and the shape of pixels."""

import itertools
import warnings
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.container import InputContainer

from relight.media.content_hash import FileRecord, content_hash, hash_file
from relight.media.encodings import Encoding, decode_bt709
from relight.media.images.edge import linearise
from relight.media.matte import matte_of
from relight.media.pixel_aspect import SQUARED, is_square, square_pixels
from relight.media.video_frames import read_codes
from shadow.files import AnyPath

RATE = 24  # frames a second, where nothing states another
READ = (
    *(".3gp", ".avi", ".m2ts", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".mts", ".mxf", ".ts"),
    *(".webm", ".wmv"),
)
# FFmpeg's own decoders of VP8 and VP9 leave alpha out; libvpx's do not.
ALPHA_DECODERS = {"vp8": "libvpx", "vp9": "libvpx-vp9", "libvpx": "libvpx", "libvpx-vp9": "libvpx-vp9"}
TOP_FIRST, BOTTOM_FIRST = (2, 5), (3, 4)  # of FFmpeg's AVFieldOrder, by the field that is shown first
# Codecs whose frames say themselves whether they are interlaced, each for itself.
CODECS_STATING_FIELDS = ("dnxhd", "dvvideo", "h264", "hevc", "mpeg2video", "mpeg4", "prores", "vc1")
ADAM7 = ("apng", "png")  # what FFmpeg calls interlaced in their frames is the order of pixels in the file
OPAQUE = 0.99  # least alpha of a movie that counts as opaque: compression takes a code or two away
GREY = 0.1  # most that red, green and blue of a compressed grey picture differ


def is_movie(path: AnyPath) -> bool:
    """Return whether a file's name is a movie's."""
    return Path(path).suffix.lower() in READ


class Movie:
    """A movie, frame by frame. Frames are numbered from 1, in the order they are shown.

    Reading in order decodes each frame once; going back starts over. Interlaced frames are deinterlaced, one
    frame for each, and pixels that are not square are made so.

    Parameters
    ----------
    path
        A file that FFmpeg reads.
    colour_space
        Of its red, green and blue, where it does not declare it, or declares what is wrong.
    alpha
        "straight" or "premultiplied"; movies are straight unless it is said.

    Raises
    ------
    FileNotFoundError
        No such file.
    ValueError
        No movie, or alpha that this FFmpeg does not decode.
    """

    record: FileRecord | None = None  # of the file as it was opened, where that is asked for

    def __init__(self, path: AnyPath, *, colour_space: str | None = None, alpha: str | None = None) -> None:
        self.path, self._straight = Path(path), alpha != "premultiplied"
        self.colour_space = colour_space
        if not self.path.exists():
            raise FileNotFoundError(f"{path}: no such file")
        try:
            with opened(path) as container:
                stream = container.streams.video[0]
                if stream.codec_context is None:
                    raise ValueError(f"{path}: is in a codec that FFmpeg does not decode")
                self.rate = stream.average_rate
                self.pixel_aspect = float(_pixel_aspect(stream))
                self._codec = _decoder_name(self.path, stream)
                shown = {packet.pts for packet in container.demux(stream) if not packet.is_discard}
                time_base = stream.time_base or Fraction(1)
        except (av.error.FFmpegError, IndexError) as error:
            raise ValueError(f"{path}: cannot be read as a movie: {error}") from error
        times = sorted(time for time in shown if time is not None)
        self._order = {time: number for number, time in enumerate(times, 1)}
        self._times = [time * time_base for time in times]  # seconds
        if not self._order:
            raise ValueError(f"{path}: is damaged or truncated: it has no frames")
        self._frames: Iterator[tuple[int, av.VideoFrame]] = iter(())
        self._frame: av.VideoFrame | None = None
        self._number = len(self._order) + 1  # of the frame that is decoded: beyond the last, so start over
        if not is_square(self.pixel_aspect):
            warnings.warn(
                f"{path}: its pixels are {self.pixel_aspect:.4g} times as wide as high; {SQUARED}",
                stacklevel=2,
            )

    @property
    def numbers(self) -> range:
        """The frames there are."""
        return range(1, len(self._order) + 1)

    def read(self, number: int) -> np.ndarray:
        """Read a frame: (H, W, 3|4) float32, linear Rec.709, premultiplied, upright, of square pixels.

        ValueError: there is no such frame, it is damaged, or its transfer function or primaries are unknown.
        """
        codes = self._codes(number)
        try:
            space = self.colour_space or self._encoding()
            light = linearise(codes, straight=self._straight, space=space)
        except ValueError as error:
            raise ValueError(f"{self.path}: {error}") from error
        return self._upright(light)

    def file(self, number: int) -> Path | None:
        """Return where a frame is read."""
        return self.path

    def content_hash(self, number: int, sha256: str | None = None) -> str:
        """Return a hash that differs where the movie's file or the frame does.

        `sha256`: of the file as it was read; unless given, as it is now.
        """
        return content_hash(hash_file(self.path) if sha256 is None else sha256, number)

    def upright_aspect(self) -> float:
        """Return how many times as wide as high the pixels are once a frame stands upright.

        ValueError where the first frame is damaged.
        """
        if is_square(self.pixel_aspect):
            return 1.0
        self._codes(self.numbers[0])
        assert self._frame is not None
        sideways = round(self._frame.rotation / 90) % 2
        return 1 / self.pixel_aspect if sideways else self.pixel_aspect

    def span(self, first: int, last: int) -> tuple[Fraction, Fraction]:
        """Return the times at which frame `first` begins and `last` ends, in seconds."""
        return self._times[first - 1], self._times[last - 1] + 1 / Fraction(self.rate or RATE)

    def _codes(self, number: int) -> np.ndarray:
        """Return a frame's code values as they are stored: (H, W, 3|4) uint16 over their full range."""
        if number not in self.numbers:
            raise ValueError(f"{self.path}: expected a frame of 1 to {len(self._order)}, got {number}")
        if self._number > number:
            self._frames, self._number = self._decoded(), 0
        try:
            while self._number < number:
                self._number, self._frame = next(self._frames, (len(self._order) + 1, None))
        except av.error.FFmpegError:  # of the filter that takes fields apart, where sizes change on the way
            self._number, self._frame = len(self._order) + 1, None
        if self._number > number or self._frame is None or self._frame.is_corrupt:
            raise ValueError(f"{self.path}: frame {number} is damaged")
        return read_codes(self._frame, self._codec)

    def _encoding(self) -> Encoding:
        """Return what the frame says of its colour, BT.709 where it says nothing."""
        frame = self._frame
        assert frame is not None
        return Encoding.from_code_points(
            int(frame.color_primaries), int(frame.color_trc), unspecified=decode_bt709
        )

    def _upright(self, pixels: np.ndarray) -> np.ndarray:
        """Return pixels (H, W, C) as they are to be looked at: square, and turned as the container asks."""
        assert self._frame is not None
        turned = np.rot90(square_pixels(pixels, self.pixel_aspect), round(self._frame.rotation / 90))
        return np.ascontiguousarray(turned)

    def _decoded(self) -> Iterator[tuple[int, av.VideoFrame]]:
        """Yield numbers and frames, as far as they can be decoded.

        An AVI has no times of presentation. Where its frames are not stored in the order they are shown, as
        B-frames are not, they are counted as they are decoded, which ends at the first that is damaged.
        """
        with opened(self.path, err_detect="explode") as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            counted = container.format.name == "avi" and stream.codec_context.has_b_frames
            frames = _decode(container, stream, self._codec, stop=counted)
            for count, frame in enumerate(_deinterlaced(frames, stream), 1):
                if counted:
                    yield count, frame
                elif frame.pts in self._order:
                    yield self._order[frame.pts], frame


class MatteMovie(Movie):
    """A movie of mattes, read as `relight.read_mask` reads stills: alpha unless it is opaque, else grey."""

    def __init__(self, path: AnyPath, *, colour_space: str | None = None) -> None:
        super().__init__(path)
        self._transparent: bool | None = None

    def read(self, number: int) -> np.ndarray:
        """Read a matte: (H, W) float32 in [0, 1], as it is stored.

        Raises as `Movie.read` does, and ValueError for a picture that is neither transparent nor grey.
        """
        if self._transparent is None:
            first = self._codes(self.numbers[0])
            self._transparent = first.shape[-1] == 4 and bool(first[..., 3].min() < OPAQUE * 65535)
        codes = self._codes(number) / np.float32(65535)
        alpha = codes[..., 3] if codes.shape[-1] == 4 else None
        opaque = np.inf if self._transparent else OPAQUE
        matte = matte_of(codes[..., :3], alpha, opaque=opaque, grey=GREY)
        if matte is None:
            raise ValueError(
                f"{self.path}: expected mattes (grey, or with transparency), got opaque colour in frame "
                f"{number}"
            )
        return self._upright(matte[..., None])[..., 0]


def read_comment(path: AnyPath) -> str | None:
    """Read the comment that a movie carries; None where there is none, or no movie."""
    try:
        with opened(path) as file:
            return file.metadata.get("comment")
    except (OSError, av.error.FFmpegError):
        return None


def opened(path: AnyPath, **options: str) -> InputContainer:
    """Open a movie to read. Its tags may be in any encoding, as those of an old AVI are."""
    return av.open(str(path), options=options, metadata_errors="replace")


def _pixel_aspect(stream: Any) -> Fraction:
    """Return how many times as wide as high a movie's pixels are, by the container before the codec."""
    return Fraction(stream.sample_aspect_ratio or 1) or Fraction(1)


def _decoder_name(path: Path, stream: Any) -> str:
    """Return the name of the decoder that gives a stream's alpha, or else its usual one."""
    name = stream.codec_context.name
    tags = {key.lower(): value for key, value in stream.metadata.items()}
    if tags.get("alpha_mode") != "1" or name not in ALPHA_DECODERS:
        return name
    if ALPHA_DECODERS[name] not in av.codecs_available:
        raise ValueError(
            f"{path}: has alpha that this FFmpeg does not decode: expected its decoder {ALPHA_DECODERS[name]}"
        )
    return ALPHA_DECODERS[name]


def _decode(container: InputContainer, stream: Any, codec: str, *, stop: bool) -> Iterator[av.VideoFrame]:
    """Yield a stream's frames. Frames that cannot be decoded are left out, or are the end if `stop`."""
    context = stream.codec_context
    if codec != context.name:
        context = av.CodecContext.create(codec, "r")
        context.extradata = stream.codec_context.extradata
        for name in ("color_primaries", "color_trc", "colorspace", "color_range"):
            setattr(context, name, getattr(stream.codec_context, name))
    for packet in container.demux(stream):
        try:
            yield from context.decode(packet if packet.size else None)
        except av.error.FFmpegError:
            if stop:
                return


def _deinterlaced(frames: Iterator[av.VideoFrame], stream: Any) -> Iterator[av.VideoFrame]:
    """Yield a frame for each; in frames of two fields, rows of one field are filled in (BWDIF)."""
    context = stream.codec_context
    order = 0 if context.name in CODECS_STATING_FIELDS else int(context.field_order)
    graph: av.filter.Graph | None = None
    for frame in frames:
        stated = frame.interlaced_frame and context.name not in ADAM7
        if graph is None and not stated and order not in (*TOP_FIRST, *BOTTOM_FIRST):
            yield frame
            continue
        if frame.time_base is None:  # PyAV sets it for the first frame of several alone
            frame.time_base = stream.time_base
        if graph is None:
            graph = _field_graph(frame, 0 if stated else order)
        graph.push(frame)
        yield from _pulled(graph, stream.time_base)
    if graph is not None:
        graph.push(None)
        yield from _pulled(graph, stream.time_base)


def _field_graph(frame: av.VideoFrame, order: int) -> av.filter.Graph:
    """Return a filter graph that deinterlaces frames like this one.

    `order`: the stream's, which the frames do not say; 0 where they do.
    """
    graph = av.filter.Graph()
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=frame.time_base
    )
    chain = [source]
    if order:
        chain.append(graph.add("setfield", "tff" if order in TOP_FIRST else "bff"))
    chain += [graph.add("bwdif", "mode=send_frame:parity=auto:deint=interlaced"), graph.add("buffersink")]
    for one, other in itertools.pairwise(chain):
        one.link_to(other)
    graph.configure()
    return graph


def _pulled(graph: av.filter.Graph, time_base: Fraction) -> Iterator[av.VideoFrame]:
    """Yield what a graph has ready, its times in units of `time_base`: the filter counts in fields."""
    while True:
        try:
            frame: Any = graph.pull()
        except (av.error.BlockingIOError, av.error.EOFError):
            return
        if frame.pts is not None and frame.time_base:
            frame.pts, frame.time_base = round(frame.pts * frame.time_base / time_base), time_base
        yield frame
