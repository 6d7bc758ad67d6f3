"""Gaps within a soft mask through which the background shows, such as that between arm and body.

A coarse mask closes them, but is seldom sure of them. A gap is found by its colour: the
background near by has nearly one colour, the gap has the same, and what surrounds the gap has clearly
another. So nothing is found before clutter, nor where the person wears the background's colour.

Where that is not certain, a region of the wall's colour of which the mask is in doubt is no witness of what
the person looks like: there the colours decide that are surely the person's and surely the wall's.
"""

import numpy as np
from scipy import ndimage

from relight.matting.outline.background_model import Wall

SAME = 3.0  # standard deviations from the background's colour up to which a colour is the same
OTHER = 8.0  # standard deviations from which it is clearly another one
BLEND = 3  # pixels from a gap to where no colour is a mixture with the background's any more
RIM = 4  # pixels, the width of the rim beyond these that shows what surrounds the gap
ALIKE = 0.2  # of that rim, at most, may be of nearly the background's colour
LEAST_AREA = 30  # pixels of a gap
WORN = 0.05  # of the longer side: so near, the person may not wear more of that colour than a gap has
DEEP = 0.015  # of the longer side: so far inside, a mask's doubt is not that of its soft edge
LEAST_DEEP = 20  # pixels of a region that are so far inside
DOUBTED = (0.05, 0.25)  # doubt of a pixel, and share of such pixels, in a region of the wall's colour
SHADED = (0.02, 0.9)  # the same in one of a shade of it, which cloth and skin may have as well


def gaps(wall: Wall, inside: np.ndarray, unsure: np.ndarray) -> np.ndarray:
    """Return where the background shows within a mask beyond reasonable doubt: (h, w), bool.

    Parameters
    ----------
    wall
        The background.
    inside
        (h, w), bool: where a gap may be.
    unsure
        (h, w), bool: where the mask is not sure of the person; a gap has such a place.
    """
    same = ndimage.binary_opening(inside & wall.plain & (wall.off < SAME), np.ones((3, 3)))
    labels, count = ndimage.label(same)
    large = np.bincount(labels.ravel(), minlength=count + 1) >= LEAST_AREA
    large[0] = False
    doubted = large & (np.bincount(labels.ravel(), unsure.ravel(), count + 1) > 0)
    worn, reach = (large & ~doubted)[labels], round(WORN * max(inside.shape))
    found = np.zeros(inside.shape, bool)
    for number, part in enumerate(ndimage.find_objects(labels), 1):
        if not doubted[number]:
            continue
        around = _grown(part, reach)
        part = _grown(part, BLEND + RIM)
        gap = labels[part] == number
        rim = ndimage.binary_dilation(gap, iterations=BLEND + RIM) & inside[part]
        rim &= ~ndimage.binary_dilation(gap, iterations=BLEND)
        alike = (wall.off[part][rim] < OTHER).sum()
        if alike < ALIKE * rim.sum() and worn[around].sum() < gap.sum():
            found[part] |= gap
    return found


def suspects(wall: Wall, inside: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return where a mask (h, w) in [0, 1] may have the wall for the person: (h, w), bool.

    `wall` and `inside` are as in `gaps`. Such a region has the wall's colour, or a shade of it, and the mask
    is in doubt of it farther inside than at its soft edge.
    """
    person = ndimage.binary_fill_holes(mask >= 0.5)
    deep = ndimage.distance_transform_edt(person) > DEEP * max(mask.shape)
    found = np.zeros(mask.shape, bool)
    for off, (doubt, least) in ((wall.off, DOUBTED), (wall.shaded, SHADED)):
        same = ndimage.binary_opening(inside & wall.plain & (off < SAME), np.ones((3, 3)))
        labels, count = ndimage.label(same)
        areas, insides, doubts = (
            np.bincount(labels.ravel(), region.ravel(), count + 1)
            for region in (same, deep, deep & (mask < 1 - doubt))
        )
        suspected = (areas >= LEAST_AREA) & (insides >= LEAST_DEEP) & (doubts >= least * insides)
        suspected[0] = False
        found |= suspected[labels]
    return found


def _grown(part: tuple[slice, ...], margin: int) -> tuple[slice, ...]:
    """Return a part of a picture with a margin around it."""
    return tuple(slice(max(side.start - margin, 0), side.stop + margin) for side in part)
