"""How pixels lie: not upright, or not square, as those of anamorphic lenses and of standard definition."""

import numpy as np
import OpenImageIO as oiio

from relight.media.buffers import to_array

SQUARE = 0.005  # relative difference of a pixel's width and height that no one sees
SQUARED = "it is read with square pixels, and .exr, .mov and .mp4 are written with such pixels again"
MOST = 16.0  # of the aspect: beyond, the file is damaged
TURNED = range(2, 9)  # orientations of Exif that are not upright; 0 and others mean nothing
SIDEWAYS = range(5, 9)  # orientations whose rows stand upright


def is_square(aspect: float) -> bool:
    """Return whether pixels of this width over height count as square, damaged values included."""
    return not 1 / MOST <= aspect <= MOST or abs(aspect - 1) <= SQUARE


def growth(aspect: float) -> float:
    """Return how many times as many pixels a picture has once its pixels are square."""
    return 1.0 if is_square(aspect) else max(aspect, 1 / aspect)


def square_pixels(pixels: np.ndarray, aspect: float, *, nearest: bool = False) -> np.ndarray:
    """Resample a picture (H, W, C), or values (H, W), whose pixels are `aspect` times as wide as high.

    Its pixels are square then. The side that is too short grows, so that no detail is lost. `nearest` repeats
    values in place of averaging them, for values that are not to be mixed. Returns float32 where anything
    changes.
    """
    if is_square(aspect):
        return pixels
    height, width = pixels.shape[:2]
    size = (height, round(width * aspect)) if aspect > 1 else (round(height / aspect), width)
    return _resampled(pixels, size, "nearest" if nearest else "bilinear")


def squeeze_pixels(pixels: np.ndarray, aspect: float, *, nearest: bool = False) -> np.ndarray:
    """Resample a picture (H, W, C), or values (H, W), to pixels that are `aspect` times as wide as high.

    Its pixels are square. This is the inverse of `square_pixels`: the size is that of the picture which was
    made square. `nearest` takes single values in place of averages. Returns float32 where anything changes.
    """
    if is_square(aspect):
        return pixels
    height, width = pixels.shape[:2]
    size = (height, max(1, round(width / aspect))) if aspect > 1 else (max(1, round(height * aspect)), width)
    return _resampled(pixels, size, "nearest" if nearest else "area")


def _resampled(pixels: np.ndarray, size: tuple[int, int], mode: str) -> np.ndarray:
    if mode == "nearest":
        rows, columns = (
            ((np.arange(count) + 0.5) * given / count).astype(int)
            for count, given in zip(size, pixels.shape[:2], strict=True)
        )
        return pixels[rows][:, columns]
    import torch
    import torch.nn.functional as F

    tensor = torch.from_numpy(np.array(pixels, np.float32)).reshape(*pixels.shape[:2], -1)
    resampled = F.interpolate(tensor.permute(2, 0, 1)[None], size, mode=mode)[0]
    return resampled.permute(1, 2, 0).reshape(*size, *pixels.shape[2:]).numpy()


def upright(pixels: np.ndarray, orientation: object) -> np.ndarray:
    """Return pixels (H, W, C) turned as their Exif orientation asks; unknown orientations turn nothing."""
    if not isinstance(orientation, int) or orientation not in TURNED:
        return pixels
    lying = oiio.ImageBuf(np.ascontiguousarray(pixels))
    lying.orientation = orientation
    turned = oiio.ImageBufAlgo.reorient(lying)
    return to_array(turned, str(turned.spec().format))
