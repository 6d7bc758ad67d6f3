"""Encodings: the primaries and the transfer function that turn code values into linear Rec.709.

Files name them by chromaticities (OpenEXR, PNG, TIFF, BMP), by an exponent (PNG, Exif), or by the code points
of ITU-T H.273 (movies, HEIF, AVIF, PNG's cICP, ICC's cicp). Rec.709 and sRGB need NumPy alone; colour-science
is imported for the rarer transfer functions. It has these primaries and Bradford's matrix too, and a test
compares them; but its import takes a second, which a photograph with a profile must not wait for.
"""

import atexit
import functools
import math
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from shadow.srgb import decode_srgb

Transfer = Callable[[np.ndarray], np.ndarray]  # code values, 1 at white, to linear light
Chromaticities = tuple[float, ...]  # x and y of red, green, blue and white
Neutral = tuple[float, float]  # x and y of what is to be seen as white

D65, D50 = (0.3127, 0.3290), (0.3457, 0.3585)
REC709 = (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, *D65)
REC2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *D65)
P3_D65 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *D65)
ADOBE_RGB = (0.640, 0.330, 0.210, 0.710, 0.150, 0.060, *D65)
AP0 = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)  # ACES2065-1
AP1 = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)  # ACEScg
XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)  # CIE XYZ itself
ADOBE_GAMMA = 563 / 256  # Adobe RGB (1998), section 4.3.4.2
REFERENCE_WHITE = 203.0  # candela per square metre of a white surface in PQ (ITU-R BT.2408): linear 1
# Of BT.709's transfer function, to all digits (ITU-T H.273, table 3): with 1.099 and 0.018 its two parts do
# not meet, and a code of the one would come back as a code of the other.
BT709_ALPHA, BT709_BETA = 1.099296826809442, 0.018053968510807
HLG_WHITE = 0.75  # code value of the same white in HLG (ITU-R BT.2408)
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])

# Code points of ITU-T H.273, table 2. 2 is "unspecified".
PRIMARIES: dict[int, Chromaticities] = {
    1: REC709,
    4: (0.670, 0.330, 0.210, 0.710, 0.140, 0.080, 0.310, 0.316),  # BT.470 M, NTSC 1953
    5: (0.640, 0.330, 0.290, 0.600, 0.150, 0.060, *D65),  # BT.470 BG, PAL
    6: (0.630, 0.340, 0.310, 0.595, 0.155, 0.070, *D65),  # SMPTE 170M, NTSC
    7: (0.630, 0.340, 0.310, 0.595, 0.155, 0.070, *D65),  # SMPTE 240M
    8: (0.681, 0.319, 0.243, 0.692, 0.145, 0.049, 0.310, 0.316),  # film with illuminant C
    9: REC2020,
    10: XYZ,  # SMPTE 428
    11: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.314, 0.351),  # SMPTE 431, DCI-P3
    12: P3_D65,  # SMPTE 432
    22: (0.630, 0.340, 0.295, 0.605, 0.155, 0.077, *D65),  # EBU Tech 3213
}
UNSPECIFIED = 2


