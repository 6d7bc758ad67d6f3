"""Mattes out of pictures and frames: alpha unless it is opaque, else grey."""

import numpy as np


def matte_of(
    colours: np.ndarray, alpha: np.ndarray | None, *, opaque: float, grey: float
) -> np.ndarray | None:
    """Return the matte (H, W) of a picture, as it is stored; None for an opaque picture that is not grey.

    Parameters
    ----------
    colours
        (H, W, C) of one channel or more, without alpha.
    alpha
        (H, W); None where there is none.
    opaque
        The least alpha that counts as opaque everywhere.
    grey
        Most that the channels of a grey picture differ.
    """
    if alpha is not None and (not colours.size or alpha.min() < opaque):
        return alpha
    difference = np.ptp(colours, axis=-1).max(initial=0)
    if difference > grey:
        return None
    return colours.mean(axis=-1) if difference else colours[..., 0]
