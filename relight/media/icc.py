"""ICC profiles that image files carry: what their tone curves and primaries make of code values.

Profiles of curves and primaries, as cameras, displays and image editors write them (ICC.1:2022). OpenColorIO
reads these too, but neither the identity curve, by which linear pictures say so, nor grey profiles.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from relight.media.encodings import Encoding, decode_srgb

Curve = Callable[[np.ndarray], np.ndarray]
CURVES = {"RGB": ("rTRC", "gTRC", "bTRC"), "GRAY": ("kTRC",) * 3}  # tags, by the profile's colour space
COLORANTS = ("rXYZ", "gXYZ", "bXYZ")
HDR_TRANSFERS = (16, 18)  # PQ and HLG in ITU-T H.273
HEADER = 128  # bytes; the table of tags follows


@dataclass(frozen=True)
class Profile:
    """What turns code values to light."""

    curves: tuple[Curve, Curve, Curve]  # of red, green and blue: from code values to light, both 1 at white
    colorants: np.ndarray | None  # (3, 3), CIE XYZ of R, G, B, adapted to D50, one a row; None if grey
    bounded: bool  # whether a curve is a table, which says nothing of values outside [0, 1]
    # What the tag `cicp` says (ICC.1:2022, 9.2.17), for PQ and HLG alone: their curves in a profile are made
    # for displays that know neither.
    encoding: Encoding | None = None

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
            curves, colorants = [tags[name] for name in CURVES[kind]], None
            if kind == "RGB":
                colorants = np.array([struct.unpack_from(">3i", tags[name], 8) for name in COLORANTS]) / 65536
            red, green, blue = map(_curve, curves)
            bounded = any(tag[:4] == b"curv" and struct.unpack_from(">I", tag, 8)[0] > 1 for tag in curves)
        except KeyError as error:
            raise ValueError("is not made of curves and primaries") from error
        except struct.error as error:
            raise ValueError("is damaged") from error
        return cls((red, green, blue), colorants, bounded, _code_points(tags.get("cicp", b"")))

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


def _tags(data: bytes) -> dict[str, bytes]:
    """Return the tagged data of a profile, {tag: bytes}."""
    (count,) = struct.unpack_from(">I", data, HEADER)
    entries = (
        struct.unpack_from(">4sII", data, HEADER + 4 + 12 * index) for index in range(min(count, 1024))
    )
    return {name.decode("latin-1"): data[start : start + size] for name, start, size in entries}


def _code_points(tag: bytes) -> Encoding | None:
    """Return the encoding of a tag `cicp` of PQ or HLG."""
    if len(tag) < 12 or tag[9] not in HDR_TRANSFERS:
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
