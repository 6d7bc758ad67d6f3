"""The analysis cache of a shot: a folder with one file a frame, in which each states what it was made from.

No file stands for the whole shot, so any number of machines may write frames into one folder.
"""

import math
import os
import warnings
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeGuard, TypeVar, cast

from relight.analysis import storage
from relight.analysis.storage import Provenance
from relight.errors import DamagedFileError, MissingFramesError, StaleAnalysisError
from relight.lights.environment import FIELD_OF_VIEW
from relight.media.content_hash import FileRecord, hash_file
from relight.media.sequences import FrameSequence
from relight.pipeline.options import Compute, Source
from relight.pipeline.plate_metadata import PlateMetadata
from relight.subject import Subject, weights
from shadow.files import AnyPath, is_path

Number = TypeVar("Number", float, Fraction)
SUFFIX = ".relight"
STILL = f"still{storage.SUFFIX}"  # the name of the one file of a still
NEEDED = ("options", "precision", "sources")  # of a frame's provenance
AGAIN = "run `relight analyse` again"


def is_cache(path: object) -> TypeGuard[str | Path]:
    """Return whether a source is an analysis cache: a folder, or a path with its suffix."""
    return is_path(path) and (Path(path).suffix.lower() == SUFFIX or Path(path).is_dir())


def check_not_analysed(source: Source, compute: Compute) -> None:
    """Raise ValueError if an analysis cache is given together with options that it was made with."""
    given = [name for name in source.given() if name != "plate"]
    given += ["precision"] if compute.precision is not None else []
    if is_cache(source.plate) and given:
        raise ValueError(f"{given[0]}: {source.plate} is analysed already; give it to `relight analyse`")


def frame_file(folder: Path, number: int | None) -> Path:
    """Return the file of a frame, or of a still if `number` is None."""
    if number is None:
        return folder / STILL
    return FrameSequence(folder, "", 6, storage.SUFFIX).path(number)


def kept_frames(folder: Path) -> list[int]:
    """Return the numbers of the frames of a shot that a folder holds."""
    return FrameSequence(folder, "", 6, storage.SUFFIX).numbers()


def check_kind(folder: Path, is_still: bool) -> None:
    """Raise ValueError if a folder for a still holds a shot, or the other way round."""
    if kept_frames(folder) if is_still else frame_file(folder, None).is_file():
        kinds = ("a still", "a shot") if is_still else ("a shot", "a still")
        raise ValueError(f"{folder}: expected a folder for {kinds[0]}, and this holds {kinds[1]}")


def is_made_from(path: Path, content_hash: str) -> bool:
    """Return whether a frame's file is complete, and states this hash of what it was made from."""
    try:
        _, provenance = storage.read_record(path)
        return provenance.get("content_hash") == content_hash
    except (OSError, ValueError):
        return False


