"""ICC profiles that image files carry: what they make of code values (ICC.1:2022).

A tag `cicp` of PQ or HLG counts first, then a colour table (A2B, D2B), then tone curves and primaries, as
cameras, displays and image editors write them. Little CMS, through Pillow, applies tables; it has 8 bits.
OpenColorIO reads profiles of curves and primaries too, but neither the identity curve, by which linear
pictures say so, nor grey profiles.
"""

import functools
import io
import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageCms

from relight.media.encodings import D50, REC2020, Encoding, adaptation, decode_srgb, rgb_to_xyz

Curve = Callable[[np.ndarray], np.ndarray]
CURVES = {"RGB": ("rTRC", "gTRC", "bTRC"), "GRAY": ("kTRC",) * 3}  # tags, by the profile's colour space
COLORANTS = ("rXYZ", "gXYZ", "bXYZ")
HDR_TRANSFERS = (16, 18)  # PQ and HLG in ITU-T H.273
TABLES = ("A2B0", "A2B1", "A2B2", "D2B0", "D2B1", "D2B2", "D2B3")  # which count before the curves (8.3)
RENDERING_INTENT = 64  # byte of the header
WIDE = Encoding(REC2020, decode_srgb)  # what tables are converted to: it holds the colours of all displays
HEADER = 128  # bytes; the table of tags follows


@dataclass(frozen=True)
class Profile:
    """What turns code values to light."""

    curves: tuple[Curve, Curve, Curve]  # of red, green and blue: from code values to light, both 1 at white
    colorants: np.ndarray | None  # (3, 3), CIE XYZ of R, G, B, adapted to D50, one a row; None if grey
    bounded: bool  # whether a curve is a table, which says nothing of values outside [0, 1]
    # What the tag `cicp` says (ICC.1:2022, 9.2.17), for PQ and HLG alone: their curves and tables in a
    # profile are made for displays that know neither.
    encoding: Encoding | None = None
    table: bytes | None = None  # the profile itself, if a colour table of it counts

    @classmethod
    def parse(cls, data: bytes) -> "Profile":
        """Parse the profile of a picture.

        Raises ValueError if damaged, or not made of curves and primaries.
        """
        try:
            return cls._parsed(data)
        except ValueError as error:
            raise ValueError(f"its colour profile {error}; say which colour_space it is") from error

    @classmethod
    def _parsed(cls, data: bytes) -> "Profile":
        try:
            tags, kind = _tags(data), data[16:20].decode("ascii", "replace").strip()
            if kind not in CURVES:
                raise ValueError(f"is of {kind}, not of RGB")
            encoding = _code_points(tags.get("cicp", b"")) if kind == "RGB" else None
            if encoding is not None:
                return cls((_as_is,) * 3, None, False, encoding)
            if any(name in tags for name in TABLES):
                return cls((_as_is,) * 3, None, True, table=data)
            curves, colorants = [tags[name] for name in CURVES[kind]], None
            if kind == "RGB":
                colorants = np.array([struct.unpack_from(">3i", tags[name], 8) for name in COLORANTS]) / 65536
            red, green, blue = map(_curve, curves)
            bounded = any(tag[:4] == b"curv" and struct.unpack_from(">I", tag, 8)[0] > 1 for tag in curves)
        except KeyError as error:
            raise ValueError("is not made of curves and primaries") from error
        except struct.error as error:
            raise ValueError("is damaged") from error
        return cls((red, green, blue), colorants, bounded)

    def light(self, pixels: np.ndarray) -> np.ndarray:
        """Linear light (H, W, 3), float32, of red, green and blue, of code values (H, W, 3).

        uint8 and uint16 over their full range; floating with 1 as white. Raises ValueError for floats outside
        [0, 1] where a curve is a table.
        """
        channels = np.moveaxis(pixels, -1, 0)
        if np.issubdtype(pixels.dtype, np.integer):  # each code once
            codes = np.arange(np.iinfo(pixels.dtype).max + 1) / np.iinfo(pixels.dtype).max
            tables = [curve(codes).astype(np.float32) for curve in self.curves]
            return np.stack([table[codes] for table, codes in zip(tables, channels, strict=True)], axis=-1)
        if self.bounded and not (pixels.min() >= 0 and pixels.max() <= 1):
            raise ValueError("says nothing of values outside [0, 1], which the picture holds")
        light = [curve(codes) for curve, codes in zip(self.curves, channels, strict=True)]
        return np.stack(light, axis=-1).astype(np.float32)

    def to_wide(self, pixels: np.ndarray) -> np.ndarray:
        """Return code values (H, W, 3) uint8 of this profile's table as those of `WIDE`, uint8.

        Raises ValueError for other dtypes, which Pillow does not hand over, and for a damaged table.
        """
        if pixels.dtype != np.uint8:
            raise ValueError(
                "has a colour table, which is applied to 8 bits alone; convert the picture to sRGB"
            )
        assert self.table is not None
        grey = self.table[16:20] == b"GRAY"
        picture = Image.fromarray(np.ascontiguousarray(pixels[..., 0] if grey else pixels))
        try:
            intent = struct.unpack_from(">I", self.table, RENDERING_INTENT)[0]
            source, wide = (ImageCms.ImageCmsProfile(io.BytesIO(data)) for data in (self.table, _wide()))
            transform = ImageCms.buildTransform(
                source, wide,
                "L" if grey else "RGB", "RGB", ImageCms.Intent(intent if intent <= 3 else 0),
            )  # fmt: skip
            return np.asarray(ImageCms.applyTransform(picture, transform))
        except (ImageCms.PyCMSError, OSError) as error:
            raise ValueError("has a colour table that is damaged; say which colour_space it is") from error


