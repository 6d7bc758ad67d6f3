"""Estimate the diffuse albedo of a photographed person (delighting), and the light of the photograph."""

import os

import numpy as np
import torch
import torch.nn.functional as F

from shading.analysis import analyse
from shadow import inputs
from shadow.analysis import Array, Normals
from shadow.directions import olat
from shadow.torch_settings import isolated

FIT_HEIGHT = 128  # rows of the picture from which the lighting is solved: twice as many are no better
DARK = 0.1  # of the mean, added to a pixel's value before the square root that its error is relative to
RIDGE = 0.02  # ridge penalty, relative to the mean squared light, which spreads light over similar directions


@isolated
def infer_albedo(
    rgb: inputs.Array,
    mask: inputs.Array,
    *,
    normals: Normals | None = None,
    model: str | os.PathLike = "shading",
) -> Array:
    """Infer the diffuse albedo of the person in an image.

    Parameters
    ----------
    rgb, mask, normals, model
        See `shading.analyse`.

    Returns
    -------
    Array
        (H, W, 3) float32, linear Rec.709 in [0, 1], zero outside the mask. It has the mean colour of the
        photograph and is upsampled from the network's resolution; `relight.Subject` restores the texture of
        the plate. NumPy or torch, as `rgb` was, on its device.

    Raises
    ------
    TypeError, ValueError
        Wrong shape or dtype, NaN or infinite values, an empty mask, a model that infers no albedo.

    Examples
    --------
    >>> rgb, mask = np.full((64, 48, 3), 0.3, np.float32), np.zeros((64, 48), np.float32)
    >>> mask[8:56, 12:36] = 1
    >>> shading.infer_albedo(rgb, mask).shape
    (64, 48, 3)
    """
    return analyse(rgb, mask, normals=normals, model=model).albedo


@isolated
def infer_lighting(
    rgb: inputs.Array,
    mask: inputs.Array,
    *,
    normals: Normals | None = None,
    model: str | os.PathLike = "shading",
) -> tuple[Array, Array, Array]:
    """Estimate the light in which the person was photographed, and the albedo.

    Image = albedo × Σ weight × shading. With the inferred albedo and the shadings of a fixed set of lights,
    the weights of each colour channel solve a non-negative least-squares problem (Lawson and Hanson 1974).

    Parameters
    ----------
    rgb, mask, normals, model
        See `shading.analyse`.

    Returns
    -------
    directions : Array
        (96, 3) float32 unit vectors, `shadow.directions.olat(behind=True)`.
    weights : Array
        (96, 3) float32, >= 0: the linear Rec.709 intensity of each of these lights, in the exposure of the
        image. Their sum is about white, because the mean colour of the light is part of the albedo.
    albedo : Array
        (H, W, 3) float32, linear in [0, 1], that of `infer_albedo`.

    Raises
    ------
    TypeError, ValueError
        See `infer_albedo`.

    Examples
    --------
    >>> rgb, mask = np.full((64, 48, 3), 0.3, np.float32), np.zeros((64, 48), np.float32)
    >>> mask[8:56, 12:36] = 1
    >>> directions, weights, albedo = shading.infer_lighting(rgb, mask)
    """
    analysis = analyse(rgb, mask, normals=normals, model=model)
    albedo, framed = analysis.albedo, analysis.framed
    directions = torch.from_numpy(olat(behind=True)).to(framed.rgb.device)
    assert analysis.canvas_albedo is not None
    weights = solve_lighting(
        framed.rgb, analysis.canvas_albedo, analysis.canvas_shading(directions), framed.mask
    )
    return inputs.like(directions, rgb), inputs.like(weights, rgb), albedo


def solve_lighting(
    image: torch.Tensor, albedo: torch.Tensor, shading: torch.Tensor, mask: torch.Tensor
) -> torch.Tensor:
    """Solve for the non-negative weights (D, 3) of D lights by least squares inside the mask (h, w).

    The weighted sum of their shadings (D, h, w), times the albedo (3, h, w), approximates the linear image
    (3, h, w). Errors are relative to about the square root of the image, as errors in encoded values are:
    otherwise bright pixels alone would decide, and shadows would come out too dark or too light.
    """
    from scipy.optimize import nnls  # the import takes a tenth of a second, and few calls need it

    step = max(1, mask.shape[0] // FIT_HEIGHT)
    inside = F.avg_pool2d((mask > 0.5).float()[None], step)[0] > 0.5

    def pixels(maps: torch.Tensor) -> np.ndarray:
        return F.avg_pool2d(maps, step)[:, inside].double().cpu().numpy()

    weights = []
    for colour, paint in zip(image, albedo, strict=True):
        explained, observed = pixels(shading * paint).T, pixels(colour[None])[0]
        relative = (observed + DARK * observed.mean()).clip(1e-12) ** -0.5
        explained, observed = explained * relative[:, None], observed * relative
        ridge = RIDGE * np.sqrt((explained**2).sum(axis=0).mean())
        system = np.concatenate([explained, ridge * np.eye(len(shading))])
        weights.append(nnls(system, np.concatenate([observed, np.zeros(len(shading))]))[0])
    return torch.from_numpy(np.stack(weights, axis=1)).to(image)
