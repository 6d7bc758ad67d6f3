"""Frame sequences: file names with a frame number, `plate.%04d.exr` or `plate.####.exr`; and frame ranges.

A sequence of OpenEXR files may name a layer of them: `plate.%04d.exr:albedo`.
"""

import functools
import itertools
import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol, Self, TypeAlias

import numpy as np

from relight.arguments import About, Converts, checked
from relight.errors import MissingFramesError
from relight.media.content_hash import FileRecord, content_hash, file_state
from relight.media.images.layers import split_layer
from relight.media.timecode import TEXT as TIMECODE
from shadow.files import AnyPath

Held: TypeAlias = Any  # by an argument, for a frame: a picture, or whatever else it may be
TOKEN = re.compile(r"%0?(?P<printf>\d*)d|(?P<hashes>#+)")
SPAN = re.compile(
    r"(-?[0-9]{1,20})(?:-(-?[0-9]{1,20})(?:[x:]([0-9]{1,20}))?)?"
)  # 7, -3-100, 1-100x2, 1-100:2
MOST_DIGITS = 20  # of a frame number in a file's name
MAX_FRAME_NUMBER = 10**9
MAX_FRAMES = 10**6  # of a shot: 11 hours at 24 a second


FirstAndLast = Annotated[
    tuple[int, int], Converts(), About(expected="(first, last), or a text such as 1-100 or 1-10,20")
]


class FrameRange(tuple[int, ...]):
    """The frames of a shot: their numbers, ascending, each once.

    As text they are written as Open Job Description writes them, `1-10,20,30-40:2`.
    """

    @classmethod
    def of(cls, frames: "int | str | tuple[int, int] | FrameRange") -> Self:
        """From a number, text, or (first, last). Text is `1-100`; `1-100x2` (as in Nuke) or `1-100:2` (as in
        Open Job Description) for every second; or several of these: `1-10,20,30-40`.

        Raises ValueError for other text, numbers beyond ±10⁹, and more than a million frames.
        """
        if isinstance(frames, cls):
            return frames
        if isinstance(frames, str):
            spans = [_span(text) for text in frames.split(",")]
        else:
            if isinstance(frames, int) and not isinstance(frames, bool):
                frames = frames, frames
            first, last = checked("frames", frames, FirstAndLast)
            spans = [(first, last, 1)]
        most = MAX_FRAME_NUMBER
        if not all(-most <= first <= last <= most and step > 0 for first, last, step in spans):
            raise ValueError(
                f"frames: expected {-most} <= first <= last <= {most} and steps of at least 1, got {frames!r}"
            )
        ranges = [range(first, last + 1, step) for first, last, step in spans]
        if sum(map(len, ranges)) > MAX_FRAMES:
            raise ValueError(f"frames: expected up to {MAX_FRAMES} in all, got {frames!r}")
        return cls(sorted(set().union(*ranges)))

    def __str__(self) -> str:
        step = self[1] - self[0] if len(self) > 1 else 1
        if step > 1 and self == tuple(range(self[0], self[-1] + 1, step)):
            return f"{self[0]}-{self[-1]}:{step}"
        runs = itertools.groupby(enumerate(self), key=lambda pair: pair[1] - pair[0])
        ends = [(numbers[0], numbers[-1]) for _, run in runs if (numbers := [number for _, number in run])]
        return ",".join(f"{first}-{last}" if last > first else f"{first}" for first, last in ends)

    def chunks(self, count: int) -> "list[FrameRange]":
        """Return the frames in chunks of `count`, in order; the last chunk may have fewer."""
        return [FrameRange(self[start : start + count]) for start in range(0, len(self), count)]


def _frames(value: "GivenFrames") -> object:
    try:
        # Which frames timecodes are, only the shot knows.
        FrameRange.of(TIMECODE.sub("0", value) if isinstance(value, str) else value)
    except (TypeError, ValueError) as error:
        raise type(error)(str(error).removeprefix("frames: ")) from None
    return value


if TYPE_CHECKING:
    GivenFrames: TypeAlias = int | tuple[int, int] | str | FrameRange
else:
    GivenFrames = Annotated[object, About(check=_frames)]


def _span(text: str) -> tuple[int, int, int]:
    """Parse `1-100x2` as (1, 100, 2)."""
    match = SPAN.fullmatch(text.strip())
    if match is None:
        expected = "numbers such as 1-100, 1-100x2 or 1-10,20,30-40"
        raise ValueError(f"frames: expected {expected}, got {text[:40]!r}")
    first, last, step = match.groups()
    return int(first), int(last or first), int(step or 1)


def _within_word(name: str, token: re.Match) -> bool:
    """Return whether letters or digits touch a frame number on both sides."""
    return all(side.isalnum() for side in (name[: token.start()][-1:], name[token.end() :][:1]))


