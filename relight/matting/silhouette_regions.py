"""Which regions of a silhouette belong to the person whom the pose networks show.

IS-Net has fine edges, but misses a white shirt before a white wall, and takes along what touches a person.
The mask of the pose networks is coarse, but of persons. Where they differ by more than the width of the
mask's edge, each connected region is decided as a whole: by the certainty of both, by whether it is at a
hand, at the feet or at the head, by whether the frame cuts it, and by its size. The mask alone counts where
the silhouette lacks much of it, as in small, blurred people. The constants were chosen on 170 such regions of
108 photographs, and of the 40 pictures of `benchmarks/person.py`; the last three on 66 more photographs.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.ndimage import distance_transform_edt

from relight.media.resampling import resize

# Lengths are shares of the longer side of the mask's box, areas are shares of the mask's area.
SIDE = 512  # pixels, the longer side of the copy on which regions are decided
CERTAIN = 0.9  # of the mask: gaps that it closes have less
INSIDE = 0.012  # how far inside the mask both networks should agree
SOLID = 0.6  # coverage from which what both networks show is opaque so far inside
NEAR = 0.02  # how far beyond the mask the person's own edge may be
RAMP = 0.01  # width of the transition between what one and the other network says
SMALL, THIN = 0.0065, 0.008  # area and half the width up to which anything stays, such as a lock or a pole
LIKELY = 0.15  # mean of the mask from which a region beyond its edge stays
JOINED, SURE = 0.5, 0.97  # share of its outline along the person and coverage from which clothes go on there
HANDS, FEET, HEAD = slice(15, 23), slice(27, 33), slice(0, 11)  # landmarks
# What begins so near to them stays, up to an area: what is held, also large things that a hand is in front
# of, shoes and skates, hair and hats.
PLACES = ((HANDS, 0.06, 0.2), (HANDS, 0.005, 0.3), (FEET, 0.08, 0.05), (HEAD, 0.06, 0.015))
DEEP = (0.97, 0.08)  # mean of the mask and depth from which a missing region is the person
HALF_SEEN = (0.93, 0.25)  # the same of the mean of the mask and of the coverage
CUT = (0.9, 0.15)  # mean of the mask or depth from which a region is the person where the frame cuts it
SHOE = (0.95, 0.03, 0.03)  # mean of the mask, depth, and nearness to a foot from which a region is the person
FAILED = 0.2  # of the mask: a silhouette that lacks more has not seen the person, and the mask is right


@dataclass(frozen=True)
class Regions:
    """Connected regions: `labels` (h, w), 0 elsewhere, and `count`, how many labels there are."""

    labels: np.ndarray
    count: int

    @classmethod
    def of(cls, area: np.ndarray) -> "Regions":
        """Return the connected regions of an area (h, w), bool."""
        labels, _ = ndimage.label(area, np.ones((3, 3)))
        return cls(labels, int(labels.max(initial=0)) + 1)

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Return the sum of values (h, w) in each region."""
        return np.bincount(self.labels.ravel(), values.ravel(), self.count)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the mean of values (h, w) in each region."""
        return self.sum(values) / np.maximum(np.bincount(self.labels.ravel(), minlength=self.count), 1)

    def max(self, values: np.ndarray) -> np.ndarray:
        """Return the largest of values (h, w) in each region."""
        return np.asarray(ndimage.maximum(values, self.labels, np.arange(self.count)))

    def where(self, chosen: np.ndarray) -> np.ndarray:
        """Return where the regions are that `chosen`, a bool for each, selects: (h, w), bool."""
        return (chosen & (np.arange(self.count) > 0))[self.labels]


def reconciled(
    found: np.ndarray, mask: np.ndarray, edge: np.ndarray, landmarks: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return a person's coverage (h, w), and the share of their area of which the networks disagree.

    `found`: the coverage of a silhouette, `mask`: the coarse mask of the person, `edge`: the same whose edge
    follows the picture's, (h, w) in [0, 1] all. `landmarks`: (P, N, 2), x and y, of one or more people.
    """
    step = max(1, round(max(mask.shape) / SIDE))
    small_found, small = found[::step, ::step], mask[::step, ::step]
    rows, columns = np.nonzero(small > 0.5)
    if not len(rows):
        return found, 0.0
    side = max(int(np.ptp(rows)), int(np.ptp(columns))) + 1
    missing, theirs = _missing(small_found, small, side, landmarks / step)
    foreign = _foreign(small_found, small, side, landmarks / step)
    core = distance_transform_edt(small > CERTAIN * min(1.0, float(small.max()))) / side
    solid = distance_transform_edt((small_found > SOLID) & (small > 0.5)) / side
    ramps = np.dstack(
        [
            np.maximum(_inside(core) * (1 - _around(missing & ~theirs, 0, side)), _inside(solid)),
            _around(theirs, NEAR, side),
            _around(foreign, 2 * NEAR, side),
        ]
    )
    inside, restored, cleared = np.moveaxis(resize(ramps.astype(np.float32), mask.shape, "triangle"), -1, 0)
    alpha = np.maximum(np.maximum(found, inside), restored * edge)
    disputed = (foreign | (missing & ~theirs)).sum() / len(rows)
    return np.minimum(alpha, np.maximum(edge, 1 - cleared)), float(disputed)


