"""How likely a pixel's colour is inside an edge, and how likely outside, from the nearest known colours."""

from typing import NamedTuple

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from relight.matting.refine import BACKGROUND, PERSON, UNKNOWN

SAMPLES = 6000  # of known colour, at most, inside and outside each
TOLERANCE = 0.5  # relative excess of the distances to the samples found; saves a third of the time


class Neighbours(NamedTuple):
    """The samples of the nearest colours that a pixel is compared with."""

    samples: int
    # How far the picture's longer side is, as a distance of colours: near samples count more.
    place: float


OF_MASKS = Neighbours(6, 0.08)
OF_LINES = Neighbours(12, 0.04)  # farther from the true edge than masks: place says less


def colour_log_odds(
    seen: np.ndarray,
    known: np.ndarray,
    distance: np.ndarray,
    asked: np.ndarray | None = None,
    neighbours: Neighbours = OF_MASKS,
) -> np.ndarray:
    """Return for each unknown pixel the logarithm of the odds that its colour is that of the inside.

    `asked` (h, w), bool: those for which it is wanted, all of them by default; it is zero elsewhere.
    """
    height, width = known.shape
    rows, columns = np.mgrid[:height, :width]
    place = neighbours.place * np.stack([rows, columns], axis=-1) / max(height, width)
    features = np.concatenate([ndimage.gaussian_filter(seen, (0.7, 0.7, 0)), place], axis=-1)
    unknown = known == UNKNOWN
    asked = unknown if asked is None else asked
    around = ndimage.binary_dilation(unknown, iterations=max(8, max(height, width) // 12))
    logarithms = []
    # Where the band leaves nothing surely inside, as in an arm, what is deepest in it stands for that.
    for inside in (True, False):
        surely = (known == (PERSON if inside else BACKGROUND)) & around
        deep = unknown & ((distance > 0.5) if inside else (distance < -0.5))
        samples = features[surely | deep]
        if len(samples) < neighbours.samples:
            return np.zeros(known.shape)
        samples = np.ascontiguousarray(samples[:: -(-len(samples) // SAMPLES)])
        # A tree of median splits takes several times as long where many colours are alike, as on a wall.
        tree = cKDTree(samples, balanced_tree=False, compact_nodes=False)
        found, _ = tree.query(features[asked], neighbours.samples, eps=TOLERANCE, workers=1)
        logarithms.append(np.mean(found, axis=1))
    odds = np.zeros(known.shape)
    inner, outer = logarithms
    odds[asked] = np.clip(6 * np.log((outer + 0.01) / (inner + 0.01)), -6, 6)
    return odds
