"""Boxes of files, and what those of HEIF and AVIF (ISO/IEC 23008-12) say of the primary item.

`colr` are its code points, `clap` is its clean aperture.
"""

import math
import struct
from collections.abc import Iterator
from fractions import Fraction

HEADER = 1 << 20  # bytes at a file's start in which the properties are looked for


def read_code_points(data: bytes) -> tuple[int, int] | None:
    """Return (colour primaries, transfer characteristics) of ITU-T H.273, None where there are none.

    `data` is the file, or its start. Damaged boxes have none.
    """
    for kind, body in _properties(data):
        if kind == "colr" and body[:4] == b"nclx" and len(body) >= 8:
            return struct.unpack(">HH", body[4:8])
    return None


def read_clean_aperture(data: bytes, height: int, width: int) -> tuple[slice, slice]:
    """Return the rows and columns of the primary item that its `clap` shows; all of them where it has none.

    `data` is the file, or its start; the picture's size is that before it is turned. Raises ValueError for an
    aperture that does not lie in the picture.
    """
    for kind, body in _properties(data):
        if kind != "clap":
            continue
        try:
            numbers = struct.unpack(">IIIIiIiI", body[:32])
            across, down, right, below = (
                Fraction(*numbers[index : index + 2]) for index in range(0, 8, 2)
            )  # width, height, and how far its middle lies from the picture's
        except (struct.error, ZeroDivisionError) as error:
            raise ValueError("is damaged: its clean aperture (clap) is none") from error
        left, top = math.ceil((width - across) / 2 + right), math.ceil((height - down) / 2 + below)
        rows, columns = slice(top, top + math.floor(down)), slice(left, left + math.floor(across))
        if not (0 <= top < rows.stop <= height and 0 <= left < columns.stop <= width):
            raise ValueError("is damaged: its clean aperture (clap) does not lie in the picture")
        return rows, columns
    return slice(0, height), slice(0, width)


def _properties(data: bytes) -> list[tuple[str, bytes]]:
    """Return the properties of the primary item: type and content. Damaged boxes have none."""
    try:
        meta = next(body for kind, body in boxes(data) if kind == "meta")[4:]
        parts = dict(boxes(meta))
        properties = list(boxes(parts["iprp"]))
        item = parts["pitm"]
        primary = struct.unpack_from(">I" if item[0] else ">H", item, 4)[0]
        wanted = {
            index for kind, body in properties if kind == "ipma" for index in _associated(body, primary)
        }
        return [each for index, each in enumerate(boxes(dict(properties)["ipco"]), 1) if index in wanted]
    except (KeyError, StopIteration, struct.error, IndexError):
        return []


def boxes(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield the boxes in some data: type and content."""
    start = 0
    while start + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, start)
        head = 8
        if size == 1:
            (size,), head = struct.unpack_from(">Q", data, start + 8), 16
        size = size or len(data) - start
        if size < head:
            return
        yield kind.decode("latin-1"), data[start + head : start + size]
        start += size


def _associated(body: bytes, item: int) -> list[int]:
    """Return the numbers of an item's properties."""
    version, wide = body[0], body[3] & 1
    (count,), at = struct.unpack_from(">I", body, 4), 8
    for _ in range(count):
        (number,) = struct.unpack_from(">I" if version else ">H", body, at)
        at += 4 if version else 2
        entries, at = body[at], at + 1
        indices = []
        for _ in range(entries):
            (index,) = struct.unpack_from(">H" if wide else ">B", body, at)
            indices.append(index & (0x7FFF if wide else 0x7F))
            at += 2 if wide else 1
        if number == item:
            return indices
    return []
