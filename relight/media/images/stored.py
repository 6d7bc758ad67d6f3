"""A picture as its file stores it, before anything is made of its code values."""

from dataclasses import dataclass

import numpy as np

from relight.media import colour


@dataclass(frozen=True)
class StoredPicture:
    """Pixels, and what the file says of them.

    Parameters
    ----------
    pixels
        (H, W, C), uint8, uint16 or float32, upright, filling the display window.
    names
        Of the channels, such as R, G, B, A, or N.X.
    space
        The colour space that the file states, or that its type implies.
    straight
        Whether colours are not multiplied by alpha.
    aspect
        How many times as wide as high the pixels are.
    unsigned
        Whether values are OpenEXR's UINT, which are counts or object numbers and no light.
    """

    pixels: np.ndarray
    names: tuple[str, ...]
    space: colour.Space
    straight: bool = False
    aspect: float = 1.0
    unsigned: bool = False
