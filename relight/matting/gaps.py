"""Gaps within a soft mask through which the background shows, such as that between arm and body.

A coarse mask closes them, but is seldom sure of them. A gap is found by its colour: the
background near by has nearly one colour, the gap has the same, and what surrounds the gap has clearly
another. So nothing is found before clutter, nor where the person wears the background's colour.
"""

import numpy as np
from scipy import ndimage

from relight.matting.refine import BACKGROUND
from relight.media.resampling import resize

STEP = 4  # pixels from one whose colour is gathered to the next
NEAR = 0.03  # of the copy's longer side: standard deviation of the Gaussian that gathers them
LEAST_SHARE = 0.0002  # of what it reaches: the background, at least
NOISE = 0.01  # standard deviation of a plain background's colours, encoded, at least
PLAIN = 0.07  # standard deviation of the background's colours near by up to which they are nearly one
SAME = 3.0  # standard deviations from the background's colour up to which a colour is the same
OTHER = 8.0  # standard deviations from which it is clearly another one
BLEND = 3  # pixels from a gap to where no colour is a mixture with the background's any more
RIM = 4  # pixels, the width of the rim beyond these that shows what surrounds the gap
ALIKE = 0.2  # of that rim, at most, may be of nearly the background's colour
LEAST_AREA = 30  # pixels of a gap
WORN = 0.05  # of the longer side: so near, the person may not wear more of that colour than a gap has


def gaps(seen: np.ndarray, known: np.ndarray, inside: np.ndarray, unsure: np.ndarray) -> np.ndarray:
    """Return where the background shows within a mask beyond reasonable doubt: (h, w), bool.

    Parameters
    ----------
    seen
        (h, w, 3) in [0, 1], encoded.
    known
        (h, w), the mask's trimap.
    inside
        (h, w), bool: where a gap may be.
    unsure
        (h, w), bool: where the mask is not sure of the person; a gap has such a place.
    """
    far, plain = deviations(seen, known == BACKGROUND, NEAR)
    same = ndimage.binary_opening(inside & plain & (far < SAME), np.ones((3, 3)))
    labels, count = ndimage.label(same)
    large = np.bincount(labels.ravel(), minlength=count + 1) >= LEAST_AREA
    large[0] = False
    doubted = large & (np.bincount(labels.ravel(), unsure.ravel(), count + 1) > 0)
    worn, reach = (large & ~doubted)[labels], round(WORN * max(known.shape))
    found = np.zeros(known.shape, bool)
    for number, part in enumerate(ndimage.find_objects(labels), 1):
        if not doubted[number]:
            continue
        around = _grown(part, reach)
        part = _grown(part, BLEND + RIM)
        gap = labels[part] == number
        rim = ndimage.binary_dilation(gap, iterations=BLEND + RIM) & inside[part]
        rim &= ~ndimage.binary_dilation(gap, iterations=BLEND)
        alike = (far[part][rim] < OTHER).sum()
        if alike < ALIKE * rim.sum() and worn[around].sum() < gap.sum():
            found[part] |= gap
    return found


def _grown(part: tuple[slice, ...], margin: int) -> tuple[slice, ...]:
    """Return a part of a picture with a margin around it."""
    return tuple(slice(max(side.start - margin, 0), side.stop + margin) for side in part)


def deviations(seen: np.ndarray, background: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
    """Return how far colours (h, w, 3) are from the background's near by, and where that is near and plain.

    The distance is Mahalanobis': in standard deviations of the colours of the background (h, w), bool, that
    a Gaussian gathers, whose own standard deviation is `near` of the longer side.
    """
    colour = ndimage.gaussian_filter(seen, (0.7, 0.7, 0))
    few = colour[::STEP, ::STEP]
    size = few.shape[:2]
    products = (few[..., :, None] * few[..., None, :]).reshape(*size, 9)
    gathered = np.concatenate([np.ones((*size, 1)), few, products], axis=-1)
    gathered *= background[::STEP, ::STEP, None]
    reach = near * max(size)
    gathered = ndimage.gaussian_filter(gathered, (reach, reach, 0))
    share = gathered[..., :1]
    gathered = gathered[..., 1:] / np.maximum(share, 1e-9)
    mean, spread = gathered[..., :3], gathered[..., 3:].reshape(*size, 3, 3)
    spread = spread - mean[..., :, None] * mean[..., None, :] + NOISE**2 * np.eye(3)
    plain = (share > LEAST_SHARE) & (np.trace(spread, axis1=2, axis2=3)[..., None] < 3 * PLAIN**2)
    whiten = np.linalg.inv(np.linalg.cholesky(spread))
    offset = (whiten @ mean[..., None])[..., 0]
    rows, columns = np.tril_indices(3)
    local = np.concatenate([plain, offset, whiten[..., rows, columns]], axis=-1).astype(np.float32)
    local = resize(local, seen.shape[:2], "triangle")
    squares = np.zeros(seen.shape[:2], np.float32)
    for row in range(3):
        off = -local[..., 1 + row]
        for index in np.nonzero(rows == row)[0]:
            off = off + local[..., 4 + index] * colour[..., columns[index]]
        squares += off**2
    return np.sqrt(squares), local[..., 0] > 0.5
