"""Visibility (self-shadow) maps, as a user calls for them."""

import os

import torch

from shadow import inputs
from shadow.analysis import Array, Normals, analyse, load

__all__ = ["baseline", "infer", "load"]


def baseline(normals: Array, directions: Array) -> Array:
    """The sign(N·L) baseline of Section 4.1: lit where the surface faces the light.

    Parameters
    ----------
    normals: (H, W, 3) float, camera frame; zero vectors mark the outside of the mask.
    directions: (D, 3) light directions, any length but zero.

    Returns
    -------
    (D, H, W) float32, 0 or 1, zero outside the mask; NumPy or torch, as `normals` was.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, a zero-length direction.
    """
    surface = inputs.image("normals", normals)
    lights = inputs.directions("directions", directions).to(surface.device)
    return inputs.like((torch.einsum("dc,chw->dhw", lights, surface) > 0).float(), normals)


def infer(
    rgb: Array,
    mask: Array,
    directions: Array,
    *,
    normals: Normals | None = None,
    model: str | os.PathLike = "field",
) -> Array:
    """Visibility maps of the person in an image, for any light directions.

    Parameters
    ----------
    rgb, mask, normals, model: as of `shadow.analyse`.
    directions: (D, 3) toward the lights, camera frame, any length but zero.

    Returns
    -------
    (D, H, W) float32 in [0, 1], 1 = lit, zero outside the mask; binary = `> 0.5`. NumPy or torch, as `rgb`
    was, on its device. With the field the cost hardly depends on D (one network pass), with a per-light
    network it is D passes; the memory is 4 D H W bytes.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, an empty mask, a zero direction.
    """
    inputs.directions("directions", directions)  # what is wrong is said before the network runs
    return analyse(rgb, mask, normals=normals, model=model).visibility(directions)
