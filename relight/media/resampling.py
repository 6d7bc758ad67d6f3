"""Resize images, and fill what is unknown of them, by OpenImageIO."""

import numpy as np
import OpenImageIO as oiio

from relight.media.buffers import to_array, to_buffer


def resize(image: np.ndarray, size: tuple[int, ...], filter_name: str = "blackman-harris") -> np.ndarray:
    """Resample an image to another size.

    Parameters
    ----------
    image
        (h, w, C) floats. Unbounded.
    size
        (H, W) in pixels, at least 1.
    filter_name
        A filter of OpenImageIO. The default has no negative lobes: a lamp gets no dark ring.

    Returns
    -------
    np.ndarray
        (H, W, C) float32; the image itself if it has that size.
    """
    if image.shape[:2] == tuple(size):
        return image
    region = oiio.ROI(0, size[1], 0, size[0], 0, 1, 0, image.shape[2])
    resized = oiio.ImageBufAlgo.resize(to_buffer(image), filter_name, roi=region)
    return to_array(resized).reshape(size[0], size[1], image.shape[2])


def fill_unknown(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Continue an image to where it is not known, by push-pull (Gortler et al. 1996).

    Parameters
    ----------
    image
        (H, W, 3) floats; values where `known` is false take no part.
    known
        (H, W) bool.

    Returns
    -------
    np.ndarray
        (H, W, 3) float32, smooth in the unknown part. Known pixels are reproduced to float32 rounding only.
    """
    weight = known[..., None]
    weighted = np.concatenate([image * weight, weight], axis=-1, dtype=np.float32)  # the alpha is channel 3
    return to_array(oiio.ImageBufAlgo.fillholes_pushpull(to_buffer(weighted)))[..., :3]
