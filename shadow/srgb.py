"""The transfer function of sRGB (IEC 61966-2-1) and its inverse."""

import numpy as np

LAST_LINEAR = 0.0031308  # light up to which the transfer function is a straight line
SLOPE = 12.92  # of this line


def decode_srgb(codes: np.ndarray) -> np.ndarray:
    """Turn sRGB code values into light: floats of any shape, 0 is black and 1 is white, unbounded."""
    low = SLOPE * LAST_LINEAR
    return np.where(codes <= low, codes / SLOPE, ((np.maximum(codes, low) + 0.055) / 1.055) ** 2.4)


def encode_srgb(light: np.ndarray) -> np.ndarray:
    """Turn light into sRGB code values: floats of any shape, 0 is black and 1 is white, unbounded."""
    high = np.maximum(light, LAST_LINEAR)
    return np.where(light <= LAST_LINEAR, light * SLOPE, 1.055 * high ** (1 / 2.4) - 0.055)
