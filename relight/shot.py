"""The analysis of a shot, kept on the disk: a folder with a file a frame, in which each says what made it.

No file stands for the whole shot, so that any number of machines may write frames into one folder.
"""

import os
import warnings
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeGuard

from relight import keeping
from relight.media.identity import of_file
from relight.media.sequences import Sequence
from relight.nobody import Nobody, load
from relight.subject import Subject, weights
from shadow.files import AnyPath

SUFFIX = ".relight"
STILL = f"still{keeping.SUFFIX}"  # the name of the one file of a photograph
AGAIN = "run `relight analyse` again"


def is_shot(path: object) -> TypeGuard[str | Path]:
    """Whether a source is a kept analysis: a folder, or what is called like one."""
    return isinstance(path, str | Path) and (Path(path).suffix.lower() == SUFFIX or Path(path).is_dir())


def frame_file(folder: Path, number: int | None) -> Path:
    """Where a frame is kept; of a still, None."""
    if number is None:
        return folder / STILL
    return Sequence(folder, "", 6, keeping.SUFFIX).path(number)


class Shot:
    """The kept frames of a shot, checked as they are read.

    Raises
    ------
    FileNotFoundError: no such folder, or no frames in it.
    """

    def __init__(self, folder: AnyPath) -> None:
        self.folder = Path(folder)
        still = frame_file(self.folder, None)
        self.numbers = None if still.is_file() else Sequence(self.folder, "", 6, keeping.SUFFIX).numbers()
        if self.numbers == []:
            raise FileNotFoundError(f"{folder}: no analysed frames; `relight analyse` makes them")
        self._first: tuple[Path, dict[str, Any]] | None = None  # a frame, and what it is made of
        self._said: set[str] = set()  # what was warned of

    @property
    def rate(self) -> Fraction | None:
        """Frames a second of the movie that was analysed."""
        for number in self.numbers or [0]:
            try:
                said = keeping.read_about(self.file(number))["made_of"].get("rate")
                return None if said is None else Fraction(said)
            except (OSError, ValueError):  # that frame is named when it is its turn
                continue
        return None

    def file(self, number: int) -> Path:
        """Where a frame is kept."""
        return frame_file(self.folder, None if self.numbers is None else number)

    def identity(self, number: int) -> str:
        """Differs where the frame's analysis does; "" where it cannot be used."""
        try:
            return self._made_of(number)["identity"]
        except (OSError, ValueError):
            return ""

    def read(self, number: int) -> Subject | Nobody:
        """The person of a frame.

        Raises
        ------
        FileNotFoundError: it is not there. ValueError: it is damaged; or stale, since its plate, the weights
        or the options have changed.
        """
        self._made_of(number)
        return load(self.file(number))

    def _made_of(self, number: int) -> dict[str, Any]:
        """What a frame is made of, once it is checked."""
        path = self.file(number)
        made_of = keeping.read_about(path)["made_of"]
        if made_of.get("weights") != list(weights()):
            raise ValueError(f"{path}: was analysed with other weights than this version's; {AGAIN}")
        if "identity" not in made_of:
            raise ValueError(f"{path}: is no frame of a shot")
        changed, missing = _compared(self.folder, made_of["sources"])
        if changed:
            raise ValueError(f"{path}: is stale, {changed[0]} has changed since; {AGAIN}")
        if missing:
            self._say("missing", f"{missing[0]} is not there to compare with; nor may others be")
        first, other = self._first = self._first or (path, made_of)
        if made_of["options"] != other["options"]:
            raise ValueError(f"{path}: was analysed with other options than {first.name}; {AGAIN}")
        if made_of["precision"] != other["precision"]:
            self._say(
                "precision",
                f"{path.name} was analysed in {made_of['precision']}, {first.name} in {other['precision']}; "
                "`--precision` has machines agree",
            )
        return made_of

    def _say(self, kind: str, message: str) -> None:
        """Warn, once for all frames."""
        if kind not in self._said:
            self._said.add(kind)
            warnings.warn(f"{self.folder}: {message}", stacklevel=2)


def described(folder: Path, files: Iterable[Path]) -> list[dict[str, Any]]:
    """What tells each file that a frame is made of from another, or from what it becomes later."""
    known = []
    for path in sorted(set(files)):
        state = path.stat()
        known.append(
            {
                "path": _relative(path, folder),
                "size": state.st_size,
                "modified": state.st_mtime_ns,
                "sha256": of_file(path),
            }
        )
    return known


def _relative(path: Path, folder: Path) -> str:
    """As seen from the shot's folder, so that a project may move; on another drive, as it is."""
    try:
        return os.path.relpath(path.resolve(), folder.resolve())
    except ValueError:
        return str(path.resolve())


def _compared(folder: Path, sources: list[dict[str, Any]]) -> tuple[list[Path], list[Path]]:
    """The files that have changed, and those that are not there. One of the same size and time is taken to be
    the same, as by make and rsync."""
    changed, missing = [], []
    for source in sources:
        path = Path(os.path.normpath(folder / source["path"]))
        try:
            state = path.stat()
        except OSError:
            missing.append(path)
            continue
        if (state.st_size, state.st_mtime_ns) == (source["size"], source["modified"]):
            continue
        if state.st_size != source["size"] or of_file(path) != source["sha256"]:
            changed.append(path)
    return changed, missing
