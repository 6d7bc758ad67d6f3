"""A model of the background behind a person: how far each colour is from the background's colours near by.

`relight.matting.outline.holes` asks it where a mask takes the background for the person, and
`relight.matting.outline.lost_regions` where a mask takes the person for the background.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from relight.media.resampling import resize

STEP = 4  # pixels from one whose colour is gathered to the next
NEAR, FAR = 0.03, 0.1  # of the longer side: standard deviations of the Gaussians that gather them
FAR_SHARE = 1e-4  # weight of the far ones beside the near ones: they count where the near ones find nothing
LEAST_SHARE = 0.0002  # of what a Gaussian reaches: the background, at least
NOISE = 0.01  # standard deviation of a plain background's colours, encoded, at least
PLAIN = 0.07  # standard deviation of the background's colours near by up to which they are nearly one
THING = 4.0  # standard deviations from the colours far around: what is so unlike them stands before the wall
SHADES = (0.5, 1.1)  # of encoded values: how dark and how bright a wall's shade may be
COLOURED = 8.0  # standard deviations from grey: a grey wall's shades look like much of what people wear


@dataclass(frozen=True)
class Wall:
    """How far colours are from the wall's near by; all (h, w).

    off: standard deviations (Mahalanobis' distance) from the wall's colour; shaded: from that colour in the
    best of its shades, the same as `off` where the wall is grey; plain: bool, where the wall has nearly one
    colour.
    """

    off: np.ndarray
    shaded: np.ndarray
    plain: np.ndarray

    @classmethod
    def behind(cls, seen: np.ndarray, background: np.ndarray, local: bool = False) -> "Wall":
        """Return the wall that a picture (h, w, 3), encoded, shows where `background` (h, w), bool, says so.

        `local`: the colours near a pixel count most, as far as there are any, and what stands before the
        wall, such as an umbrella, does not count.
        """
        colour = ndimage.gaussian_filter(seen, (0.7, 0.7, 0))
        few, weight = colour[::STEP, ::STEP], background[::STEP, ::STEP].astype(float)
        share, mean, spread = _gathered(few, weight, {FAR: 1.0})
        least = LEAST_SHARE
        if local:
            squares = ((_whitening(spread) @ (few - mean)[..., None]) ** 2).sum((-1, -2))
            weight = weight * (squares < THING**2)
            share, mean, spread = _gathered(few, weight, {NEAR: 1.0, FAR: FAR_SHARE})
            least *= FAR_SHARE
        plain = (share > least) & (np.trace(spread, axis1=2, axis2=3) < 3 * PLAIN**2)
        whiten = _whitening(spread)
        offset = (whiten @ mean[..., None])[..., 0]
        hue = (whiten @ (mean - mean.mean(axis=-1, keepdims=True))[..., None])[..., 0]
        coloured = np.linalg.norm(hue, axis=-1) > COLOURED
        rows, columns = np.tril_indices(3)
        planes = [plain[..., None], coloured[..., None], offset, whiten[..., rows, columns]]
        values = resize(np.concatenate(planes, axis=-1).astype(np.float32), seen.shape[:2], "triangle")
        own, wall = np.zeros_like(colour), values[..., 2:5]
        for index, (row, column) in enumerate(zip(rows, columns, strict=True)):
            own[..., row] += values[..., 5 + index] * colour[..., column]
        off = np.linalg.norm(own - wall, axis=-1)
        shade = (own * wall).sum(axis=-1) / np.maximum((wall * wall).sum(axis=-1), 1e-9)
        shaded = np.linalg.norm(own - shade.clip(*SHADES)[..., None] * wall, axis=-1)
        return cls(off, np.where(values[..., 1] > 0.5, shaded, off), values[..., 0] > 0.5)


def _gathered(
    few: np.ndarray, weight: np.ndarray, reaches: dict[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the share, the mean and the covariance of colours (h, w, 3) that Gaussians gather.

    `reaches`: their standard deviations, of the longer side, and their weights.
    """
    size = weight.shape
    products = (few[..., :, None] * few[..., None, :]).reshape(*size, 9)
    values = np.concatenate([np.ones((*size, 1)), few, products], axis=-1) * weight[..., None]
    sums = np.zeros_like(values)
    for reach, times in reaches.items():
        sums += times * ndimage.gaussian_filter(values, (reach * max(size), reach * max(size), 0))
    share, means = sums[..., 0], sums[..., 1:] / np.maximum(sums[..., :1], 1e-9)
    mean = means[..., :3]
    spread = means[..., 3:].reshape(*size, 3, 3) - mean[..., :, None] * mean[..., None, :]
    return share, mean, spread + NOISE**2 * np.eye(3)


def _whitening(spread: np.ndarray) -> np.ndarray:
    """Return the matrices (h, w, 3, 3), lower triangles, that make these covariances one."""
    return np.linalg.inv(np.linalg.cholesky(spread))
