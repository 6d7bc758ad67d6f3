"""Clean a matte for the analysis: remove noise, compression artefacts and stray specks."""

import numpy as np
import torch
import torch.nn.functional as F
from scipy import ndimage

from shadow import inputs
from shadow.framing import bounding_box

NOISE_COVERAGE = 0.1  # coverage up to this counts as 0, and from 1 minus this as 1
SPECK_SHARE = 0.02  # a detached part with less than this share of the largest part's coverage is a speck
SPECK_GAP = 0.04  # share of the person's extent: a part farther away is detached; hair and fingers are not
GRID_CELLS = 256  # along the longer side, for measuring gaps


def clean_matte(matte: torch.Tensor) -> torch.Tensor:
    """Return a matte (H, W) in [0, 1] that is zero where its coverage does not belong to the person.

    Coverage of at most NOISE_COVERAGE becomes zero. So do connected components that are small compared with
    the largest one and detached from the large ones. A matte of two people keeps both. Warns about the pixels
    in such small components, and about a matte that looks inverted.
    """
    whole = matte.cpu()
    solid = (whole > NOISE_COVERAGE).numpy()
    if not solid.any():  # the caller decides whether to refuse a matte without a person
        return matte
    _warn_if_inverted(solid)
    top, left, bottom, right = bounding_box(whole, NOISE_COVERAGE)
    box = np.s_[top:bottom, left:right]
    solid, coverage = solid[box], whole[box].numpy()
    labels, parts = ndimage.label(solid, structure=np.ones((3, 3)))
    weight = np.bincount(labels.ravel(), weights=coverage.ravel(), minlength=parts + 1)
    weight[0] = 0  # label 0 is the background
    large = weight >= SPECK_SHARE * weight.max()
    kept = large.copy()
    if not large[1:].all():
        parts_of_person = torch.zeros(matte.shape, dtype=torch.bool)
        parts_of_person[box] = torch.from_numpy(large[labels])
        near = _near(parts_of_person)[box].numpy()
        kept |= np.bincount(labels[near & solid], minlength=parts + 1) > 0
    kept[0] = False
    left_out = int(np.count_nonzero(solid & ~kept[labels]))
    if left_out:
        count = int((~kept[1:]).sum())
        inputs.warn(f"mask: {left_out} pixels in {count} small parts far from the person are left out")
    belongs = torch.from_numpy(kept[labels]).to(matte.device)
    cleaned = torch.zeros_like(matte)
    cleaned[box] = ((matte[box] - NOISE_COVERAGE) / (1 - 2 * NOISE_COVERAGE)).clamp(0, 1) * belongs
    return cleaned


def _warn_if_inverted(solid: np.ndarray) -> None:
    height, width = solid.shape
    middle = solid[int(0.45 * height) : int(0.55 * height) + 1, int(0.45 * width) : int(0.55 * width) + 1]
    if solid[[0, 0, -1, -1], [0, -1, 0, -1]].all() and middle.mean() < 0.5:
        inputs.warn("mask: covers the corners and not the middle; is it inverted?")


def _near(large: torch.Tensor) -> torch.Tensor:
    """Return the pixels (H, W) whose distance to the large parts is at most SPECK_GAP of the parts' extent.

    The precision is one cell of the grid.
    """
    height, width = large.shape
    step = max(1, -(-max(height, width) // GRID_CELLS))
    cells = F.max_pool2d(large[None].float(), step, ceil_mode=True)
    rows, columns = (cells[0].amax(dim=axis).nonzero() for axis in (1, 0))
    extent = max(int(rows[-1] - rows[0]), int(columns[-1] - columns[0])) + 1
    radius = round(SPECK_GAP * extent) + 1
    around = F.max_pool2d(cells, 2 * radius + 1, stride=1, padding=radius)
    return F.interpolate(around[None], scale_factor=step)[0, 0, :height, :width] > 0
