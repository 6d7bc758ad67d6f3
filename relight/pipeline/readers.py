"""What reads the frames of an argument: a still, a sequence of files or a movie."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from relight.media import images, movies
from relight.media.content_hash import FileRecord
from relight.media.sequences import FrameSequence, Held, Reader, SequenceReader, Still
from shadow import normals as normals_module
from shadow.directions import CAMERA
from shadow.files import is_path

if TYPE_CHECKING:
    from relight.pipeline.options import Normals, Picture

NETWORKS = ("", ".pt", ".onnx", ".safetensors")  # suffixes of what `shadow.normals.load` takes


class ReadLog:
    """Reads pictures, and remembers each file as it was when it was read."""

    def __init__(self) -> None:
        self._records: dict[Path, FileRecord] = {}

    def read(self, reader: Reader, number: int) -> Held:
        """Read a picture. Raises ValueError if its file has changed since an earlier read."""
        path = reader.file(number)
        record = getattr(reader, "record", None)
        if record is None and path is not None and path.is_file():
            record = FileRecord.of(path)
        picture = reader.read(number)
        if record is not None and path is not None:
            if reader.numbers is not None:
                check_unchanged(record)
            self._records[path] = record
        return picture

    def record(self, path: Path) -> FileRecord:
        """Return the record of a file as it was read last; as it is now if it was not read."""
        return self._records.get(path) or FileRecord.of(path)

    def content_hash(self, reader: Reader, number: int, as_read: bool) -> str:
        """Return a hash of a picture: as it was read, if it was, or as its file is now."""
        path = reader.file(number)
        record = self._records.get(path) if as_read and path is not None else None
        if isinstance(reader, SequenceReader | movies.Movie) and record is not None and record.sha256:
            return reader.content_hash(number, record.sha256)
        return reader.content_hash(number)


def reader_of(value: object, read: Callable, read_movie: Callable) -> Reader:
    """Return the reader of an argument. `read` and `read_movie` take the path of an image or of a movie."""
    if not is_path(value):
        return Still(value)
    if movies.is_movie(value):
        record = FileRecord.of(Path(value)) if Path(value).is_file() else None
        movie = read_movie(value)
        movie.record = record
        return movie
    sequence = FrameSequence.of(value)
    return read_still(Path(value), read) if sequence is None else SequenceReader(sequence, read)


def plate_reader(picture: object, colour_space: str | None) -> Reader:
    """Return the reader of a background. `colour_space` overrides that of the file."""
    return _picture_reader(picture, colour_space, None, lambda image: image)


def person_reader(picture: object, colour_space: str | None, alpha: str | None) -> Reader:
    """Return the reader of a plate that shows a person, whose alpha is none if it is 0 everywhere.

    `colour_space` and `alpha` override those of the file.
    """
    return _picture_reader(
        picture, colour_space, alpha, lambda image: images.without_empty_alpha("plate", image)
    )


def _picture_reader(
    picture: object,
    colour_space: str | None,
    alpha: str | None,
    prepare: Callable[[np.ndarray], np.ndarray],
) -> Reader:
    reader = reader_of(
        picture,
        lambda path: prepare(images.read(path, colour_space=colour_space, alpha=alpha)),
        lambda path: movies.Movie(path, colour_space=colour_space, alpha=alpha),
    )
    if isinstance(reader, SequenceReader):
        reader.rate = images.read_frame_rate(reader.sequence.path(reader.numbers[0]))
    return reader


def holds_display_light(reader: Reader, colour_space: str | None) -> bool:
    """Return whether pictures are code values of a display, whose white is 1, and not light of a scene.

    `colour_space`: as stated in place of what the files say.
    """
    if isinstance(reader, movies.Movie):
        return reader.holds_display_light()
    path = reader.file(reader.numbers[0] if reader.numbers else 0)
    if path is not None:
        return images.holds_display_light(path, colour_space)
    picture = reader.read(0)
    if not isinstance(picture, np.ndarray):
        return False
    return picture.dtype.kind == "u" or float(picture[..., :3].max()) <= 1


def matte_reader(mask: "Picture | None") -> Reader:
    """Return the reader of a matte."""
    return reader_of(mask, images.read_mask, movies.MatteMovie)


def normals_reader(normals: "Normals | None", axes: str | None) -> Reader:
    """Return the reader of normals along `axes`: images, sequences, arrays and networks."""
    if normals is None:
        if axes not in (None, CAMERA):
            raise ValueError("axes: expected normals as well (normals=FILE), whose axes they are")
        return Still(None)
    axes = axes or CAMERA
    if not is_path(normals):
        return Still(normals if axes == CAMERA else normals_module.load(normals, axes=axes), normals)
    if Path(normals).suffix.lower() in NETWORKS:
        return Still(normals if axes == CAMERA else normals_module.load(normals, axes=axes), Path(normals))
    return reader_of(os.fspath(normals), lambda path: images.read_normals(path, axes=axes), _refuse_movie)


def depth_reader(depth: "Picture | os.PathLike | None") -> Reader:
    """Return the reader of depth: images, sequences, arrays, and the path of an ONNX network."""
    if is_path(depth) and Path(depth).suffix.lower() == ".onnx":
        return Still(depth, Path(depth))
    return reader_of(depth, images.read_depth, _refuse_movie)


def read_still(path: Path, read: Callable) -> Still:
    """Read a still, and record the bytes that were read. `path` may name a layer of an OpenEXR file."""
    file, layer = images.split_layer(path)
    if not file.is_file():
        return Still(read(path))  # which says what is wrong
    record = FileRecord.of(file)
    picture = read(path)
    check_unchanged(record)
    return Still(picture, (record.sha256, layer), record)


def check_unchanged(record: FileRecord) -> None:
    """Raise ValueError if a file was changed while it was read."""
    if record.differs():
        raise ValueError(f"{record.path}: was changed while it was read; run the command again")


def _refuse_movie(path: Path) -> Still:
    raise ValueError(f"normals, depth: expected images, got the movie {path}")
