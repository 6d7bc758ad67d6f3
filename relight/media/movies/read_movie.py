"""Reading movies through PyAV, as they say: alpha, colour, fields and the shape of pixels."""

import warnings
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from relight.media import colour
from relight.media.content_hash import FileRecord, content_hash, file_state
from relight.media.encodings import Encoding, decode_bt709
from relight.media.images.arrays import linearise
from relight.media.matte import matte_of
from relight.media.movies.decode import decode, deinterlaced
from relight.media.movies.forms import HDR_NAMES
from relight.media.movies.streams import (
    check_dolby_vision,
    clean_aperture,
    decoder_name,
    demuxed,
    opened,
    pixel_aspect,
    video_stream,
)
from relight.media.pixel_aspect import SIDEWAYS, SQUARED, is_square, square_pixels, upright
from relight.media.regular_file import naming
from relight.media.video_frames import has_mastering_metadata, read_codes, read_orientation
from shadow.files import AnyPath

RATE = 24  # frames a second, where nothing states another
SYNCHRONOUS = Fraction(1, 25)  # seconds by which sound may be early or late, at least
READ = (
    *(".3gp", ".avi", ".m2ts", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".mts", ".mxf", ".ts"),
    *(".webm", ".wmv"),
)
OPAQUE = 0.99  # least alpha of a movie that counts as opaque: compression takes a code or two away
GREY = 0.1  # most that red, green and blue of a compressed grey picture differ


def is_movie(path: AnyPath) -> bool:
    """Return whether a file's name is a movie's."""
    return Path(path).suffix.lower() in READ


