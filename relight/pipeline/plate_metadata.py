"""What a frame's plate states of its scene and camera: read from the plate, or kept in an analysis cache."""

import functools
import os
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

from relight.media import images, movies
from relight.media.movies import RATE
from relight.media.movies.tracks import read_tags
from relight.media.privacy import is_private
from relight.media.timecode import offset_timecode, pack_timecode, packs, unpack_timecode
from relight.pipeline.readers import Reader

VERSION = 1  # of the entry in a cache
LONGEST = 1 << 14  # characters of a value that a cache keeps; lists of object names are longer


@dataclass(frozen=True)
class PlateMetadata:
    """What outputs keep of the plate of a frame."""

    header: dict[str, images.TypedValue] = field(default_factory=dict)  # for that of an .exr
    timecode: str | None = None  # of the frame, such as 01:00:00:00
    tags: dict[str, str] = field(default_factory=dict)  # of the container of a movie
    sound: Path | None = None  # the movie, if it has sound
    begin: Fraction = Fraction(0)  # when the frame is shown, in seconds of that movie
    end: Fraction = Fraction(0)

    def to_json(self, folder: Path) -> dict[str, object]:
        """Return what JSON holds of this, for a file in `folder`; `from_json` is the inverse.

        Values that are longer than `LONGEST` characters, and arrays of bytes, are left out.
        """
        header = {name: [each.kind, each.value] for name, each in self.header.items() if _is_kept(each.value)}
        return {
            "version": VERSION,
            "header": header,
            "timecode": self.timecode,
            "tags": {name: text for name, text in self.tags.items() if len(text) <= LONGEST},
            "sound": None if self.sound is None else relative_path(self.sound, folder),
            "shown": [str(self.begin), str(self.end)],
        }

    @classmethod
    def from_json(cls, value: Any, folder: Path) -> Self:
        """Return what `to_json` was given. Raises ValueError for another version or other values."""
        try:
            if value["version"] != VERSION:
                raise ValueError(f"expected version {VERSION}, got {value['version']!r:.40}")
            begin, end = map(Fraction, value["shown"])
            return cls(
                {
                    name: _typed(*each)
                    for name, each in value["header"].items()
                    if not is_private(name, each[1])
                },
                value["timecode"],
                {
                    str(name): str(text)
                    for name, text in value["tags"].items()
                    if not is_private(str(name), str(text))
                },
                None if value["sound"] is None else Path(os.path.normpath(folder / value["sound"])),
                begin,
                end,
            )
        except (ArithmeticError, AttributeError, LookupError, TypeError) as error:
            raise ValueError(f"what it keeps of its plate is damaged: {error}") from error


def relative_path(path: Path, folder: Path) -> str:
    """Return a path relative to a folder, so that a project may move; absolute on another drive."""
    try:
        return os.path.relpath(path.resolve(), folder.resolve())
    except ValueError:
        return str(path.resolve())


class PlateMetadataReader:
    """Reads what the plates of a shot state, frame by frame."""

    def __init__(self, plates: Reader) -> None:
        self._plates = plates

    def at(self, number: int) -> PlateMetadata:
        """Return what the plate of a frame states; nothing where there is no file."""
        if isinstance(self._plates, movies.Movie):
            return self._of_movie(self._plates, number)
        path = self._plates.file(number)
        header = {} if path is None else images.read_metadata(path)
        packed = header.get(images.TIMECODE)
        return PlateMetadata(header, None if packed is None else unpack_timecode(packed.value[0]))

    def _of_movie(self, movie: movies.Movie, number: int) -> PlateMetadata:
        if number not in movie.numbers:
            return PlateMetadata()
        first, tags, heard = self._stated
        rate = movie.rate or RATE
        timecode = None if first is None else offset_timecode(first, number - 1, rate)
        # Some numbers of a fast movie fit and others do not: no frame has them then.
        packed = None if timecode is None or not packs(rate) else pack_timecode(timecode)
        header: dict[str, images.TypedValue] = {}
        if movie.rate is not None:
            parts = movie.rate.numerator, movie.rate.denominator
            header["FramesPerSecond"] = images.TypedValue("rational", parts)
        if packed is not None:
            header[images.TIMECODE] = images.TypedValue("timecode", packed)
        for name, text in tags.items():
            word = name.rpartition(".")[2].capitalize()  # com.apple.quicktime.make
            if word in ("Make", "Model"):
                header[word] = images.TypedValue("string", text)
        span = movie.span(number, number)
        return PlateMetadata(header, timecode, tags, movie.path if heard and movie.is_steady else None, *span)

    @functools.cached_property
    def _stated(self) -> tuple[str | None, dict[str, str], bool]:
        """Timecode of a movie's first frame, its tags, and whether it has sound: read once for all frames."""
        assert isinstance(self._plates, movies.Movie)
        return read_tags(self._plates.path)


def _is_kept(value: object) -> bool:
    """Return whether JSON holds a header's value, and it is small."""
    values = value if isinstance(value, tuple) else (value,)
    return all(isinstance(each, str | int | float) for each in values) and len(str(value)) <= LONGEST


def _typed(kind: object, value: object) -> images.TypedValue:
    """Return a header's value of the type and value that JSON holds."""
    values = value if isinstance(value, list) else [value]
    if not isinstance(kind, str) or not all(map(_is_writable, values)):
        raise TypeError(f"a value of type {kind!r}")
    return images.TypedValue(kind, tuple(value) if isinstance(value, list) else value)


def _is_writable(value: object) -> bool:
    """Return whether a header can hold a value: text of UTF-8, or a number of 32 bits."""
    if isinstance(value, str):
        return value.isprintable() or value.encode(errors="replace").decode() == value
    return isinstance(value, float) or (isinstance(value, int) and -(2**31) <= value < 2**32)
