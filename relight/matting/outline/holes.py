"""Holes of a soft mask through which the background shows, such as that between arm and body.

A coarse mask closes them, but is seldom certain there. A hole is found by its colour: the background near by
is nearly uniform, the hole has the same colour, and what surrounds it has another one. So none is found
before clutter, nor where the person wears the background's colour.
"""

import numpy as np
from scipy import ndimage

from relight.matting.outline.background_model import BackgroundModel

SAME = 3.0  # standard deviations from the background's colour up to which a colour is the same
OTHER = 8.0  # standard deviations from which it is clearly another one
BLEND = 3  # pixels from a hole to where no colour is a mixture with the background's any more
RIM = 4  # pixels, the width of the rim beyond these that shows what surrounds the hole
ALIKE = 0.2  # of that rim, at most, may be of nearly the background's colour
LEAST_AREA = 30  # pixels of a hole
WORN = 0.05  # of the longer side: so near, the person may not wear more of that colour than a hole has


def holes(model: BackgroundModel, inside: np.ndarray, uncertain: np.ndarray) -> np.ndarray:
    """Return where the background shows within a mask with certainty: (h, w), bool.

    Parameters
    ----------
    model
        The colours of the background.
    inside
        (h, w), bool: where a hole may be.
    uncertain
        (h, w), bool: where the mask is not certain of the person; a hole has such a place.
    """
    same = ndimage.binary_opening(inside & model.uniform & (model.distance < SAME), np.ones((3, 3)))
    labels, count = ndimage.label(same)
    large = np.bincount(labels.ravel(), minlength=count + 1) >= LEAST_AREA
    large[0] = False
    candidate = large & (np.bincount(labels.ravel(), uncertain.ravel(), count + 1) > 0)
    worn, reach = (large & ~candidate)[labels], round(WORN * max(inside.shape))
    found = np.zeros(inside.shape, bool)
    for number, part in enumerate(ndimage.find_objects(labels), 1):
        if not candidate[number]:
            continue
        around = _grown(part, reach)
        part = _grown(part, BLEND + RIM)
        hole = labels[part] == number
        rim = ndimage.binary_dilation(hole, iterations=BLEND + RIM) & inside[part]
        rim &= ~ndimage.binary_dilation(hole, iterations=BLEND)
        alike = (model.distance[part][rim] < OTHER).sum()
        if alike < ALIKE * rim.sum() and worn[around].sum() < hole.sum():
            found[part] |= hole
    return found


def _grown(part: tuple[slice, ...], margin: int) -> tuple[slice, ...]:
    """Return a part of a picture with a margin around it."""
    return tuple(slice(max(side.start - margin, 0), side.stop + margin) for side in part)
