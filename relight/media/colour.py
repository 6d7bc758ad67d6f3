"""Colour: to linear Rec.709, the working space, and from it to a display; the colour of a temperature.

Names of colour spaces are those of OpenColorIO's built-in configuration, "sRGB", "lin_rec709", "ACEScg",
"lin_rec2020"..., and of the configuration that the environment variable OCIO names, if it is set.
"""

import atexit
import functools
import math
import os
import sys
import warnings
from collections.abc import Callable

import numpy as np
import OpenImageIO as oiio
from numpy.typing import ArrayLike

from relight.media.buffers import to_array, to_buffer
from relight.media.profiles import Profile

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # colour-science warns at import that Matplotlib is not installed
    import colour

# colour-science keeps OpenImageIO objects alive past the end of their module, for which its bindings print a
# page of harmless "leaked instance" lines at exit.
atexit.register(vars(sys.modules["colour.io.image"]).clear)

# A name; the chromaticities of linear light; or an ICC profile.
Space = str | tuple[float, ...] | Profile
LINEAR = "lin_rec709"
SRGB = "sRGB"
ALIASES = {"rec.709": LINEAR, "rec.2020": "lin_rec2020", "rec2020": "lin_rec2020"}  # linear, as in the field
BUILT_IN = "ocio://default"  # whatever $OCIO says: reading a PNG must not depend on it
INTERCHANGE = "aces_interchange"  # the role by which configurations understand each other: ACES2065-1
D50 = (0.3457, 0.3585)  # the white of ICC profiles
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # chromaticities of R, G, B and white
LOCI = {"planckian": (1000.0, 40000.0), "daylight": (4000.0, 25000.0)}  # kelvin; CIE 015 for daylight
ROWS = 64  # at a time: colour-science works in float64
KNEE = 0.6  # light that a display shows as it is, however bright the rest


@functools.cache
def _config(path: str) -> oiio.ColorConfig:
    """An OpenColorIO configuration; ValueError if there is none at `path`."""
    config = oiio.ColorConfig(path)
    if config.geterror():
        raise ValueError(f"OCIO: cannot read the configuration {path!r}")
    return config


def _find(space: str) -> tuple[str, str]:
    """(configuration's path, name in it) of a colour space, the built-in configuration first."""
    wanted = ALIASES.get(str(space).lower(), str(space))
    for path in filter(None, (BUILT_IN, os.environ.get("OCIO"))):
        name = _config(path).resolve(wanted)
        if _config(path).getColorSpaceIndex(name) >= 0:
            return path, name
    known = ", ".join(_config(BUILT_IN).getColorSpaceNames())
    raise ValueError(f"colour_space: unknown {space!r}, expected {SRGB!r}, {LINEAR!r} or one of: {known}")


def resolve(space: str) -> str:
    """The canonical name of a colour space, so that aliases compare equal; ValueError if it is unknown."""
    return _find(space)[1]


def _convert(pixels: np.ndarray, source: str, target: str, path: str) -> np.ndarray:
    """(H, W, 3) float32 from one space of a configuration to another."""
    converted = oiio.ImageBufAlgo.colorconvert(
        to_buffer(pixels), source, target, unpremult=False, colorconfig=path
    )
    if converted.has_error:
        raise ValueError(f"colour_space: cannot convert from {source!r}: {converted.geterror()}")
    return to_array(converted)


@functools.cache
def _srgb_table(dtype: np.dtype) -> np.ndarray:
    """Linear value of every code of an integer dtype: exact, and faster than computing each pixel."""
    codes = np.arange(np.iinfo(dtype).max + 1) / np.iinfo(dtype).max
    return colour.models.eotf_sRGB(codes).astype(np.float32)