@dataclass(frozen=True)
class FrameSequence:
    """The files of a sequence: `before`, the frame number with at least `digits` digits, `after`.

    `layer`: of OpenEXR files, the one that is meant; None for the picture itself.
    """

    folder: Path
    before: str
    digits: int
    after: str
    layer: str | None = None

    @classmethod
    def of(cls, path: AnyPath) -> Self | None:
        """Return the sequence that `path` names, or None if it names a single file.

        The frame number is `%04d` (or `%d`) or `####`, one `#` a digit, once in the file's name. A file of
        that very name is what it is; so is a name in which a single `#` or `%d` stands within a word, as in
        `take#2.png` and `50%done.png`, unless such numbered files exist.

        Raises ValueError if there are two frame numbers.
        """
        path, layer = split_layer(path)
        tokens = list(TOKEN.finditer(path.name))
        if not tokens or path.is_file():
            return None
        if len(tokens) > 1:
            raise ValueError(f"{path}: expected one frame number, such as %04d or ####, got {len(tokens)}")
        token = tokens[0]
        if token.group() in ("#", "%d") and _within_word(path.name, token):
            number = re.compile(
                rf"{re.escape(path.name[: token.start()])}-?\d+{re.escape(path.name[token.end() :])}"
            )
            if not path.parent.is_dir() or not any(map(number.fullmatch, os.listdir(path.parent))):
                return None
        digits = len(token["hashes"]) if token["hashes"] else int(token["printf"][:9] or 1)
        if digits > MOST_DIGITS:
            raise ValueError(f"{path}: expected a frame number of up to {MOST_DIGITS} digits")
        return cls(path.parent, path.name[: token.start()], max(digits, 1), path.name[token.end() :], layer)

    def __str__(self) -> str:
        layer = "" if self.layer is None else f":{self.layer}"
        number = f"%0{self.digits}d"  # as C and Nuke write it
        return str(self.folder / f"{self.before}{number}{self.after}{layer}")

    def path(self, number: int) -> Path:
        """Return the file of a frame.

        The sign of a negative number takes the place of a digit, as in C and Nuke.
        """
        return self.folder / f"{self.before}{number:0{self.digits}d}{self.after}"

    def beside(self, suffix: str) -> Path:
        """Return the file of another kind for the whole sequence: `plate.json` for `plate.%04d.exr`."""
        return self.folder / f"{self.before.rstrip('._-') or 'frames'}{suffix}"

    def numbers(self) -> list[int]:
        """Return the frames that exist on the disk, in order."""
        numbers = {number for number, _ in self._candidates()}
        return sorted(number for number in numbers if self.path(number).is_file())  # with as many digits

    def padded_otherwise(self) -> list[str]:
        """Return the names of files whose frame number has other digits, such as -0003 for -003."""
        return sorted(name for number, name in self._candidates() if not self.path(number).is_file())

    def _candidates(self) -> Iterator[tuple[int, str]]:
        """Yield the number and name of each file whose frame number has any count of digits."""
        pattern = re.compile(rf"{re.escape(self.before)}(-?\d+){re.escape(self.after)}")
        for path in self.folder.iterdir() if self.folder.is_dir() else ():
            if match := pattern.fullmatch(path.name):
                yield int(match[1]), path.name


class Reader(Protocol):
    """What reads the frames of an argument: a still, a sequence, a movie, or an analysis cache."""

    @property
    def numbers(self) -> Sequence[int] | None:
        """The numbers of the frames, in order; None for one picture for all of them."""

    @property
    def rate(self) -> Fraction | float | None:
        """Frames a second, if they are stated."""

    def read(self, number: int) -> Held:
        """Return a frame: a picture, or whatever else the argument holds."""

    def file(self, number: int) -> Path | None:
        """Return the file of a frame, or None."""

    def content_hash(self, number: int) -> str:
        """Return a hash of a frame."""


class Still:
    """One picture for all frames."""

    numbers: None = None
    rate: None = None

    def __init__(self, picture: object, hashed: object = None, record: FileRecord | None = None) -> None:
        """Take the picture, the value that is hashed in its place, and the record of its file."""
        self.picture, self.record = picture, record
        self._hashed = picture if hashed is None else hashed

    def read(self, number: int) -> Held:
        return self.picture

    def file(self, number: int) -> Path | None:
        """Return the file of a frame, or None."""
        return None if self.record is None else self.record.path

    def content_hash(self, number: int) -> str:
        """Return a hash of the picture."""
        return self._content_hash

    @functools.cached_property
    def _content_hash(self) -> str:
        return content_hash(self._hashed)


class SequenceReader:
    """The frames of a sequence, by `read`, a function of a path.

    rate: frames a second, where the files of a plate state it.
    """

    rate: Fraction | None = None

    def __init__(self, sequence: FrameSequence, read: Callable[[Path], np.ndarray]) -> None:
        self.sequence = sequence
        self.numbers = sequence.numbers()
        self._read = read
        if not self.numbers:
            raise MissingFramesError(f"{sequence}: no such frames")
        if others := sequence.padded_otherwise():
            warnings.warn(
                f"{sequence}: leaves out {others[0]}{f' and {len(others) - 1} more' if others[1:] else ''}, "
                "whose frame number has other digits; rename them",
                stacklevel=3,
            )

    def read(self, number: int) -> np.ndarray:
        path, layer = self.sequence.path(number), self.sequence.layer
        return self._read(path if layer is None else Path(f"{path}:{layer}"))

    def file(self, number: int) -> Path | None:
        """Return the file of a frame."""
        return self.sequence.path(number)

    def content_hash(self, number: int, sha256: str | None = None) -> str:
        """Return a hash that differs where the frame's file or the layer does.

        `sha256`: of the file as it was read; unless given, as it is.
        """
        state = file_state(self.sequence.path(number)) if sha256 is None else sha256
        return (
            content_hash(state) if self.sequence.layer is None else content_hash(state, self.sequence.layer)
        )