@functools.cache
def colour_science() -> ModuleType:
    """Import colour-science."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns that Matplotlib is not installed
        import colour
    # It keeps OpenImageIO objects alive past the end of their module, for which OpenImageIO's bindings print
    # a page of harmless "leaked instance" lines at exit.
    atexit.register(vars(sys.modules["colour.io.image"]).clear)
    return colour


def decode_bt709(codes: np.ndarray) -> np.ndarray:
    """Turn BT.709 code values into the light in front of the camera (ITU-R BT.709-6, item 1.2)."""
    low = 4.5 * BT709_BETA
    high = (np.maximum(codes, low) + (BT709_ALPHA - 1)) / BT709_ALPHA
    return np.where(codes < low, codes / 4.5, high ** (1 / 0.45))


def encode_bt709(light: np.ndarray) -> np.ndarray:
    """Turn light into BT.709 code values (ITU-R BT.709-6, item 1.2)."""
    high = np.maximum(light, BT709_BETA)
    return np.where(light < BT709_BETA, light * 4.5, BT709_ALPHA * high**0.45 - (BT709_ALPHA - 1))


def decode_linear(codes: np.ndarray) -> np.ndarray:
    """Return the code values, which are light already."""
    return codes


@functools.cache
def power(exponent: float) -> Transfer:
    """Return the transfer function code ** exponent, negative codes mirrored; linear for an exponent of 1."""
    if exponent == 1:
        return decode_linear
    return lambda codes: np.sign(codes) * np.abs(codes) ** exponent


def decode_pq(codes: np.ndarray) -> np.ndarray:
    """Turn PQ code values (SMPTE ST 2084) into light, 1 at a white of 203 cd/m²."""
    return colour_science().models.eotf_ST2084(np.clip(codes, 0, 1)) / REFERENCE_WHITE


def decode_hlg(codes: np.ndarray) -> np.ndarray:
    """Turn HLG code values (ITU-R BT.2100) into the light in front of the camera, 1 at a code of 0.75."""
    inverse = colour_science().models.oetf_inverse_BT2100_HLG
    return inverse(np.clip(codes, 0, 1)) / inverse(HLG_WHITE)


def encode_pq(light: np.ndarray) -> np.ndarray:
    """Turn light, 1 at a white of 203 cd/m², into PQ code values (SMPTE ST 2084), up to 10,000 cd/m²."""
    nits = np.clip(light * REFERENCE_WHITE, 0, 10_000)
    return colour_science().models.eotf_inverse_ST2084(nits)


def encode_hlg(light: np.ndarray) -> np.ndarray:
    """Turn light in front of the camera, 1 at a code of 0.75, into HLG code values (ITU-R BT.2100)."""
    models = colour_science().models
    scene = np.clip(light * models.oetf_inverse_BT2100_HLG(HLG_WHITE), 0, 1)
    with np.errstate(invalid="ignore"):  # of the logarithm, which it evaluates for dark light too
        return models.oetf_BT2100_HLG(scene)


def _decode_smpte240m(codes: np.ndarray) -> np.ndarray:
    return colour_science().models.eotf_SMPTE240M(codes)


def _decode_smpte428(codes: np.ndarray) -> np.ndarray:
    return power(2.6)(codes) * (52.37 / 48)  # SMPTE ST 428-1: 48 cd/m² is white, 52.37 the code's maximum


# Code points of ITU-T H.273, table 3. The logarithmic ones (9, 10) and BT.1361 (12) are in no use.
TRANSFERS: dict[int, Transfer] = {
    1: decode_bt709,
    4: power(2.2),
    5: power(2.8),
    6: decode_bt709,
    7: _decode_smpte240m,
    8: decode_linear,
    11: decode_bt709,  # IEC 61966-2-4, xvYCC
    13: decode_srgb,
    14: decode_bt709,
    15: decode_bt709,
    16: decode_pq,
    17: _decode_smpte428,
    18: decode_hlg,
}


@dataclass(frozen=True)
class Encoding:
    """What code values mean."""

    chromaticities: Chromaticities = REC709  # x and y of red, green, blue and white
    transfer: Transfer = decode_linear  # from code values to linear light, 1 at white
    neutral: Neutral | None = None  # x and y of what is to be seen as white, if not that of the primaries

    @classmethod
    def from_code_points(cls, primaries: int, transfer: int, *, unspecified: Transfer) -> "Encoding":
        """Return the encoding of two code points of ITU-T H.273.

        `unspecified` is the transfer function where the code point says that there is none given. ValueError
        for code points that are reserved or have no known meaning.
        """
        if primaries != UNSPECIFIED and primaries not in PRIMARIES:
            raise ValueError(f"has the colour primaries {primaries} of ITU-T H.273; convert it to BT.709's")
        if transfer != UNSPECIFIED and transfer not in TRANSFERS:
            raise ValueError(f"has the transfer function {transfer} of ITU-T H.273; convert it to BT.709's")
        return cls(PRIMARIES.get(primaries, REC709), TRANSFERS.get(transfer, unspecified))

    @property
    def is_linear(self) -> bool:
        """Whether the code values are light."""
        return self.transfer is decode_linear

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) float32 from this encoding's light to Rec.709's, for column vectors."""
        return to_rec709(tuple(map(float, self.chromaticities)), self.neutral)


def rgb_to_xyz(chromaticities: Chromaticities) -> np.ndarray:
    """Return the (3, 3) matrix from linear light of these primaries to CIE XYZ (SMPTE RP 177), white at Y =
    1.

    Raises ValueError for chromaticities that span no colours.
    """
    xy = np.array(chromaticities, np.float64)
    try:
        if xy.shape != (8,) or not np.isfinite(xy).all() or not xy[7]:
            raise ValueError(f"expected eight numbers, got {chromaticities}")
        primaries = np.array([[x, y, 1 - x - y] for x, y in xy[:6].reshape(3, 2)]).T
        return primaries * np.linalg.solve(primaries, xy_to_xyz((xy[6], xy[7])))
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ValueError(f"chromaticities: {chromaticities} span no colours: {error}") from error


def xy_to_xyz(xy: tuple[float, float]) -> np.ndarray:
    """Return CIE XYZ (3,) of a chromaticity, Y = 1. ValueError for a chromaticity that no light has."""
    if not (math.isfinite(xy[0]) and 0 < xy[1] <= 1):
        raise ValueError(f"its white is stated as {xy[0]:g}, {xy[1]:g}; say which colour_space it is")
    return np.array([xy[0] / xy[1], 1, (1 - xy[0] - xy[1]) / xy[1]])


def adaptation(source: tuple[float, float], target: tuple[float, float]) -> np.ndarray:
    """Return the (3, 3) chromatic adaptation of CIE XYZ from one white to another (Bradford)."""
    cones = (BRADFORD @ xy_to_xyz(target)) / (BRADFORD @ xy_to_xyz(source))
    return np.linalg.inv(BRADFORD) @ np.diag(cones) @ BRADFORD


@functools.lru_cache(maxsize=64)
def to_rec709(chromaticities: Chromaticities, neutral: Neutral | None = None) -> np.ndarray:
    """Return (3, 3) float32 from linear light of these primaries to Rec.709's.

    The white of the primaries, or `neutral` where it is given, becomes Rec.709's. CIE XYZ has no white of its
    own: unless there is a `neutral`, nothing is adapted. ValueError as `rgb_to_xyz`.
    """
    given = np.array(chromaticities, np.float64)
    if neutral is None and given.shape == (8,) and np.allclose(given, REC709, atol=2e-3):
        return np.eye(3, dtype=np.float32)
    matrix = rgb_to_xyz(chromaticities)
    if neutral is not None or not np.allclose(given, XYZ, atol=2e-3):
        matrix = adaptation(neutral or (given[6], given[7]), D65) @ matrix
    return (np.linalg.inv(rgb_to_xyz(REC709)) @ matrix).astype(np.float32)