def decode(pixels: np.ndarray, space: Space) -> np.ndarray:
    """Pixels of a colour space to linear Rec.709.

    Parameters
    ----------
    pixels: (H, W, 3), uint8 or uint16 over their full range, or floating with 1 as the encoding's white.
    space: name of the colour space that `pixels` are in; or the chromaticities of linear light, x and y of
        red, green, blue and white, as an OpenEXR file has them; or an ICC profile.

    Returns
    -------
    (H, W, 3) float32. Nothing is clipped.

    Raises
    ------
    ValueError: the name is unknown, the chromaticities span no colours, or the profile says nothing of
    such values.
    """
    if isinstance(space, Profile):
        return _through_profile(pixels, space)
    if not isinstance(space, str):
        return np.asarray(pixels, np.float32) @ _to_rec709(tuple(space)).T
    path, space = _find(space)
    if space == resolve(SRGB) and pixels.dtype in (np.uint8, np.uint16):
        return _srgb_table(pixels.dtype)[pixels]
    if np.issubdtype(pixels.dtype, np.integer):
        pixels = pixels / np.float32(np.iinfo(pixels.dtype).max)
    pixels = np.ascontiguousarray(pixels, np.float32)
    if space == resolve(LINEAR):
        return pixels
    if space == resolve(SRGB):
        return _by_rows(colour.models.eotf_sRGB, pixels)
    if path == BUILT_IN:
        return _convert(pixels, space, LINEAR, path)
    return _convert(_convert(pixels, space, INTERCHANGE, path), "ACES2065-1", LINEAR, BUILT_IN)


def _through_profile(pixels: np.ndarray, profile: Profile) -> np.ndarray:
    """Pixels of an ICC profile's space to linear Rec.709; of a profile that is sRGB's, exactly as sRGB."""
    codes = np.linspace(0, 1, 18, dtype=np.float32)[:, None].repeat(3, axis=1)
    probe = np.concatenate([np.eye(3, dtype=np.float32), codes])[None]
    if np.allclose(_from_profile(probe, profile), decode(probe, SRGB), atol=1e-3):  # a quarter of a code
        return decode(pixels, SRGB)
    return _from_profile(pixels, profile)


def _from_profile(pixels: np.ndarray, profile: Profile) -> np.ndarray:
    light = profile.light(pixels)
    if profile.colorants is None:
        return light
    rec709 = colour.RGB_COLOURSPACES["ITU-R BT.709"]
    whites = colour.xy_to_XYZ(D50), colour.xy_to_XYZ(rec709.whitepoint)
    adapted = colour.adaptation.matrix_chromatic_adaptation_VonKries(*whites, transform="Bradford")
    return light @ (rec709.matrix_XYZ_to_RGB @ adapted @ profile.colorants.T).T.astype(np.float32)


@functools.cache
def _to_rec709(chromaticities: tuple[float, ...]) -> np.ndarray:
    """(3, 3) float32 from linear light of these primaries and white, adapted by Bradford, as OpenEXR does."""
    x_y = np.array(chromaticities, np.float64)
    if x_y.shape == (8,) and np.allclose(x_y, REC709, atol=2e-3):
        return np.eye(3, dtype=np.float32)
    try:
        if x_y.shape != (8,) or not np.isfinite(x_y).all() or not x_y[7]:
            raise ValueError(f"expected eight numbers, got {chromaticities}")
        space = colour.RGB_Colourspace("file", x_y[:6].reshape(3, 2), x_y[6:])
        return colour.matrix_RGB_to_RGB(space, "ITU-R BT.709", "Bradford").astype(np.float32)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ValueError(f"chromaticities: {chromaticities} span no colours: {error}") from error


def _by_rows(function: Callable[[np.ndarray], np.ndarray], pixels: np.ndarray) -> np.ndarray:
    """A function of colour-science on (H, W, 3), a few rows at a time: it needs much memory. Float32."""
    result = np.empty(pixels.shape, np.float32)
    for row in range(0, len(pixels), ROWS):
        result[row : row + ROWS] = function(pixels[row : row + ROWS])
    return result


def encode(
    rgb: np.ndarray, *, view: str | None = None, exposure: float = 0.0, white: float | None = None
) -> np.ndarray:
    """Linear Rec.709 to a display's encoding: (H, W, 3) float32 to (H, W, 3) float32 in [0, 1].

    Parameters
    ----------
    rgb: scene-linear light, unbounded.
    view: name of a view transform of the default display of OpenColorIO's built-in configuration or $OCIO's,
        or a part of it that no other has, e.g. "aces". None encodes for an sRGB display (IEC 61966-2.1).
    exposure: stops, in [-64, 64]; doubles the light for each.
    white: for sRGB, the exposed light >= 1 that becomes the display's white; None: the brightest there is.

    Light up to 1 comes out exact if there is none above `white` = 1. Else what is above 0.6 is compressed, by
    channel and as little as brings `white` to the display's white (Reinhard et al. 2002, equation 4, above a
    knee), so that highlights roll off and keep their shapes. A sequence of pictures wants one `white`.

    Raises
    ------
    ValueError: no such view, exposure or white out of range, $OCIO that cannot be used.
    """
    if not -64 <= exposure <= 64:
        raise ValueError(f"exposure: expected -64 to 64 stops, got {exposure:g}")
    gain = np.float32(2.0**exposure)
    if view is not None:
        return _through_view(rgb * gain, view)
    white = max(1.0, float(rgb.max(initial=0)) * float(gain)) if white is None else white
    if not 1 <= white < math.inf:
        raise ValueError(f"white: expected a finite number >= 1, got {white:g}")
    return _by_rows(
        lambda rows: colour.models.eotf_inverse_sRGB(np.clip(_roll_off(rows * gain, white), 0, 1)), rgb
    )