def _missing(
    found: np.ndarray, mask: np.ndarray, side: int, landmarks: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return what a silhouette lacks of a mask, and what of that is the person: (h, w), bool."""
    depth = distance_transform_edt(mask > 0.5) / side
    regions = Regions.of((found < 0.5) & (depth > INSIDE))
    frame = np.zeros(mask.shape, bool)
    frame[:, [0, -1]] = True  # and not the upper and the lower end
    frame[-1] = True
    certainty, deepest, coverage = regions.mean(mask), regions.max(depth), regions.mean(found)
    person = (certainty >= DEEP[0]) & (deepest >= DEEP[1])
    person |= (certainty >= HALF_SEEN[0]) & (coverage >= HALF_SEEN[1])
    person |= (regions.sum(frame) > 0) & ((certainty >= CUT[0]) | (deepest >= CUT[1]))
    shoe = _near(regions, landmarks[:, FEET], SHOE[2] * side)
    person |= (certainty >= SHOE[0]) & (deepest >= SHOE[1]) & shoe
    missing = regions.labels > 0
    failed = missing.sum() > FAILED * (mask > 0.5).sum()
    return missing, missing if failed else regions.where(person)


def _foreign(found: np.ndarray, mask: np.ndarray, side: int, landmarks: np.ndarray) -> np.ndarray:
    """Return which regions of a silhouette beyond a mask are not the person's: (h, w), bool."""
    beyond = distance_transform_edt(mask <= 0.5) / side
    regions = Regions.of((found > 0.5) & (beyond > NEAR))
    areas = regions.sum(np.ones(mask.shape)) / (mask > 0.5).sum()
    outline = ndimage.grey_dilation(regions.labels, 2 * max(1, round(INSIDE * side)) + 1)
    outline = Regions(np.where(regions.labels > 0, 0, outline), regions.count)
    stays = (areas <= SMALL) | (regions.mean(mask) >= LIKELY)
    stays |= regions.max(distance_transform_edt(regions.labels > 0)) <= THIN * side
    stays |= (outline.mean(beyond <= NEAR) >= JOINED) & (regions.mean(found) >= SURE)
    for place, distance, largest in PLACES:
        stays |= _near(regions, landmarks[:, place], distance * side) & (areas <= largest)
    return regions.where(~stays)


def _near(regions: Regions, landmarks: np.ndarray, distance: float) -> np.ndarray:
    """Return for each region whether it is within a distance in pixels of one of landmarks (P, N, 2)."""
    rows, columns = np.nonzero(regions.labels)
    near = np.zeros(regions.count, bool)
    for x, y in landmarks.reshape(-1, 2):
        reached = np.hypot(columns + 0.5 - x, rows + 0.5 - y) <= distance
        near[regions.labels[rows[reached], columns[reached]]] = True
    return near


def _inside(depth: np.ndarray) -> np.ndarray:
    """Return 1 where a depth (h, w) is above `INSIDE`, and a ramp from there to 0."""
    return ((depth - INSIDE) / RAMP + 0.5).clip(0, 1)


def _around(region: np.ndarray, reach: float, side: int) -> np.ndarray:
    """Return 1 in a region (h, w), bool, and up to `reach` beyond it, and a ramp from there to 0."""
    if not region.any():
        return np.zeros(region.shape)
    return (1 - (distance_transform_edt(~region) / side - reach) / RAMP).clip(0, 1)
