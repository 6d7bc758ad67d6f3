"""Colour: to linear Rec.709, the working space, and from it to a display; the colour of a temperature.

Names of colour spaces are those of OpenColorIO's built-in configuration, "sRGB", "lin_rec709", "ACEScg",
"lin_rec2020"...; of the configuration that the environment variable OCIO names, if it is set; and of
OpenColorIO's studio configuration, `ocio://studio-config-latest`, which knows the cameras' logarithmic
spaces.

colour-science takes most of a second to import, so it is imported where a conversion needs it.
"""

import functools
import math
import os
from collections.abc import Callable
from typing import TypedDict

import numpy as np
import OpenImageIO as oiio
from numpy.typing import ArrayLike

from relight.media import encodings
from relight.media.buffers import to_array, to_buffer
from relight.media.encodings import (
    D50,
    D65,
    REC709,
    Encoding,
    Transfer,
    colour_science,
    decode_srgb,
    rgb_to_xyz,
)
from relight.media.icc import WIDE, Profile
from shadow.srgb import encode_srgb

# A name; the chromaticities of linear light; what a file says; or an ICC profile.
Space = str | tuple[float, ...] | Encoding | Profile
LINEAR = "lin_rec709"
SRGB = "sRGB"
ALIASES = {"rec.709": LINEAR, "rec.2020": "lin_rec2020", "rec2020": "lin_rec2020"}  # linear, as in the field
BUILT_IN = "ocio://default"  # whatever $OCIO says: reading a PNG must not depend on it
STUDIO = "ocio://studio-config-latest"
INTERCHANGE = "aces_interchange"  # the role by which configurations understand each other: ACES2065-1
LINEAR_SPACES = {  # names of the Color Interop Forum
    "lin_rec709_scene": REC709,
    "lin_ap1_scene": encodings.AP1,
    "lin_ap0_scene": encodings.AP0,
    "lin_rec2020_scene": encodings.REC2020,
    "lin_p3d65_scene": encodings.P3_D65,
    "lin_adobergb_scene": encodings.ADOBE_RGB,
}
LOCI = {"planckian": (1000.0, 40000.0), "daylight": (4000.0, 25000.0)}  # kelvin; CIE 015 for daylight
ROWS = 64  # at a time: transfer functions work in float64
DISPLAY_WHITE = 1.01  # light, with the rounding of profiles
KNEE = 0.6  # light that a display shows as it is, however bright the rest


@functools.cache
def _config(path: str) -> oiio.ColorConfig:
    """Return an OpenColorIO configuration. Raises ValueError if there is none at `path`."""
    config = oiio.ColorConfig(path)
    if config.geterror():
        raise ValueError(f"OCIO: cannot read the configuration {path!r}")
    return config


def _find(space: str) -> tuple[str, str]:
    """Return (configuration path, name in it) of a colour space; the built-in one is searched first."""
    wanted = ALIASES.get(str(space).lower(), str(space))
    for path in filter(None, (BUILT_IN, os.environ.get("OCIO"), STUDIO)):
        name = _config(path).resolve(wanted)
        if _config(path).getColorSpaceIndex(name) >= 0:
            return path, name
    alike = [
        name for name in _config(STUDIO).getColorSpaceNames() if wanted and wanted.lower() in name.lower()
    ]
    if alike:
        raise ValueError(f"colour_space: unknown {space!r}, expected a whole name: {', '.join(alike)}")
    known = ", ".join(_config(BUILT_IN).getColorSpaceNames())
    raise ValueError(
        f"colour_space: unknown {space!r}, expected {SRGB!r}, {LINEAR!r}, one of: {known}; one of {STUDIO}, "
        "such as 'ARRI LogC4'; or one of the configuration that the environment variable OCIO names"
    )


def resolve(space: str) -> str:
    """Return the canonical name of a colour space, so that aliases compare equal.

    Raises ValueError if it is unknown.
    """
    return _find(space)[1]


def _convert(pixels: np.ndarray, source: str, target: str, path: str) -> np.ndarray:
    """Convert pixels (H, W, 3), float32, from one space of a configuration to another."""
    converted = oiio.ImageBufAlgo.colorconvert(
        to_buffer(pixels), source, target, unpremult=False, colorconfig=path
    )
    if converted.has_error:
        raise ValueError(f"colour_space: cannot convert from {source!r}: {converted.geterror()}")
    return to_array(converted)


