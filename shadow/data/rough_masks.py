"""Rough masks of people, as wrong as those of a pose network: what the matting network is given.

Such a mask has 256 pixels a side for the square around a whole person. Its edge is soft and runs some way
inside or outside the true one, gaps between arm and body are filled, hair, hands and held things are missing,
and pieces of the wall or of neighbours are part of it.
"""

import numpy as np
import torch
import torch.nn.functional as F

CELLS = 40, 200  # pixels, a side, of the mask that is enlarged to the picture
SOFTNESS = 0.6, 1.6  # of the edge, in pixels of that mask
WANDERING = 0.02, 0.35  # of the edge: standard deviation of the noise that is added before thresholding
SPOTS = 0.02, 0.12  # radius of a missing part and of an added piece, of the picture's side
GOOD = 0.5  # share of masks that are as good as a pose network's usually are; these errors are of the others


def rough_mask(
    alpha: torch.Tensor, rng: np.random.Generator, neighbours: torch.Tensor | None = None
) -> torch.Tensor:
    """Return a rough mask (H, W) in [0, 1] of a matte (H, W).

    neighbours: (H, W), the matte of other people, of whom pieces may be added.
    """
    side = alpha.shape[0]
    good = rng.random() < GOOD
    cells = int(np.exp(rng.uniform(*np.log(CELLS if not good else (100, CELLS[1])))))
    often, wander = (0.4, 0.3) if good else (1.0, 1.0)
    small = _resized(alpha, cells)
    if rng.random() < 0.5:  # gaps are filled
        reach = int(rng.integers(1, max(2, cells // 24)))
        small = -_grown(-_grown(small, reach), reach)
    seen = _blurred(small, rng.uniform(0.5, 2.0))
    for _ in range(rng.poisson(1.2 * often)):
        seen = seen * (1 - _spot(seen, rng))
    for _ in range(rng.poisson(0.8 * often)):
        seen = torch.maximum(seen, _spot(seen, rng))
    if neighbours is not None and rng.random() < 0.5:
        piece = _spot(seen, rng, 2.0) if rng.random() < 0.8 else rng.uniform(0.1, 0.5)
        seen = torch.maximum(seen, _resized(neighbours, cells) * piece)
    noise = sum(
        _resized(torch.from_numpy(rng.standard_normal((scale, scale)).astype(np.float32)), cells) / 2
        for scale in (6, 14, 30)
    )
    # The edge as a whole is further in or out, and wanders about that.
    near = _blurred(seen, cells / 40)
    level = 0.5 + wander * (rng.normal(0, 0.12) + rng.uniform(*WANDERING) * noise) * (
        4 * near * (1 - near)
    ).clamp(0, 1)
    steepness = 8 / rng.uniform(*SOFTNESS)
    mask = torch.sigmoid(steepness * (_blurred(seen, 0.7) - level))
    low, high = 1 / (1 + np.exp(steepness / 2)), 1 / (1 + np.exp(-steepness / 2))
    mask = ((mask - low) / (high - low)).clamp(0, 1)
    if rng.random() < 0.2:  # grey, where the network is unsure, on the person or on the wall
        spot = rng.uniform(0.1, 0.8) * _spot(mask, rng, 4.0)
        mask = mask * (1 - spot) if rng.random() < 0.5 else torch.maximum(mask, spot)
    return _resized(mask, side).clamp(0, 1)


def _spot(mask: torch.Tensor, rng: np.random.Generator, larger: float = 1.0) -> torch.Tensor:
    """Return a soft ellipse (H, W) in [0, 1] on the edge of a mask."""
    side = len(mask)
    edge = torch.nonzero((mask > 0.25) & (mask < 0.75))
    if not len(edge):
        return torch.zeros_like(mask)
    y, x = edge[rng.integers(len(edge))].tolist()
    radius = np.exp(rng.uniform(*np.log(SPOTS))) * side * larger
    angle, stretch = rng.uniform(0, np.pi), np.exp(rng.normal(0, 0.4))
    rows, columns = torch.meshgrid(torch.arange(side) - y, torch.arange(side) - x, indexing="ij")
    along = (columns * np.cos(angle) + rows * np.sin(angle)) / (radius * stretch)
    across = (rows * np.cos(angle) - columns * np.sin(angle)) / (radius / stretch)
    return torch.sigmoid(6 * (1 - (along**2 + across**2).sqrt())).float()


def _resized(plane: torch.Tensor, side: int) -> torch.Tensor:
    return F.interpolate(plane[None, None], (side, side), mode="bilinear", antialias=side < len(plane))[0, 0]


def _blurred(plane: torch.Tensor, sigma: float) -> torch.Tensor:
    return blurred(plane[None], sigma)[0]


def blurred(planes: torch.Tensor, sigma: float) -> torch.Tensor:
    """Return planes (C, H, W), blurred by a Gaussian whose standard deviation is `sigma` pixels."""
    if sigma < 0.2:
        return planes
    shrink = int(sigma / 2)
    if shrink > 1 and min(planes.shape[1:]) > 8 * shrink:  # what is blurred that much needs few pixels
        small = F.avg_pool2d(planes[None], shrink, ceil_mode=True, count_include_pad=False)[0]
        size = (planes.shape[1], planes.shape[2])
        return F.interpolate(blurred(small, sigma / shrink)[None], size, mode="bilinear")[0]
    reach = max(1, min(int(np.ceil(2.5 * sigma)), min(planes.shape[1:]) - 1))
    kernel = torch.exp(-0.5 * (torch.arange(-reach, reach + 1) / sigma) ** 2)
    kernel = (kernel / kernel.sum()).view(1, 1, -1, 1)
    padded = F.pad(planes[:, None], (reach, reach, reach, reach), mode="replicate")
    return F.conv2d(F.conv2d(padded, kernel), kernel.transpose(2, 3))[:, 0]


def _grown(plane: torch.Tensor, reach: int) -> torch.Tensor:
    return F.max_pool2d(plane[None, None], 2 * reach + 1, stride=1, padding=reach)[0, 0]
