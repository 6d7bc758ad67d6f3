"""Colour: to and from linear Rec.709, the working space, and the colour of a temperature.

Names of colour spaces are those of OpenColorIO's built-in configuration: "sRGB", "lin_rec709", "ACEScg"...
"""

import atexit
import functools
import sys
import warnings

import numpy as np
import OpenImageIO as oiio

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # colour-science warns at import that Matplotlib is not installed
    import colour

# colour-science keeps OpenImageIO objects alive past the end of their module, for which its bindings print a
# page of harmless "leaked instance" lines at exit.
atexit.register(vars(sys.modules["colour.io.image"]).clear)

LINEAR = "lin_rec709"
SRGB = "sRGB"
LOCI = {"planckian": (1000.0, 40000.0), "daylight": (4000.0, 25000.0)}  # kelvin; CIE 015 for daylight
ROWS = 64


@functools.cache
def resolve(space):
    """The canonical name of a colour space, so that aliases compare equal; ValueError if it is unknown."""
    config = oiio.ColorConfig()
    name = config.resolve(str(space))
    if config.getColorSpaceIndex(name) < 0:
        known = ", ".join(config.getColorSpaceNames())
        raise ValueError(f"colour_space: unknown {space!r}, expected {SRGB!r}, {LINEAR!r} or one of: {known}")
    return name


@functools.cache
def _srgb_table(dtype):
    """Linear value of every code of an integer dtype: exact, and faster than computing each pixel."""
    codes = np.arange(np.iinfo(dtype).max + 1) / np.iinfo(dtype).max
    return colour.models.eotf_sRGB(codes).astype(np.float32)


def decode(pixels, space):
    """Pixels of a colour space to linear Rec.709.

    Parameters
    ----------
    pixels: (H, W, 3), uint8 or uint16 over their full range, or floating with 1 as the encoding's white.
    space: name of the colour space that `pixels` are in.

    Returns
    -------
    (H, W, 3) float32. Nothing is clipped.

    Raises
    ------
    ValueError: the name is unknown.
    """
    space = resolve(space)
    if space == resolve(SRGB) and pixels.dtype in (np.uint8, np.uint16):
        return _srgb_table(pixels.dtype)[pixels]
    if np.issubdtype(pixels.dtype, np.integer):
        pixels = pixels / np.float32(np.iinfo(pixels.dtype).max)
    pixels = np.ascontiguousarray(pixels, np.float32)
    if space == resolve(LINEAR):
        return pixels
    if space == resolve(SRGB):
        return colour.models.eotf_sRGB(pixels).astype(np.float32)
    converted = oiio.ImageBufAlgo.colorconvert(oiio.ImageBuf(pixels), space, LINEAR, unpremult=False)
    if converted.has_error:
        raise ValueError(f"colour_space: cannot convert from {space!r}: {converted.geterror()}")
    return converted.get_pixels("float")


def encode(rgb):
    """Linear Rec.709 to the sRGB encoding, for display: (H, W, 3) float32 to (H, W, 3) float32 in [0, 1].

    Light outside [0, 1] is clipped: there is no view transform yet, so what is brighter than the display's
    white loses its detail. Scene-linear files keep it. IEC 61966-2-1.
    """
    encoded = np.empty(rgb.shape, np.float32)
    for row in range(0, len(rgb), ROWS):  # colour-science works in float64: bound the memory
        encoded[row : row + ROWS] = colour.models.eotf_inverse_sRGB(np.clip(rgb[row : row + ROWS], 0, 1))
    return encoded


@functools.cache
def temperature(kelvin, locus="planckian"):
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


def luminance(rgb):
    """Luminance Y (...) of linear Rec.709 colours (..., 3); white has 1."""
    return rgb @ colour.RGB_COLOURSPACES["ITU-R BT.709"].matrix_RGB_to_XYZ[1]