class AnalysisCache:
    """The kept frames of a shot, checked as they are read.

    Raises MissingFramesError: no such folder, or no frames in it.
    """

    def __init__(self, folder: AnyPath) -> None:
        self.folder = Path(folder)
        still = frame_file(self.folder, None)
        self.numbers: list[int] | None = kept_frames(self.folder)
        if still.is_file():
            if self.numbers:
                raise ValueError(f"{still}: a still among the frames of a shot; remove it, or the frames")
            self.numbers = None
        if self.numbers == []:
            raise MissingFramesError(
                f"{folder}: no analysed frames; `relight analyse` makes them. Give the plates of a shot "
                "by their names, such as plate.%04d.exr"
            )
        self._first: tuple[Path, Provenance] | None = None  # a frame, and its provenance
        self._warned: set[str] = set()

    @property
    def rate(self) -> Fraction | None:
        """Frames a second of the movie that was analysed."""
        return self._positive("rate", Fraction)

    @property
    def field_of_view(self) -> float:
        """Of the camera, vertical, in degrees."""
        return self._positive("field_of_view", float) or FIELD_OF_VIEW

    @property
    def pixel_aspect(self) -> float:
        """How many times as wide as high the pixels of the plates are that were analysed."""
        return self._positive("pixel_aspect", float) or 1.0

    @property
    def reference(self) -> int | None:
        """The reference frame of the shot, see `relight.pipeline.reference`; None if it is not in the folder.

        Raises DamagedFileError for anything that is no number.
        """
        for number in self.numbers or ():
            path = self.file(number)
            try:
                stated = storage.read_header(path)["provenance"].get("reference")
            except (OSError, ValueError):  # that frame is reported when it is its turn
                continue
            if stated is not None and type(stated) is not int:
                raise DamagedFileError(f"{path}: is damaged: its reference is {stated!r:.40}")
            return stated if stated in self.numbers else None  # type: ignore[operator]
        return None

    def plate_metadata(self, number: int) -> PlateMetadata:
        """Return what is kept of the statements of a frame's plate; nothing for a frame that is not there.

        Raises DamagedFileError where it is damaged. Warns once of frames that an earlier version made: they
        keep nothing.
        """
        path = self.file(number)
        try:
            provenance = storage.read_header(path)["provenance"]
        except (OSError, ValueError):  # that frame was reported when it was its turn
            return PlateMetadata()
        if "plate_metadata" not in provenance:
            self._warn(
                "plate_metadata", f"keeps no timecode, camera metadata and sound of its plates; {AGAIN}"
            )
            return PlateMetadata()
        try:
            found = PlateMetadata.from_json(provenance["plate_metadata"], self.folder)
        except ValueError as error:
            raise DamagedFileError(f"{path}: {error}") from error
        if found.sound is None or not found.sound.is_file() or self._is_source(found.sound, provenance):
            return found
        self._warn("sound", f"{found.sound} is not the movie that was analysed; its sound is left out")
        return replace(found, sound=None)

    def _is_source(self, path: Path, provenance: Provenance) -> bool:
        """Return whether a file is one from which a frame was analysed, by all of its bytes.

        Whoever made a cache may name any file of this machine, with its size and time, but not its content.
        """
        try:
            return any(
                (self.folder / source["path"]).resolve() == path.resolve()
                and source["sha256"] == hash_file(path)
                for source in provenance["sources"]
            )
        except (LookupError, OSError, TypeError) as error:
            raise DamagedFileError(f"{self.folder}: is damaged: its sources are none: {error}") from error

    def _positive(self, name: str, kind: Callable[[float | str], Number]) -> Number | None:
        """Return a number of the provenance of the first readable frame; None where it states none.

        Raises DamagedFileError for anything that is no positive number.
        """
        for number in self.numbers or [0]:
            path = self.file(number)
            try:
                stated = storage.read_header(path)["provenance"].get(name)
            except (OSError, ValueError):  # that frame is reported when it is its turn
                continue
            try:
                value = None if stated is None else kind(stated)
                if value is not None and not 0 < value < math.inf:
                    raise ValueError("it is not positive")
            except (ArithmeticError, TypeError, ValueError) as error:
                raise DamagedFileError(
                    f"{path}: is damaged: its {name} is {stated!r:.40}: {error}"
                ) from error
            return value
        return None

    def file(self, number: int) -> Path:
        """Return the file of a frame."""
        return frame_file(self.folder, None if self.numbers is None else number)

    def source_files(self, number: int) -> set[Path]:
        """Return the files, with links resolved, from which a frame was analysed."""
        sources = storage.read_header(self.file(number))["provenance"]["sources"]
        return {(self.folder / source["path"]).resolve() for source in sources}

    def content_hash(self, number: int) -> str:
        """Return a hash of the analysis of a frame; "" if the frame cannot be used."""
        try:
            return self._checked(number)["content_hash"]
        except (OSError, ValueError):
            return ""

    def read(self, number: int) -> Subject:
        """Return the person of a frame.

        Raises
        ------
        FileNotFoundError
            It is not there.
        DamagedFileError
            It is damaged.
        StaleAnalysisError
            Its plate, the weights or the options have changed.
        """
        self._checked(number)
        return Subject.load(self.file(number), may_be_empty=True)

    def _checked(self, number: int) -> Provenance:
        """Return the provenance of a frame if the frame can be used."""
        path = self.file(number)
        provenance = storage.read_header(path)["provenance"]
        if provenance.get("weights") != list(weights()):
            raise StaleAnalysisError(f"{path}: was analysed with other weights than this version's; {AGAIN}")
        if "content_hash" not in provenance:
            raise ValueError(f"{path}: is not a frame of a shot")
        unsaid = [name for name in NEEDED if name not in provenance]
        if unsaid:
            raise DamagedFileError(f"{path}: is damaged: it does not say its {unsaid[0]}")
        try:
            changed, missing = compare_sources(self.folder, provenance)
        except (LookupError, TypeError) as error:
            raise DamagedFileError(f"{path}: is damaged: its sources are none: {error}") from error
        if changed:
            raise StaleAnalysisError(f"{path}: is stale, {changed[0]} has changed since; {AGAIN}")
        if missing:
            self._warn("missing", f"{missing[0]} is not there to compare with; others may be missing too")
        first, other = self._first = self._first or (path, provenance)
        if provenance["options"] != other["options"]:
            raise StaleAnalysisError(f"{path}: was analysed with other options than {first.name}; {AGAIN}")
        if provenance["precision"] != other["precision"]:
            self._warn(
                "precision",
                f"{path.name} was analysed in {provenance['precision']}, {first.name} in "
                f"{other['precision']}; give all machines the same precision",
            )
        return provenance

    def _warn(self, kind: str, message: str) -> None:
        """Warn, once for all frames."""
        if kind not in self._warned:
            self._warned.add(kind)
            warnings.warn(f"{self.folder}: {message}", stacklevel=2)


def compare_sources(folder: Path, provenance: Provenance) -> tuple[list[Path], list[Path]]:
    """Return the files of a provenance that have changed, and those that do not exist."""
    changed, missing = [], []
    for source in provenance["sources"]:
        path = Path(os.path.normpath(folder / source["path"]))
        record = FileRecord(**cast(Any, {**source, "path": path}))
        try:
            if record.differs():
                changed.append(record.path)
        except OSError:
            missing.append(record.path)
    return changed, missing