def decode(pixels: np.ndarray, space: Space) -> np.ndarray:
    """Convert pixels of a colour space to linear Rec.709: (H, W, 3) float32, unclipped.

    `pixels`: (H, W, 3), uint8 or uint16 over their full range, or floating with 1 as the encoding's white.
    `space`: its name; the chromaticities of linear light, x and y of red, green, blue and white; an Encoding;
    or an ICC profile. Raises ValueError if the name is unknown, the chromaticities span no colours, or the
    profile says nothing of such values.
    """
    if isinstance(space, Profile):
        return _through_profile(pixels, space)
    if isinstance(space, tuple):
        space = Encoding(space)
    if isinstance(space, Encoding):
        return _through_encoding(pixels, space)
    path, space = _find(space)
    if space == resolve(SRGB) and pixels.dtype in (np.uint8, np.uint16):
        return _table(decode_srgb, pixels.dtype)[pixels]
    if np.issubdtype(pixels.dtype, np.integer):
        pixels = pixels / np.float32(np.iinfo(pixels.dtype).max)
    pixels = np.ascontiguousarray(pixels, np.float32)
    if space == resolve(LINEAR):
        return pixels
    if space == resolve(SRGB):
        return _by_rows(lambda rows: decode_srgb(rows.astype(np.float64)), pixels)
    if path == BUILT_IN:
        return _convert(pixels, space, LINEAR, path)
    if _config(path).getColorSpaceNameByRole(INTERCHANGE) is None:
        raise ValueError(
            f"colour_space: {space!r} is of the configuration {path}, which has no role {INTERCHANGE}, by "
            f"which it would convert to another; add `{INTERCHANGE}: NAME` to its roles, NAME its space of "
            "ACES2065-1"
        )
    return _convert(_convert(pixels, space, INTERCHANGE, path), "ACES2065-1", LINEAR, BUILT_IN)


def is_display_light(space: Space) -> bool:
    """Return whether the white code of a space is the light of a display's white, 1, and none of a scene's.

    It is brighter in PQ, HLG and cameras' logarithmic spaces. Raises as `decode`.
    """
    return float(decode(np.full((1, 1, 3), 255, np.uint8), space).max()) <= DISPLAY_WHITE


@functools.cache
def linear_space(space: str) -> tuple[str, Encoding]:
    """Return the name by which files state a linear colour space, and its encoding.

    Raises ValueError for a space that is not linear, or of which no chromaticities are known here.
    """
    known = _linear_spaces()
    linear = known.get(resolve(space))
    if linear is None:
        raise ValueError(f"colour_space: expected a linear one, {', '.join(known)}; got {space!r}")
    return linear


def is_linear(space: str) -> bool:
    """Return whether `linear_space` knows a colour space; raises ValueError for one that nothing knows."""
    return resolve(space) in _linear_spaces()


@functools.cache
def _linear_spaces() -> dict[str, tuple[str, Encoding]]:
    """Return {name of OpenColorIO: (name in files, encoding)}."""
    return {resolve(name): (name, Encoding(chromaticities)) for name, chromaticities in LINEAR_SPACES.items()}


def from_rec709(rgb: np.ndarray, space: str) -> np.ndarray:
    """Return linear Rec.709 (..., 3) in another linear colour space, float32; raises as `linear_space`."""
    matrix = linear_space(space)[1].matrix
    if np.array_equal(matrix, np.eye(3)):
        return rgb
    return rgb @ np.linalg.inv(matrix.astype(np.float64)).T.astype(np.float32)


def _through_profile(pixels: np.ndarray, profile: Profile) -> np.ndarray:
    """Convert pixels of an ICC profile's space to linear Rec.709. A profile of sRGB is exactly sRGB."""
    if profile.table is not None:
        return _through_encoding(profile.to_wide(pixels), WIDE)
    codes = np.linspace(0, 1, 18, dtype=np.float32)[:, None].repeat(3, axis=1)
    probe = np.concatenate([np.eye(3, dtype=np.float32), codes])[None]
    if np.allclose(_from_profile(probe, profile), decode(probe, SRGB), atol=1e-3):  # a quarter of a code
        return decode(pixels, SRGB)
    return _from_profile(pixels, profile)


