"""Visibility (self-shadow) maps in one call, and the sign(N·L) baseline."""

import os

import torch

from shadow import inputs
from shadow.analysis import Array, Normals, analyse, load
from shadow.torch_settings import isolated

__all__ = ["baseline", "infer", "load"]


@isolated
def baseline(normals: inputs.Array, directions: inputs.Array) -> Array:
    """Return the sign(N·L) baseline of Section 4.1: lit where the surface faces the light.

    Parameters
    ----------
    normals
        (H, W, 3) float, camera frame; zero vectors mark the outside of the mask.
    directions
        (D, 3) light directions, any length but zero.

    Returns
    -------
    Array
        (D, H, W) float32, 0 or 1, zero outside the mask; NumPy or torch, as `normals` was.

    Raises
    ------
    TypeError, ValueError
        Wrong shape or dtype, NaN or infinite values, a zero-length direction.

    Examples
    --------
    >>> facing = np.zeros((2, 2, 3), np.float32)
    >>> facing[..., 2] = 1
    >>> shadow.baseline(facing, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])[:, 0, 0].tolist()
    [1.0, 0.0]
    """
    surface = inputs.image("normals", normals)
    lights = inputs.directions("directions", directions).to(surface.device)
    return inputs.like((torch.einsum("dc,chw->dhw", lights, surface) > 0).float(), normals)


@isolated
def infer(
    rgb: inputs.Array,
    mask: inputs.Array,
    directions: inputs.Array,
    *,
    normals: Normals | None = None,
    model: str | os.PathLike = "field",
) -> Array:
    """Infer visibility maps of the person in an image, for any light directions.

    Parameters
    ----------
    rgb, mask, normals, model
        As in `shadow.analyse`.
    directions
        (D, 3) toward the lights, camera frame, any length but zero.

    Returns
    -------
    Array
        (D, H, W) float32 in [0, 1], 1 = lit, zero outside the mask; binary = `> 0.5`. NumPy or torch, as
        `rgb` was, on its device. With the field, the cost hardly depends on D (one network pass); with a
        per-light network it is D passes. The maps take 4 D H W bytes.

    Raises
    ------
    TypeError, ValueError
        Wrong shape or dtype, NaN or infinite values, an empty mask, a zero direction.

    Examples
    --------
    >>> rgb, mask = np.full((64, 48, 3), 0.3, np.float32), np.zeros((64, 48), np.float32)
    >>> mask[8:56, 12:36] = 1
    >>> shadow.infer(rgb, mask, [[0.0, 0.0, 1.0]]).shape
    (1, 64, 48)
    """
    inputs.directions("directions", directions)  # fail before the network runs
    return analyse(rgb, mask, normals=normals, model=model).visibility(directions)
