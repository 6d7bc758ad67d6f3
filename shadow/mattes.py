"""What of a matte belongs to the person: noise, compression and stray pixels are left out of the analysis."""

import numpy as np
import torch
import torch.nn.functional as F
from scipy import ndimage

from shadow import inputs

FAINT = 0.1  # coverage that counts as none, and as far from whole as counts as whole: noise, JPEG at an edge
SMALL = 0.02  # of the largest part's coverage, below which a part that stands apart is a speck
APART = 0.04  # of the person's extent, a gap beyond which a part stands apart: hair and fingers do not
GRID = 256  # cells along the longer side, on which gaps are measured


def person_in(matte: torch.Tensor) -> torch.Tensor:
    """A matte (H, W) in [0, 1] without what does not belong to the person, there zero.

    Left out are coverage of at most FAINT, and parts (connected pixels above that) that are small beside the
    largest and stand apart from the large ones. Two people stay two. Warns of the pixels in such parts, and
    of a matte that looks inverted.
    """
    coverage = matte.cpu().numpy()
    solid = coverage > FAINT
    labels, parts = ndimage.label(solid, structure=np.ones((3, 3)))
    if parts == 0:  # all is faint: not for this function to refuse
        return matte
    _warn_if_inverted(solid)
    weight = np.bincount(labels.ravel(), weights=coverage.ravel(), minlength=parts + 1)
    weight[0] = 0  # what is in no part
    large = weight >= SMALL * weight.max()
    kept = large.copy()
    if not large[1:].all():
        near = _near(torch.from_numpy(large[labels])).numpy()
        kept |= np.bincount(labels[near & solid], minlength=parts + 1) > 0
    kept[0] = False
    left_out = int(np.count_nonzero(solid & ~kept[labels]))
    if left_out:
        count = int((~kept[1:]).sum())
        inputs.warn(f"mask: {left_out} pixels in {count} small parts far from the person are left out")
    belongs = torch.from_numpy(kept[labels]).to(matte.device)
    return ((matte - FAINT) / (1 - 2 * FAINT)).clamp(0, 1) * belongs


def _warn_if_inverted(solid: np.ndarray) -> None:
    height, width = solid.shape
    middle = solid[int(0.45 * height) : int(0.55 * height) + 1, int(0.45 * width) : int(0.55 * width) + 1]
    if solid[[0, 0, -1, -1], [0, -1, 0, -1]].all() and middle.mean() < 0.5:
        inputs.warn("mask: covers the corners and not the middle; is it inverted?")


def _near(large: torch.Tensor) -> torch.Tensor:
    """Where (H, W) a large part is at most APART of their extent away, to the nearest cell of the grid."""
    height, width = large.shape
    step = max(1, -(-max(height, width) // GRID))
    cells = F.max_pool2d(large[None].float(), step, ceil_mode=True)
    rows, columns = (cells[0].amax(dim=axis).nonzero() for axis in (1, 0))
    extent = max(int(rows[-1] - rows[0]), int(columns[-1] - columns[0])) + 1
    reach = round(APART * extent) + 1
    around = F.max_pool2d(cells, 2 * reach + 1, stride=1, padding=reach)
    return F.interpolate(around[None], scale_factor=step)[0, 0, :height, :width] > 0