def _from_profile(pixels: np.ndarray, profile: Profile) -> np.ndarray:
    if profile.encoding is not None:
        return _through_encoding(pixels, profile.encoding)
    light = profile.light(pixels)
    if profile.colorants is None:
        return light
    to_rec709 = np.linalg.inv(rgb_to_xyz(REC709)) @ encodings.adaptation(D50, D65)
    return light @ (to_rec709 @ profile.colorants.T).T.astype(np.float32)


def _through_encoding(pixels: np.ndarray, encoding: Encoding) -> np.ndarray:
    """Decode pixels (H, W, 3) of an encoding to linear Rec.709."""
    matrix = encoding.matrix.T
    if np.issubdtype(pixels.dtype, np.integer):
        light = _table(encoding.transfer, pixels.dtype)[pixels]
    else:
        light = np.asarray(pixels, np.float32)
        if not encoding.is_linear:
            light = _by_rows(lambda rows: encoding.transfer(rows.astype(np.float64)), light)
    return light if np.array_equal(matrix, np.eye(3)) else light @ matrix


@functools.lru_cache(maxsize=8)
def _table(transfer: encodings.Transfer, dtype: np.dtype) -> np.ndarray:
    """Light, float32, of every code of an integer dtype: exact, and faster than computing each pixel."""
    codes = np.arange(np.iinfo(dtype).max + 1) / np.iinfo(dtype).max
    return np.asarray(transfer(codes), np.float32)


def _by_rows(function: Callable[[np.ndarray], np.ndarray], *images: np.ndarray) -> np.ndarray:
    """Apply a function to images (H, W, C), side by side, a few rows at a time: (H, W, 3) float32.

    Its float64 takes much memory.
    """
    result = np.empty((*images[0].shape[:-1], 3), np.float32)
    for row in range(0, len(result), ROWS):
        part = [image[row : row + ROWS] for image in images]
        result[row : row + ROWS] = function(part[0] if len(part) == 1 else np.concatenate(part, axis=-1))
    return result


class Display(TypedDict, total=False):
    """How light becomes what displays show, as `encode` takes it."""

    view: str | None
    exposure: float
    white: float | None


def encode(
    rgb: np.ndarray,
    *,
    view: str | None = None,
    exposure: float = 0.0,
    white: float | None = None,
    transfer: Transfer = encode_srgb,
) -> np.ndarray:
    """Encode linear Rec.709 for a display: (H, W, 3), unbounded, to (H, W, 3) float32 in [0, 1].

    `view`: name of a view transform of the default display of OpenColorIO's built-in configuration or
    $OCIO's, or a part of it that no other has, e.g. "aces". None encodes for an sRGB display (IEC 61966-2.1).
    `exposure`: stops, in [-64, 64]; doubles the light for each. `white`: for sRGB, the exposed light >= 1
    that becomes the display's white; None: the brightest there is.

    Light up to 1 comes out exact if there is none above `white` = 1. Else what is above 0.6 is compressed, by
    channel and as little as brings `white` to the display's white (Reinhard et al. 2002, equation 4, above a
    knee), so that highlights roll off and keep their shapes. A sequence of pictures wants one `white`.
    `transfer`: from light in [0, 1] to code values, of a display without a view.

    Raises ValueError for no such view, exposure or white out of range, or $OCIO that cannot be used.
    """
    gain = _gain(exposure)
    if view is not None:
        return _through_view(rgb * gain, view)
    white = _white(rgb, gain, white)
    return _by_rows(lambda rows: transfer(_shown(rows, gain, white).astype(np.float64)), rgb)


