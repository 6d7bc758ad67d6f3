"""Pixels that are not square, as anamorphic lenses and video of standard definition have them."""

import numpy as np
import torch
import torch.nn.functional as F

SQUARE = 0.005  # relative difference of a pixel's width and height that no one sees
SQUARED = "it is read with square pixels, and .exr, .mov and .mp4 are written with such pixels again"
MOST = 16.0  # of the aspect: beyond, the file is damaged


def is_square(aspect: float) -> bool:
    """Return whether pixels of this width over height count as square, damaged values included."""
    return not 1 / MOST <= aspect <= MOST or abs(aspect - 1) <= SQUARE


def growth(aspect: float) -> float:
    """Return how many times as many pixels a picture has once its pixels are square."""
    return 1.0 if is_square(aspect) else max(aspect, 1 / aspect)


def square_pixels(pixels: np.ndarray, aspect: float, *, nearest: bool = False) -> np.ndarray:
    """Resample a picture (H, W, C) whose pixels are `aspect` times as wide as high to square pixels.

    The side that is too short grows, so that no detail is lost. `nearest` repeats values in place of
    averaging them, for values that are not to be mixed. Returns float32 where anything changes.
    """
    if is_square(aspect):
        return pixels
    height, width = pixels.shape[:2]
    size = (height, round(width * aspect)) if aspect > 1 else (round(height / aspect), width)
    if nearest:
        return _nearest(pixels, size)
    tensor = torch.from_numpy(np.ascontiguousarray(pixels, np.float32)).permute(2, 0, 1)[None]
    resampled = F.interpolate(tensor, size, mode="bilinear", align_corners=False)[0]
    return resampled.permute(1, 2, 0).contiguous().numpy()


def squeeze_pixels(pixels: np.ndarray, aspect: float, *, nearest: bool = False) -> np.ndarray:
    """Resample a picture (H, W, C) of square pixels to pixels `aspect` times as wide as high.

    The inverse of `square_pixels`: the size is that of the picture which was made square. `nearest` takes
    single values in place of averages. Returns float32 where anything changes.
    """
    if is_square(aspect):
        return pixels
    height, width = pixels.shape[:2]
    size = (height, max(1, round(width / aspect))) if aspect > 1 else (max(1, round(height * aspect)), width)
    if nearest:
        return _nearest(pixels, size)
    tensor = torch.from_numpy(np.array(pixels, np.float32)).permute(2, 0, 1)[None]
    return F.interpolate(tensor, size, mode="area")[0].permute(1, 2, 0).contiguous().numpy()


def _nearest(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    rows, columns = (
        ((np.arange(count) + 0.5) * given / count).astype(int)
        for count, given in zip(size, pixels.shape[:2], strict=True)
    )
    return pixels[rows][:, columns]
