"""Writes the analysed frames of a shot to its cache; a frame that is up to date is kept."""

import warnings
from pathlib import Path
from typing import Any

from relight import __version__
from relight.media.content_hash import content_hash
from relight.pipeline.cache import frame_file, is_made_from
from relight.pipeline.plate_metadata import VERSION, PlateMetadataReader, relative_path
from relight.pipeline.shot import Shot


class CacheWriter:
    """Writes the frames of an open shot to a folder, the analysis cache."""

    def __init__(self, shot: Shot, folder: Path) -> None:
        self._shot, self._folder = shot, folder
        self._replaced = 0  # frames
        self._plates = PlateMetadataReader(shot.frames.plates)
        precision, threads = shot.computed_in
        self._provenance: dict[str, Any] = {
            "options": content_hash(shot.frames.options_hash, __version__),
            "version": __version__,
            "rate": None if shot.rate is None else str(shot.rate),
            "field_of_view": shot.frames.field_of_view,
            "pixel_aspect": shot.pixel_aspect,
            "precision": precision,
            "threads": threads,
        }

    def write(self, number: int) -> None:
        """Analyse and store a frame, unless it is up to date. Raises OSError or ValueError."""
        path = frame_file(self._folder, None if self._shot.is_still else number)
        there = path.exists()
        if there and is_made_from(path, self._content_hash(number)):
            return
        person = self._shot.person(number)
        files = self._shot.records(number)
        made = {
            "content_hash": self._content_hash(number, as_read=True),
            "sources": [file._asdict() | {"path": relative_path(file.path, self._folder)} for file in files],
            "plate_metadata": self._plates.at(number).to_json(self._folder),
        }
        person.save(path, provenance=self._provenance | made)
        self._replaced += there

    def warn_of_replaced(self, count: int) -> None:
        """Warn if frames were there, of `count` in all, and were analysed again."""
        if self._replaced:
            warnings.warn(
                f"{self._folder}: {self._replaced} of {count} frames were damaged, or made from other "
                "plates, with other options or weights or by another version, and were analysed again",
                stacklevel=4,
            )

    def _content_hash(self, number: int, as_read: bool = False) -> str:
        """Return a hash of all that determines the file of a frame."""
        return content_hash(self._shot.person_hash(number, as_read), VERSION)
