"""Turning pictures upright by their Exif orientation."""

from typing import Any

import numpy as np
import OpenImageIO as oiio

from relight.media.buffers import to_array

TURNED = range(2, 9)  # orientations of Exif that are not upright; 0 and others mean nothing
SIDEWAYS = range(5, 9)  # orientations whose rows stand upright


def upright(pixels: np.ndarray, orientation: Any) -> np.ndarray:
    """Return pixels (H, W, C) turned as their Exif orientation asks; unknown orientations turn nothing."""
    if not isinstance(orientation, int) or orientation not in TURNED:
        return pixels
    lying = oiio.ImageBuf(np.ascontiguousarray(pixels))
    lying.orientation = orientation
    turned = oiio.ImageBufAlgo.reorient(lying)
    return to_array(turned, str(turned.spec().format))
