"""Boxes of files, and the code points of HEIF and AVIF (ISO/IEC 23008-12): `colr` of the primary item."""

import struct
from collections.abc import Iterator

HEADER = 1 << 20  # bytes at a file's start in which the properties are looked for


def read_code_points(data: bytes) -> tuple[int, int] | None:
    """Return (colour primaries, transfer characteristics) of ITU-T H.273, None where there are none.

    `data` is the file, or its start. Damaged boxes have none.
    """
    try:
        meta = next(body for kind, body in boxes(data) if kind == "meta")[4:]
        parts = dict(boxes(meta))
        properties = list(boxes(parts["iprp"]))
        colours = [
            (index, body)
            for index, (kind, body) in enumerate(boxes(dict(properties)["ipco"]), 1)
            if kind == "colr" and body[:4] == b"nclx"
        ]
        item = parts["pitm"]
        primary = struct.unpack_from(">I" if item[0] else ">H", item, 4)[0]
        wanted = {
            index for kind, body in properties if kind == "ipma" for index in _associated(body, primary)
        }
        body = next(body for index, body in colours if index in wanted)
        return struct.unpack(">HH", body[4:8])
    except (KeyError, StopIteration, struct.error, IndexError):
        return None


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
