"""Fields of a TIFF that OpenImageIO leaves out or writes wrongly: colour, keywords, sensitivity, lens."""

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, NamedTuple

# Types of fields (TIFF 6.0, section 2; the last one is BigTIFF's)
BYTE, SHORT, LONG, RATIONAL, SRATIONAL, LONG8 = 1, 3, 4, 5, 10, 16
EXIF = 34665  # the field that holds where Exif's directory is


class Field(NamedTuple):
    """A field's type, how many values it has, and their bytes in the file's byte order."""

    kind: int
    values: int
    data: bytes


class _Layout(NamedTuple):
    """What a TIFF's first bytes say: byte order, formats of lengths and offsets, where the first one is."""

    order: str
    length: str
    offset: str
    start: int


def byte_order(path: Path) -> str:
    """Return the byte order of a TIFF, as `struct` writes it."""
    with path.open("rb") as file:
        return _layout(file).order


def add_fields(path: Path, fields: Mapping[int, Field], exif: Mapping[int, Field]) -> None:
    """Add fields to a TIFF's first directory, and to its directory of Exif; fields that it has are replaced.

    Both directories are written again, at the end of the file. The data that they point to are not moved.
    """
    with path.open("r+b") as file:
        layout, fields = _layout(file), dict(fields)
        file.seek(layout.start)
        (first,) = _read(file, layout.order + layout.offset)
        if exif:
            below = _directory(file, layout, first)[0].get(EXIF)
            at = 0 if below is None else struct.unpack_from(layout.order + layout.offset, below[1])[0]
            place = struct.pack(layout.order + layout.offset, _append(file, layout, at, exif))
            fields[EXIF] = Field(LONG8 if layout.offset == "Q" else LONG, 1, place)
        place = struct.pack(layout.order + layout.offset, _append(file, layout, first, fields))
        file.seek(layout.start)
        file.write(place)


def _layout(file: BinaryIO) -> _Layout:
    order = {b"II": "<", b"MM": ">"}[file.read(2)]
    big = _read(file, order + "H") == (43,)  # BigTIFF, whose counts and offsets have 8 bytes
    return _Layout(order, "Q", "Q", 8) if big else _Layout(order, "H", "I", 4)


def _read(file: BinaryIO, layout: str) -> tuple[int, ...]:
    return struct.unpack(layout, file.read(struct.calcsize(layout)))


def _directory(file: BinaryIO, layout: _Layout, at: int) -> tuple[dict[int, tuple[bytes, bytes]], bytes]:
    """Return a directory's entries, {tag: (type and count, value or its offset)}, and the next one's offset.

    An offset of 0 is an empty directory.
    """
    size = struct.calcsize(layout.order + layout.offset)
    entries: dict[int, tuple[bytes, bytes]] = {}
    if not at:
        return entries, bytes(size)
    file.seek(at)
    (count,) = _read(file, layout.order + layout.length)
    for _ in range(count):
        (tag,) = _read(file, layout.order + "H")
        entries[tag] = file.read(2 + size), file.read(size)
    return entries, file.read(size)


def _append(file: BinaryIO, layout: _Layout, at: int, fields: Mapping[int, Field]) -> int:
    """Write the directory at an offset, with other fields, to the end of the file; return its offset."""
    entries, following = _directory(file, layout, at)
    size = len(following)
    for tag, field in fields.items():
        head = struct.pack(layout.order + "H" + layout.offset, field.kind, field.values)
        value = field.data.ljust(size, b"\0")
        if len(value) > size:
            value = struct.pack(layout.order + layout.offset, _end(file))
            file.write(field.data)
        entries[tag] = head, value
    place = _end(file)
    file.write(struct.pack(layout.order + layout.length, len(entries)))
    for tag, entry in sorted(entries.items()):
        file.write(struct.pack(layout.order + "H", tag) + b"".join(entry))
    file.write(following)
    return place


def _end(file: BinaryIO) -> int:
    """Go to the end of the file, at a whole word; return where that is."""
    end = file.seek(0, 2)
    file.write(bytes(end % 2))
    return end + end % 2
