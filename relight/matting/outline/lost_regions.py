"""Parts of a person that a soft mask loses before a plain wall, such as a skirt between the legs.

They are found by their colour, which is clearly not the wall's, within the convex hull of what the mask
shows. The mask has to be in doubt of most of such a part: of a cast shadow, or of a neighbour, it is seldom.
"""

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull

from relight.matting.outline.background_model import Wall

OTHER = 6.0  # standard deviations from the wall's colour from which a colour is clearly another one
LEAST_AREA = 0.0005  # of the copy, of a part
FAR = 0.015  # of the longer side: a part goes farther from the mask than its soft edge, at least as far
DOUBTED = 0.5  # of a part, at least, that the mask is in doubt of
PATTERN = 0.008  # of the longer side: half the width of stripes of the wall's colour within a part


def lost_parts(seen: np.ndarray, mask: np.ndarray, least: float) -> np.ndarray:
    """Return which parts of the person a soft mask loses: (h, w), bool.

    `seen`: (h, w, 3) in [0, 1], encoded. `mask`: (h, w) in [0, 1], in doubt where it is between `least` and
    one half.
    """
    side = max(mask.shape)
    few = mask[::2, ::2]  # where nothing is in doubt beyond the mask's edge, as is usual, this is quick
    beyond = ndimage.distance_transform_edt(few < 0.5) >= FAR * side / 2
    shown = ndimage.binary_opening(mask > least, np.ones((3, 3)))
    if not shown.any() or 4 * (beyond & (few > least)).sum() < LEAST_AREA * mask.size / 4:
        return np.zeros(mask.shape, bool)
    around = _hull(shown)
    wall = Wall.behind(seen, ~around)
    # What the mask surrounds is rather a gap that shows a shaded wall.
    outside = ~ndimage.binary_fill_holes(mask >= 0.5)
    labels, count = ndimage.label(
        ndimage.binary_opening(around & outside & wall.plain & (wall.off > OTHER), np.ones((3, 3)))
    )
    areas = np.bincount(labels.ravel(), minlength=count + 1)
    doubted = np.bincount(labels.ravel(), (mask > least).ravel(), count + 1)
    farthest = ndimage.maximum(ndimage.distance_transform_edt(outside), labels, np.arange(count + 1))
    lost = (areas >= LEAST_AREA * mask.size) & (doubted >= DOUBTED * areas) & (farthest >= FAR * side)
    lost[0] = False
    return outside & ndimage.binary_closing(lost[labels], iterations=max(1, round(PATTERN * side)))


def _hull(region: np.ndarray) -> np.ndarray:
    """Return the convex hull (h, w), bool, of a region that is no line."""
    hull = ConvexHull(np.argwhere(region & ~ndimage.binary_erosion(region)))
    rows, columns = np.ogrid[: region.shape[0], : region.shape[1]]
    inside = np.ones(region.shape, bool)
    for down, right, offset in hull.equations.astype(np.float32):
        inside &= down * rows + right * columns + offset <= 0.5
    return inside
