"""Mattes out of pictures and frames: alpha if it cuts something out, else grey."""

import numpy as np

CUT = 0.5  # coverage below which a pixel is not the person's


def matte_of(
    colours: np.ndarray, alpha: np.ndarray | None, *, opaque: float, grey: float
) -> np.ndarray | None:
    """Return the matte (H, W) of a picture, as it is stored; None for an opaque picture that is not grey.

    `colours`: (H, W, C) of one channel or more, without the alpha (H, W), which is None where there is none.
    `opaque`: the least alpha that counts as opaque everywhere. A grey picture whose alpha is at least one
    half everywhere, which cuts nothing out, counts as opaque too, unless `opaque` is infinite. `grey`: most
    that the channels of a grey picture differ.
    """
    if not colours.size:
        return alpha
    if alpha is not None and (alpha.min() < min(CUT, opaque) or opaque == np.inf):
        return alpha
    if alpha is not None and alpha.min() >= opaque:
        alpha = None
    difference = np.ptp(colours, axis=-1).max(initial=0) if colours.shape[-1] > 1 else 0
    if alpha is not None and (difference > grey or np.ptp(colours) <= grey):  # no matte is in the colours
        return alpha
    if difference > grey:
        return None
    return colours.mean(axis=-1) if difference else colours[..., 0]
