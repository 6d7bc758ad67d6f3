"""The pose network's mask of somebody whose place is known, for training the matting network."""

import numpy as np
import torch

from relight.matting.people import finder
from relight.matting.people.region import Circle

AROUND = 0.55  # radius of the first circle, of the longer side of the person's box
ALIKE = 0.6  # intersection over union of the mask and the matte from which the mask is of the same person


def mask_around(
    rgb: torch.Tensor, matte: torch.Tensor, people: finder.PersonFinder | None = None
) -> torch.Tensor | None:
    """Return the mask (H, W) of whoever a matte (H, W) shows in a picture; None if it is of somebody else.

    rgb: (3, H, W), sRGB-encoded; masks, mattes and pictures are in [0, 1]. `people`: the pose networks,
    those that have been fetched by default. Raises as `finder.load` does.

    >>> mask_around(torch.rand(3, 64, 64), torch.zeros(64, 64)) is None
    True
    """
    inside = matte > 0.5
    rows, columns = np.nonzero(inside.numpy())
    if not len(rows):
        return None
    centre = np.array([columns.mean(), rows.mean()])
    radius = AROUND * float(max(np.ptp(columns), np.ptp(rows)) + 1)
    seen = (people or finder.load()).look(rgb, Circle(centre, radius, np.array([0.0, -1.0])))
    if not seen:
        return None
    mask = torch.from_numpy(seen[0].on((rgb.shape[1], rgb.shape[2]))).clamp(0, 1)
    shown = mask > 0.5
    return mask if (shown & inside).sum() > ALIKE * (shown | inside).sum() else None
