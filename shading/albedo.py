"""Diffuse albedo of the photographed subject (delighting), and the light that it was photographed in."""

import os

import numpy as np
import torch
import torch.nn.functional as F
from scipy.optimize import nnls

from shading.analysis import analyse
from shadow import inputs
from shadow.analysis import Array, Normals
from shadow.directions import olat

FIT_HEIGHT = 64  # pixels of the picture that the lighting is solved on: light has no finer detail
SPREAD = 0.02  # share of the squared light that keeps the solution from one lamp where several would do


def infer_albedo(
    rgb: Array,
    mask: Array,
    *,
    normals: Normals | None = None,
    model: str | os.PathLike = "shading",
) -> Array:
    """Diffuse albedo of the person in an image, without the light it was photographed in.

    Parameters
    ----------
    As `shading.analyse`.

    Returns
    -------
    (H, W, 3) float32 linear Rec.709 in [0, 1], zero outside the mask, in the photograph's colours; at the
    network's resolution, enlarged. `relight.Subject` brings the plate's own texture back. NumPy or torch, as
    `rgb` was, on its device.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, an empty mask, a model that infers no
    albedo.
    """
    return analyse(rgb, mask, normals=normals, model=model).albedo


def infer_lighting(
    rgb: Array,
    mask: Array,
    *,
    normals: Normals | None = None,
    model: str | os.PathLike = "shading",
) -> tuple[Array, Array, Array]:
    """The light that the person was photographed in, and the albedo that goes with it.

    Image = albedo × Σ weight × shading: with the inferred albedo and the shadings of a fixed set of lights,
    the weights are a non-negative least-squares problem (Lawson and Hanson 1974), one for each colour.

    Parameters
    ----------
    As `infer_albedo`.

    Returns
    -------
    directions: (96, 3) float32 unit vectors, `shadow.directions.olat(behind=True)`.
    weights: (96, 3) float32, >= 0: linear Rec.709 intensity of each of these lights. What colour they had is
        in the albedo, which has the photograph's: together they are about white.
    albedo: (H, W, 3) float32 linear in [0, 1], as `infer_albedo` gives it, scaled so that the three of them
        make up the image's exposure.

    Raises
    ------
    As `infer_albedo`.
    """
    found = analyse(rgb, mask, normals=normals, model=model)
    albedo, framed = found.albedo, found.framed
    directions = torch.from_numpy(olat(behind=True)).to(framed.rgb.device)
    weights = solve_lighting(framed.rgb, found.canvas_albedo, found.canvas_shading(directions), framed.mask)
    return inputs.like(directions, rgb), inputs.like(weights, rgb), albedo


def solve_lighting(
    image: torch.Tensor, albedo: torch.Tensor, shading: torch.Tensor, mask: torch.Tensor
) -> torch.Tensor:
    """Non-negative weights (D, 3) with which the shadings (D, h, w) of D lights, times the albedo (3, h, w),
    make the linear image (3, h, w) inside the mask (h, w), in the sense of least squares."""
    step = max(1, mask.shape[0] // FIT_HEIGHT)
    inside = F.avg_pool2d((mask > 0.5).float()[None], step)[0] > 0.5

    def pixels(maps: torch.Tensor) -> np.ndarray:
        return F.avg_pool2d(maps, step)[:, inside].double().cpu().numpy()

    weights = []
    for colour, paint in zip(image, albedo, strict=True):
        explained, observed = pixels(shading * paint).T, pixels(colour[None])[0]
        ridge = SPREAD * np.sqrt((explained**2).sum(axis=0).mean())
        system = np.concatenate([explained, ridge * np.eye(len(shading))])
        weights.append(nnls(system, np.concatenate([observed, np.zeros(len(shading))]))[0])
    return torch.from_numpy(np.stack(weights, axis=1)).to(image)
