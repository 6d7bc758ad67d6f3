"""Photometric interpretations of TIFF (TIFF 6.0): what OpenImageIO hands over as if it were RGB."""

import numpy as np
import OpenImageIO as oiio

INTERPRETATION = "tiff:PhotometricInterpretation"
WHITE_IS_ZERO, BLACK_IS_ZERO = 0, 1
GREY = (WHITE_IS_ZERO, BLACK_IS_ZERO)
NO_COLOURS = {8: "CIE Lab", 9: "ICC Lab", 10: "ITU Lab", 32844: "LogL", 32845: "LogLuv"}
LARGEST_INVERTED = 8  # bits of the samples that OpenImageIO turns over itself, alpha included


def check_photometric(spec: oiio.ImageSpec) -> None:
    """Raise ValueError for a TIFF of CIE Lab or LogLuv, and for white-is-zero whose black is unknown.

    That is white-is-zero of floats and of signed integers, and multiplied by alpha.
    """
    stated = spec.get_int_attribute(INTERPRETATION, -1)
    if stated in NO_COLOURS:
        raise ValueError(f"holds {NO_COLOURS[stated]}, expected red, green and blue; convert it")
    if stated != WHITE_IS_ZERO:
        return
    if not str(spec.format).startswith("uint"):
        raise ValueError(
            f"states that white is zero (PhotometricInterpretation 0), but {spec.format} has no known black; "
            "save it with black as zero"
        )
    if "A" in spec.channelnames and not spec.get_int_attribute("oiio:UnassociatedAlpha"):
        raise ValueError(
            "states that white is zero (PhotometricInterpretation 0) and that it is multiplied by alpha; "
            "save it with black as zero"
        )


def white_is_one(spec: oiio.ImageSpec, pixels: np.ndarray, names: list[str]) -> np.ndarray:
    """Return pixels (H, W, C), integers, turned over if their TIFF's white is zero: the grey, and no alpha.

    `names`: of the channels. OpenImageIO turns over all samples of up to 8 bits, and none of more.
    """
    if spec.get_int_attribute(INTERPRETATION, -1) != WHITE_IS_ZERO:
        return pixels
    by_reader = spec.get_int_attribute("oiio:BitsPerSample", LARGEST_INVERTED) <= LARGEST_INVERTED
    wrong = [index for index, name in enumerate(names) if (name == "Y") != by_reader]
    turned = pixels.copy()
    turned[..., wrong] = np.iinfo(pixels.dtype).max - turned[..., wrong]
    return turned