class Movie:
    """A movie, frame by frame. Frames are numbered from 1, in the order they are shown.

    Reading in order decodes each frame once; going back starts over. A frame is what the container's clean
    aperture shows of it. Interlaced frames are deinterlaced, one
    frame for each, and pixels that are not square are made so. Frames are turned and mirrored as the
    container's display matrix says.

    The file is one that FFmpeg reads. `colour_space`: of its red, green and blue, where it does not declare
    it, or declares what is wrong. `alpha`: "straight" or "premultiplied"; movies are straight unless it is
    said.

    Raises FileNotFoundError, and ValueError for no movie, cover art alone, Dolby Vision with colours of its
    own, or alpha that this FFmpeg does not decode. Warns of pixels that are not square, a frame rate that
    varies, and times that start again within the file.
    """

    record: FileRecord | None = None  # of the file as it was opened, where that is asked for

    def __init__(self, path: AnyPath, *, colour_space: str | None = None, alpha: str | None = None) -> None:
        self.path, self._straight = Path(path), alpha != "premultiplied"
        self.colour_space = colour_space
        try:
            with opened(path) as container:
                stream = video_stream(container, path)
                check_dolby_vision(container, stream, path)
                self.rate = stream.average_rate
                self.pixel_aspect = float(pixel_aspect(stream))
                self._shown = clean_aperture(container, stream, path)
                self._codec = decoder_name(self.path, stream)
                packets = [
                    (packet.pts, starts_again)
                    for packet, starts_again in demuxed(container, stream)
                    if not packet.is_discard
                ]
                time_base = stream.time_base or Fraction(1)
        except av.error.FFmpegError as error:
            raise ValueError(f"{path}: cannot be read as a movie: {error}") from error
        times = sorted({time for time, _ in packets if time is not None})
        self._order = {time: number for number, time in enumerate(times, 1)}
        self._times = [time * time_base for time in times]  # seconds
        if not self._order:
            raise ValueError(f"{path}: is damaged or truncated: it has no frames")
        self._frames: Iterator[tuple[int, av.VideoFrame]] = iter(())
        self._frame: av.VideoFrame | None = None
        self._number = len(self._order) + 1  # of the frame that is decoded: beyond the last, so start over
        self.is_steady = self._check_times(any(starts_again for _, starts_again in packets))
        if not is_square(self.pixel_aspect):
            warnings.warn(
                f"{path}: its pixels are {self.pixel_aspect:.4g} times as wide as high; {SQUARED}",
                stacklevel=2,
            )

    def _check_times(self, joined: bool) -> bool:
        """Return whether frame times are those of a constant rate, so that sound fits; warn if not."""
        rate = Fraction(self.rate or RATE)
        start = self._times[0]
        late = max(abs(time - start - number / rate) for number, time in enumerate(self._times))  # seconds
        if joined:
            problem = "consists of parts whose times start again"
        elif late > max(1 / rate, SYNCHRONOUS):
            problem = f"has a variable frame rate, {float(rate):.4g} frames a second on average"
        else:
            return True
        warnings.warn(
            f"{self.path}: {problem}; every frame counts as equally long, and its sound is left out",
            stacklevel=3,
        )
        return False

    @property
    def numbers(self) -> range:
        """The frames there are."""
        return range(1, len(self._order) + 1)

    def read(self, number: int) -> np.ndarray:
        """Read a frame: (H, W, 3|4) float32, linear Rec.709, premultiplied, upright, of square pixels.

        ValueError: there is no such frame, it is damaged, or its transfer function or primaries are unknown.
        """
        codes = self._codes(number)
        with naming(self.path):
            space = self.colour_space or self._encoding()
            light = linearise(codes, straight=self._straight, space=space)
        return self._upright(light)

    def file(self, number: int) -> Path | None:
        """Return where a frame is read."""
        return self.path

    def content_hash(self, number: int, sha256: str | None = None) -> str:
        """Return a hash that differs where the movie's file or the frame does.

        `sha256`: of the file as it was read; unless given, as it is now.
        """
        return content_hash(file_state(self.path) if sha256 is None else sha256, number)

    def holds_display_light(self) -> bool:
        """Return whether frames are code values of a display, whose white is 1; raises as `read`."""
        self._codes(self.numbers[0])
        with naming(self.path):
            return colour.is_display_light(self.colour_space or self._encoding())

    def hdr_name(self) -> str | None:
        """Return "HLG" or "PQ" for light beyond a display's white; None for others. Raises as `read`."""
        if self.colour_space is not None:
            return None
        self._codes(self.numbers[0])
        assert self._frame is not None
        return HDR_NAMES.get(int(self._frame.color_trc))

    def has_mastering_metadata(self) -> bool:
        """Return whether the first frame has the metadata of HDR10. Raises as `read`."""
        self._codes(self.numbers[0])
        assert self._frame is not None
        return has_mastering_metadata(self._frame)

    def upright_aspect(self) -> float:
        """Return how many times as wide as high the pixels are once a frame stands upright.

        ValueError where the first frame is damaged.
        """
        if is_square(self.pixel_aspect):
            return 1.0
        self._codes(self.numbers[0])
        assert self._frame is not None
        sideways = self._orientation() in SIDEWAYS
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
        with naming(self.path):
            return read_codes(self._frame, self._codec)[self._shown]

    def _encoding(self) -> Encoding:
        """Return what the frame says of its colour, BT.709 where it says nothing."""
        frame = self._frame
        assert frame is not None
        return Encoding.from_code_points(
            int(frame.color_primaries), int(frame.color_trc), unspecified=decode_bt709
        )

    def _upright(self, pixels: np.ndarray) -> np.ndarray:
        """Return pixels (H, W, C) as they are to be looked at: square, and turned as the container asks."""
        return np.ascontiguousarray(upright(square_pixels(pixels, self.pixel_aspect), self._orientation()))

    def _orientation(self) -> int:
        """Return the frame's orientation by its display matrix, as Exif counts orientations."""
        assert self._frame is not None
        with naming(self.path):
            return read_orientation(self._frame)

    def _decoded(self) -> Iterator[tuple[int, av.VideoFrame]]:
        """Yield numbers and frames, as far as they can be decoded.

        An AVI has no times of presentation. Where its frames are not stored in the order they are shown, as
        B-frames are not, they are counted as they are decoded, which ends at the first that is damaged.
        """
        with opened(self.path, err_detect="explode") as container:
            stream = video_stream(container, self.path)
            stream.thread_type = "AUTO"
            counted = container.format.name == "avi" and stream.codec_context.has_b_frames
            frames = decode(container, stream, self._codec, stop=counted)
            for count, frame in enumerate(deinterlaced(frames, stream), 1):
                if counted:
                    yield count, frame
                elif frame.pts in self._order:
                    yield self._order[frame.pts], frame


class MatteMovie(Movie):
    """A movie of mattes, read as `relight.read_mask` reads stills: alpha unless it is opaque, else grey."""

    def __init__(self, path: AnyPath) -> None:
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