def _as_is(codes: np.ndarray) -> np.ndarray:
    return codes


@functools.cache
def _wide() -> bytes:
    """Return an ICC profile of `WIDE`: sRGB's curve with the primaries of BT.2020."""
    columns = (adaptation((REC2020[6], REC2020[7]), D50) @ rgb_to_xyz(REC2020)).T
    vectors = (np.array([0.9642, 1, 0.8249]), *columns)
    data = [struct.pack(">4s4x3i", b"XYZ ", *(round(x * 65536) for x in vector)) for vector in vectors]
    curve = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)  # g, a, b, c, d of `_parametric`
    data.append(struct.pack(">4s4xH2x5i", b"para", 3, *(round(x * 65536) for x in curve)))
    starts = [HEADER + 4 + 12 * 7 + sum(map(len, data[:index])) for index in range(len(data))]
    places = dict(zip((b"wtpt", b"rXYZ", b"gXYZ", b"bXYZ", b"rTRC"), range(5), strict=True))
    places |= {b"gTRC": 4, b"bTRC": 4}
    tags = b"".join(struct.pack(">4sII", name, starts[at], len(data[at])) for name, at in places.items())
    body = struct.pack(">I", len(places)) + tags + b"".join(data)
    head = struct.pack(">I4xI4s4s4s12x4s", HEADER + len(body), 0x04400000, b"mntr", b"RGB ", b"XYZ ", b"acsp")
    white = struct.pack(">3i", *(round(x * 65536) for x in vectors[0]))  # of the connection space
    return (head.ljust(68, b"\0") + white).ljust(HEADER, b"\0") + body


def _tags(data: bytes) -> dict[str, bytes]:
    """Return the tagged data of a profile, {tag: bytes}."""
    (count,) = struct.unpack_from(">I", data, HEADER)
    entries = (
        struct.unpack_from(">4sII", data, HEADER + 4 + 12 * index) for index in range(min(count, 1024))
    )
    return {name.decode("latin-1"): data[start : start + size] for name, start, size in entries}


def _code_points(tag: bytes) -> Encoding | None:
    """Return the encoding of a tag `cicp` of PQ or HLG, full-range RGB; None for another."""
    if len(tag) < 12 or tag[9] not in HDR_TRANSFERS or tag[10] != 0 or tag[11] != 1:
        return None
    return Encoding.from_code_points(tag[8], tag[9], unspecified=decode_srgb)


def _curve(tag: bytes) -> Curve:
    """Return a tone curve: a table, a power, or a parametric curve."""
    if tag[:4] == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        if count > 1:
            values = np.array(struct.unpack_from(f">{count}H", tag, 12)) / 65535
            return lambda codes: np.interp(codes, np.linspace(0, 1, count), values)
        exponent = struct.unpack_from(">H", tag, 12)[0] / 256 if count else 1.0
        return _parametric(exponent, 1, 0, 0, 0, 0, 0)
    if tag[:4] != b"para":
        raise ValueError("has a tone curve of an unknown kind")
    (function,) = struct.unpack_from(">H", tag, 8)
    if function > 4:
        raise ValueError("has a tone curve of an unknown kind")
    g, *more = (value / 65536 for value in struct.unpack_from(f">{(1, 3, 4, 5, 7)[function]}i", tag, 12))
    if function == 0:
        return _parametric(g, 1, 0, 0, 0, 0, 0)
    if function in (1, 2):
        a, b, *constant = more
        c = constant[0] if constant else 0.0
        return _parametric(g, a, b, 0, -b / a if a else 0.0, c, c)
    return _parametric(g, *more, *(0.0,) * (6 - len(more)))


def _parametric(g: float, a: float, b: float, c: float, d: float, e: float, f: float) -> Curve:
    """Return (a x + b)^g + e from d, c x + f below it (ICC.1:2022, 10.18, the last of the five functions)."""
    if g == a == 1 and b == e == 0:
        return lambda codes: codes
    return lambda codes: np.where(codes >= d, np.maximum(a * codes + b, 0) ** g + e, c * codes + f)