def _roll_off(rgb: np.ndarray, white: float) -> np.ndarray:
    """Compress light above the knee so that `white` becomes 1: the identity where `white` is 1."""
    if white == 1:
        return rgb
    above = (rgb - KNEE).clip(0) / (1 - KNEE)
    top = (white - KNEE) / (1 - KNEE)
    return np.minimum(rgb, KNEE) + (1 - KNEE) * above * (1 + above / top**2) / (1 + above)


def find_view(view: str) -> tuple[str, str, str]:
    """(configuration's path, display, view) of a view that `view` names in part; ValueError if none does.

    The configuration is $OCIO's if that is set, else the built-in one; the display is its default.
    """
    path = os.environ.get("OCIO") or BUILT_IN
    display = _config(path).getDefaultDisplayName()
    views = _config(path).getViewNames(display)
    matches = [name for name in views if name == view] or [
        name for name in views if str(view).lower() in name.lower()
    ]
    if len(matches) != 1:
        raise ValueError(f"view: expected one of {', '.join(views)}, got {view!r}")
    return path, display, matches[0]


def _through_view(rgb: np.ndarray, view: str) -> np.ndarray:
    """(H, W, 3) linear Rec.709 through a view transform, clipped to the display's [0, 1]."""
    path, display, view = find_view(view)
    config, source = _config(path), LINEAR
    if config.getColorSpaceIndex(config.resolve(LINEAR)) < 0:
        rgb, source = _convert(rgb, LINEAR, "ACES2065-1", BUILT_IN), INTERCHANGE
    shown = oiio.ImageBufAlgo.ociodisplay(
        to_buffer(rgb), display, view, fromspace=source,
        unpremult=False, colorconfig=path,
    )  # fmt: skip
    if shown.has_error:
        raise ValueError(f"view: cannot show {view!r} on {display!r}: {shown.geterror()}")
    return to_array(shown).clip(0, 1)


@functools.cache
def temperature(kelvin: float, locus: str = "planckian") -> tuple[float, float, float]:
    """Linear Rec.709 colour (three floats) of a colour temperature, scaled to luminance 1, as UsdLux does.

    Parameters
    ----------
    kelvin: correlated colour temperature, in the range that `LOCI` gives for the locus, else ValueError.
    locus: "planckian", a black body: Planck's law through the CIE 1931 2 degree observer. Or "daylight": the
        CIE daylight locus (CIE 015, method of Judd et al. 1964), on which 6504 K is D65, Rec.709's white.

    Candle light is redder than Rec.709 can hold and loses its negative blue.
    """
    low, high = LOCI[locus]
    if not low <= kelvin <= high:
        raise ValueError(f"temperature: expected {low:g} to {high:g} kelvin on this locus, got {kelvin:g}")
    if locus == "daylight":
        tristimulus = colour.xy_to_XYZ(colour.temperature.CCT_to_xy_CIE_D(kelvin))
    else:
        tristimulus = colour.sd_to_XYZ(colour.sd_blackbody(kelvin))
    rgb = np.maximum(colour.XYZ_to_RGB(tristimulus / tristimulus[1], "ITU-R BT.709"), 0)
    return tuple((rgb / luminance(rgb)).tolist())


def luminance_weights(chromaticities: tuple[float, ...] | None = None) -> np.ndarray:
    """Luminance (3,) of red, green and blue of these primaries and white, Rec.709's unless given."""
    x_y = np.array(REC709 if chromaticities is None else chromaticities, np.float64)
    return colour.RGB_Colourspace("file", x_y[:6].reshape(3, 2), x_y[6:]).matrix_RGB_to_XYZ[1]


def luminance(rgb: ArrayLike) -> np.ndarray:
    """Luminance Y (...) of linear Rec.709 colours (..., 3); white has 1."""
    return rgb @ colour.RGB_COLOURSPACES["ITU-R BT.709"].matrix_RGB_to_XYZ[1]
