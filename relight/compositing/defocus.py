"""Blur of a background, as of a lens that is focused on the person: each point becomes a disc of light."""

import math

import numpy as np
import torch
import torch.nn.functional as F

KERNEL_RADIUS = 8.0  # pixels, of the disc on the reduced picture on which a large blur is computed


def defocused(picture: np.ndarray, share: float) -> np.ndarray:
    """Blur a picture (H, W, 3), linear light, by a disc whose radius is a share of its height.

    A large blur is computed on a reduced picture, which holds all that it leaves.
    """
    radius = share * picture.shape[0]
    if radius < 0.5:
        return picture
    planes = torch.from_numpy(np.ascontiguousarray(picture, np.float32)).permute(2, 0, 1)[None]
    step = max(1, math.floor(radius / KERNEL_RADIUS))
    small = F.avg_pool2d(planes, step, ceil_mode=True, count_include_pad=False) if step > 1 else planes
    disc = _disc(radius / step)
    margin = disc.shape[-1] // 2
    padded = F.pad(small, (margin,) * 4, mode="replicate")
    blurred = F.conv2d(padded, disc.expand(3, 1, *disc.shape), groups=3)
    if step > 1:
        height, width = picture.shape[:2]
        blurred = F.interpolate(blurred, scale_factor=step, mode="bilinear")[..., :height, :width]
    return blurred[0].permute(1, 2, 0).numpy()


def _disc(radius: float) -> torch.Tensor:
    """Return the weights (k, k) of a disc with a smooth edge of one pixel; they sum to 1."""
    side = torch.arange(-math.ceil(radius), math.ceil(radius) + 1, dtype=torch.float32)
    weights = (radius + 0.5 - torch.hypot(side[:, None], side[None])).clamp(0, 1)
    return weights / weights.sum()
