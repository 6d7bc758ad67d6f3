"""A picture as its file stores it, before anything is made of its code values."""

from dataclasses import dataclass

import numpy as np

from relight.media import colour


@dataclass(frozen=True)
class StoredPicture:
    """Pixels, and what the file says of them."""

    pixels: np.ndarray  # (H, W, C), uint8, uint16 or float32, upright, filling the display window
    names: tuple[str, ...]  # of the channels, such as R, G, B, A, or N.X
    space: colour.Space  # that the file states, or that its type implies
    straight: bool = False  # whether colours are not multiplied by alpha
    aspect: float = 1.0  # how many times as wide as high the pixels are
    unsigned: bool = False  # whether values are OpenEXR's UINT: counts or object numbers, and no light
