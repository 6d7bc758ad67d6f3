"""What the boxes of a JPEG 2000 file say (ISO/IEC 15444-1, Annex I) that OpenImageIO does not pass on."""

import functools
import struct
from pathlib import Path
from typing import NamedTuple

from relight.media.colour import SRGB
from relight.media.encodings import Encoding, decode_srgb
from relight.media.images.containers.isobmff import HEADER, boxes
from shadow.files import file_version

ENUMERATED, RESTRICTED_PROFILE, ANY_PROFILE, CODE_POINTS = 1, 2, 3, 5  # methods of `colr`
SRGB_SPACES = 16, 17, 18  # sRGB, its grey, and sYCC, which OpenImageIO makes red, green and blue
PREMULTIPLIED = 2  # type of a channel in `cdef`


class Jpeg2000Header(NamedTuple):
    """The statements of a file's header.

    colour: the box of its colour space, None without one. is_premultiplied: whether colours are multiplied by
    alpha. aspect: width of a pixel over its height.
    """

    colour: bytes | None = None
    is_premultiplied: bool = False
    aspect: float = 1.0


def jpeg2000_header(path: Path) -> Jpeg2000Header:
    """Read the header of a JPEG 2000 file, once while it stays. A codestream without boxes says nothing."""
    return _header(path, file_version(path))


@functools.lru_cache(maxsize=1)
def _header(path: Path, version: tuple[int, ...]) -> Jpeg2000Header:
    """Read a header; `version` tells the cache when the file has been written again."""
    with path.open("rb") as file:
        content = dict(boxes(file.read(HEADER))).get("jp2h", b"")
    header = Jpeg2000Header()
    try:
        for kind, body in boxes(content):
            if kind == "colr" and header.colour is None:  # the first one counts (I.5.3.3)
                header = header._replace(colour=body)
            elif kind == "cdef":
                (count,) = struct.unpack_from(">H", body)
                kinds = struct.unpack_from(f">{3 * count}H", body, 2)[1::3]
                header = header._replace(is_premultiplied=PREMULTIPLIED in kinds)
            elif kind == "res ":
                header = header._replace(aspect=_aspect(next(boxes(body))[1]))
    except (StopIteration, struct.error) as error:
        raise ValueError("is damaged: a box of its header is too short") from error
    return header


def jpeg2000_space(path: Path) -> Encoding | bytes | str | None:
    """Return the colour space that a JPEG 2000 file states, bytes for an ICC profile; None for nothing known.

    Raises ValueError for a colour space that is not read.
    """
    body = jpeg2000_header(path).colour
    try:
        return None if not body else _space(body)
    except struct.error as error:
        raise ValueError("is damaged: the box of its colour space is too short") from error


def _space(body: bytes) -> Encoding | bytes | str | None:
    """Return the colour space of a box `colr`; None for a method of some vendor."""
    method = body[0]
    if method in (RESTRICTED_PROFILE, ANY_PROFILE):
        return body[3:]
    if method == ENUMERATED:
        (number,) = struct.unpack_from(">I", body, 3)
        if number not in SRGB_SPACES:
            raise ValueError(
                f"states the colour space {number} of JPEG 2000, expected sRGB, grey or sYCC; say which "
                "colour_space it is, or convert it"
            )
        return SRGB
    if method == CODE_POINTS:
        primaries, transfer, matrix, full = struct.unpack_from(">3HB", body, 3)
        if matrix != 0 or not full & 0x80:
            raise ValueError(
                f"states matrix {matrix} and range {full >> 7}; expected red, green and blue of full range "
                "(0 and 1)"
            )
        return Encoding.from_code_points(primaries, transfer, unspecified=decode_srgb)
    return None


def _aspect(body: bytes) -> float:
    """Return a pixel's width over its height, by points a metre: fractions, and exponents of 10."""
    rows, rows_below, columns, columns_below, row_power, column_power = struct.unpack_from(">4H2b", body)
    if not (rows and rows_below and columns and columns_below):
        return 1.0
    return rows / rows_below / (columns / columns_below) * 10.0 ** (row_power - column_power)