def encode_over(
    picture: np.ndarray,
    background: np.ndarray,
    *,
    exposure: float = 0.0,
    white: float | None = None,
    transfer: Transfer = encode_srgb,
) -> np.ndarray:
    """Encode a picture over a background that keeps its own code values: (H, W, 3) float32 in [0, 1].

    `picture`: (H, W, 4), linear Rec.709, premultiplied, unbounded. `background`: (H, W, 3), linear Rec.709,
    light of a display: of [0, 1], beyond which it is clipped. `exposure`, `white`, `transfer`: see `encode`.

    Only the picture's highlights are compressed. What its colour shows on the display, without the alpha, is
    laid over the background's light: D(F / alpha) alpha + (1 - alpha) B. So where alpha is 0, code values
    of the background's file come back bit for bit, where it is 1, the picture is that of `encode`, and in
    between a soft edge is a mixture of both lights, as in the photograph. An `exposure` holds for both; the
    background then has a white of its own, so that its brightest code stays white.

    Raises ValueError for exposure or white out of range.
    """
    gain = _gain(exposure)
    white = _white(picture[..., :3], gain, white)

    def rows(both: np.ndarray) -> np.ndarray:
        colour, alpha = both[..., :3], both[..., 3:4]
        straight = np.divide(colour, alpha, out=np.zeros_like(colour), where=alpha > 0)
        behind = _shown(both[..., 4:].clip(0, 1), gain, max(1.0, float(gain)))
        return transfer((_shown(straight, gain, white) * alpha + behind * (1 - alpha)).astype(np.float64))

    return _by_rows(rows, picture, background)


def _gain(exposure: float) -> np.float32:
    if not -64 <= exposure <= 64:
        raise ValueError(f"exposure: expected -64 to 64 stops, got {exposure:g}")
    return np.float32(2.0**exposure)


def _white(rgb: np.ndarray, gain: np.float32, white: float | None) -> float:
    """Return the exposed light that becomes the display's white: by default the brightest there is."""
    white = max(1.0, float(rgb.max(initial=0)) * float(gain)) if white is None else white
    if not 1 <= white < math.inf:
        raise ValueError(f"white: expected a finite number >= 1, got {white:g}")
    return white


def _shown(rgb: np.ndarray, gain: np.float32, white: float) -> np.ndarray:
    """Return the light in [0, 1] by which a display shows linear light."""
    return np.clip(_roll_off(rgb * gain, white), 0, 1)


def _roll_off(rgb: np.ndarray, white: float) -> np.ndarray:
    """Compress light above the knee so that `white` becomes 1: the identity where `white` is 1."""
    if white == 1:
        return rgb
    above = (rgb - KNEE).clip(0) / (1 - KNEE)
    top = (white - KNEE) / (1 - KNEE)
    return np.minimum(rgb, KNEE) + (1 - KNEE) * above * (1 + above / top**2) / (1 + above)


def find_view(view: str) -> tuple[str, str, str]:
    """Return (path of the configuration, display, view) of the view that a part of its name identifies.

    Raises ValueError if none does.

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
    """Apply a view transform to linear Rec.709 (H, W, 3), clipped to [0, 1] of the display."""
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
    """Return the linear Rec.709 colour of a colour temperature, scaled to luminance 1, as UsdLux does.

    `kelvin`: correlated colour temperature, in the range that `LOCI` gives for the locus, else ValueError.
    `locus`: "planckian", a black body: Planck's law through the CIE 1931 2 degree observer. Or "daylight":
    the CIE daylight locus (CIE 015, method of Judd et al. 1964), on which 6504 K is D65, Rec.709's white.

    Candle light is redder than Rec.709 can hold and loses its negative blue.
    """
    colour = colour_science()
    low, high = LOCI[locus]
    if not low <= kelvin <= high:
        raise ValueError(f"temperature: expected {low:g} to {high:g} kelvin on this locus, got {kelvin:g}")
    if locus == "daylight":
        tristimulus = colour.xy_to_XYZ(colour.temperature.CCT_to_xy_CIE_D(kelvin))
    else:
        tristimulus = colour.sd_to_XYZ(colour.sd_blackbody(kelvin))
    rgb = np.maximum(colour.XYZ_to_RGB(tristimulus / tristimulus[1], "ITU-R BT.709"), 0)
    return tuple((rgb / luminance(rgb)).tolist())


LUMINANCE = rgb_to_xyz(REC709)[1]  # of red, green and blue


def luminance(rgb: ArrayLike) -> np.ndarray:
    """Luminance Y (...) of linear Rec.709 colours (..., 3); white has 1."""
    return rgb @ LUMINANCE
