"""A model of the background behind a person: how far each colour is from the background's colours near by."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from relight.media.resampling import resize

STEP = 4  # pixels between samples of the background's colour
NEAR, FAR = 0.03, 0.1  # of the longer side: standard deviations of the Gaussians that weight them
FAR_SHARE = 1e-4  # weight of the far ones beside the near ones: they count where the near ones find nothing
LEAST_SHARE = 2e-8  # of what the Gaussians reach, by their weights: the background, at least
NOISE = 0.01  # standard deviation of a plain background's colours, encoded, at least
UNIFORM = 0.07  # standard deviation of the background's colours near by up to which they are nearly one
OUTLIER = 4.0  # standard deviations from the colours far around: what is so unlike them is an object


@dataclass(frozen=True)
class BackgroundModel:
    """How far a photograph's colours are from the background's colours near by; all are (h, w).

    distance: Mahalanobis' distance, in standard deviations; uniform: bool, where the background has nearly
    one colour.
    """

    distance: np.ndarray
    uniform: np.ndarray

    @classmethod
    def of(cls, seen: np.ndarray, background: np.ndarray) -> "BackgroundModel":
        """Return the model of a picture (h, w, 3), encoded, whose background is where `background` says so.

        `background` is (h, w), bool. The colours near a pixel count most, as far as there are any, and
        objects before the background, such as an umbrella, do not count.
        """
        colour = ndimage.gaussian_filter(seen, (0.7, 0.7, 0))
        few, weight = colour[::STEP, ::STEP], background[::STEP, ::STEP].astype(float)
        _, mean, covariance = _moments(few, weight, {FAR: 1.0})
        squares = ((_whitening(covariance) @ (few - mean)[..., None]) ** 2).sum((-1, -2))
        weight = weight * (squares < OUTLIER**2)
        share, mean, covariance = _moments(few, weight, {NEAR: 1.0, FAR: FAR_SHARE})
        uniform = (share > LEAST_SHARE) & (np.trace(covariance, axis1=2, axis2=3) < 3 * UNIFORM**2)
        whiten = _whitening(covariance)
        rows, columns = np.tril_indices(3)
        planes = [uniform[..., None], (whiten @ mean[..., None])[..., 0], whiten[..., rows, columns]]
        values = resize(np.concatenate(planes, axis=-1).astype(np.float32), seen.shape[:2], "triangle")
        whitened = np.zeros_like(colour)
        for index, (row, column) in enumerate(zip(rows, columns, strict=True)):
            whitened[..., row] += values[..., 4 + index] * colour[..., column]
        return cls(np.linalg.norm(whitened - values[..., 1:4], axis=-1), values[..., 0] > 0.5)


def _moments(
    few: np.ndarray, weight: np.ndarray, reaches: dict[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the total weight, the mean and the covariance of colours (h, w, 3) under sums of Gaussians.

    `reaches`: the Gaussians' standard deviations, of the longer side, and their weights.
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
