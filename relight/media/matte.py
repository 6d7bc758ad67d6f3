"""The matte of a picture that is read as one: its alpha, or its grey values."""

import numpy as np

TRANSPARENT_ALPHA = 0.5  # an alpha that is nowhere lower cuts nothing out


def matte_of(
    colours: np.ndarray, alpha: np.ndarray | None, *, opaque: float, grey: float
) -> np.ndarray | None:
    """Return the matte (H, W) of a picture, as it is stored; None for an opaque picture that is not grey.

    `colours`: (H, W, C), at least one channel, without alpha. `alpha`: (H, W), or None for a picture without
    alpha. `opaque`: a picture whose alpha is at least this everywhere is opaque. A grey picture whose alpha
    is at least 0.5 everywhere counts as opaque too, unless `opaque` is infinite: such an alpha cuts nothing
    out. `grey`: the largest difference between the channels of a grey picture.
    """
    if not colours.size:
        return alpha
    if alpha is not None and (alpha.min() < min(TRANSPARENT_ALPHA, opaque) or opaque == np.inf):
        return alpha
    if alpha is not None and alpha.min() >= opaque:
        alpha = None
    difference = np.ptp(colours, axis=-1).max(initial=0) if colours.shape[-1] > 1 else 0
    if alpha is not None and (difference > grey or np.ptp(colours) <= grey):  # no matte is in the colours
        return alpha
    if difference > grey:
        return None
    return colours.mean(axis=-1) if difference else colours[..., 0]
