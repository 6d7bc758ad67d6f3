"""Frame sequences: file names with a frame number, `plate.%04d.exr` or `plate.####.exr`; and frame ranges."""

import functools
import itertools
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from relight.media.identity import identity
from shadow.files import AnyPath

TOKEN = re.compile(r"%0?(?P<printf>\d*)d|(?P<hashes>#+)")
SPAN = re.compile(r"([0-9]{1,20})(?:-([0-9]{1,20})(?:[x:]([0-9]{1,20}))?)?")  # 7, 1-100, 1-100x2 or 1-100:2
LAST = 10**9  # of the frame numbers
MOST = 10**6  # frames of a shot: 11 hours at 24 a second


class Frames(tuple[int, ...]):
    """The frames of a shot: their numbers, ascending, each once.

    As text they are written as Open Job Description writes them, `1-10,20,30-40:2`.
    """

    @classmethod
    def of(cls, frames: "str | tuple[int, int] | Frames") -> Self:
        """From text, or (first, last). Text is `1-100`; `1-100x2` (as in Nuke) or `1-100:2` (as in Open Job
        Description) for every second; or several of these: `1-10,20,30-40`.

        Raises ValueError for other text, numbers beyond 0 to 10⁹, and more than a million frames.
        """
        if isinstance(frames, cls):
            return frames
        if isinstance(frames, str):
            spans = [_span(text) for text in frames.split(",")]
        else:
            first, last = frames
            spans = [(first, last, 1)]
        if not all(0 <= first <= last <= LAST and step > 0 for first, last, step in spans):
            raise ValueError(
                f"frames: expected 0 <= first <= last <= {LAST} and steps of at least 1, got {frames!r}"
            )
        ranges = [range(first, last + 1, step) for first, last, step in spans]
        if sum(map(len, ranges)) > MOST:
            raise ValueError(f"frames: expected up to {MOST} in all, got {frames!r}")
        return cls(sorted(set().union(*ranges)))

    def __str__(self) -> str:
        step = self[1] - self[0] if len(self) > 1 else 1
        if step > 1 and self == tuple(range(self[0], self[-1] + 1, step)):
            return f"{self[0]}-{self[-1]}:{step}"
        runs = itertools.groupby(enumerate(self), key=lambda pair: pair[1] - pair[0])
        ends = [(numbers[0], numbers[-1]) for _, run in runs if (numbers := [number for _, number in run])]
        return ",".join(f"{first}-{last}" if last > first else f"{first}" for first, last in ends)

    def chunks(self, count: int) -> "list[Frames]":
        """The frames by `count`, in order; the last chunk may have fewer."""
        return [Frames(self[start : start + count]) for start in range(0, len(self), count)]


def _span(text: str) -> tuple[int, int, int]:
    """`1-100x2` as (1, 100, 2)."""
    match = SPAN.fullmatch(text.strip())
    if match is None:
        expected = "numbers such as 1-100, 1-100x2 or 1-10,20,30-40"
        raise ValueError(f"frames: expected {expected}, got {text[:40]!r}")
    first, last, step = match.groups()
    return int(first), int(last or first), int(step or 1)


@dataclass(frozen=True)
class Sequence:
    """The files of a sequence: `before`, the frame number with at least `digits` digits, `after`."""

    folder: Path
    before: str
    digits: int
    after: str

    @classmethod
    def of(cls, path: AnyPath) -> Self | None:
        """The sequence that `path` names, or None if it names a single file.

        The frame number is `%04d` (or `%d`) or `####`, one `#` a digit, once in the file's name. A file of
        that very name is what it is.

        Raises ValueError if there are two frame numbers.
        """
        path = Path(path)
        tokens = list(TOKEN.finditer(path.name))
        if not tokens or path.is_file():
            return None
        if len(tokens) > 1:
            raise ValueError(f"{path}: expected one frame number, such as %04d or ####, got {len(tokens)}")
        token = tokens[0]
        digits = len(token["hashes"]) if token["hashes"] else int(token["printf"] or 1)
        return cls(path.parent, path.name[: token.start()], max(digits, 1), path.name[token.end() :])

    def __str__(self) -> str:
        return str(self.folder / f"{self.before}{self.printf}{self.after}")

    @property
    def printf(self) -> str:
        """The frame number as C and Nuke write it."""
        return f"%0{self.digits}d"

    def path(self, number: int) -> Path:
        """The file of a frame."""
        return self.folder / f"{self.before}{number:0{self.digits}d}{self.after}"

    def beside(self, suffix: str) -> Path:
        """The one file of another kind that goes with the sequence: `plate.json` with `plate.%04d.exr`."""
        return self.folder / f"{self.before.rstrip('._-') or 'frames'}{suffix}"

    def numbers(self) -> list[int]:
        """The frames that are on the disk, in order."""
        if not self.folder.is_dir():
            return []
        name = re.compile(rf"{re.escape(self.before)}(\d{{{self.digits},}}){re.escape(self.after)}")
        found = (name.fullmatch(path.name) for path in self.folder.iterdir())
        numbers = {int(match[1]) for match in found if match}
        return sorted(number for number in numbers if self.path(number).is_file())


class Still:
    """One picture for all frames."""

    numbers: None = None
    rate: None = None

    def __init__(self, picture: Any, made_of: Any = None, path: Path | None = None) -> None:
        """`made_of`: what the picture's identity is that of, where that is not the picture. `path`: where it
        was read."""
        self.picture, self._path = picture, path
        self._made_of = picture if made_of is None else made_of

    def read(self, number: int) -> Any:
        return self.picture

    def file(self, number: int) -> Path | None:
        """Where a frame is read, if it is."""
        return self._path

    def identity(self, number: int) -> str:
        """Differs where the picture does."""
        return self._identity

    @functools.cached_property
    def _identity(self) -> str:
        return identity(self._made_of)


class Files:
    """The frames of a sequence, by `read`, a function of a path."""

    rate: None = None

    def __init__(self, sequence: Sequence, read: Callable[[Path], np.ndarray]) -> None:
        self.sequence = sequence
        self.numbers = sequence.numbers()
        self._read = read
        if not self.numbers:
            raise FileNotFoundError(f"{sequence}: no such frames")

    def read(self, number: int) -> np.ndarray:
        return self._read(self.sequence.path(number))

    def file(self, number: int) -> Path | None:
        """Where a frame is read."""
        return self.sequence.path(number)

    def identity(self, number: int) -> str:
        """Differs where the frame's file does."""
        return identity(self.sequence.path(number))
