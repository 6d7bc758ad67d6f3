"""Diffuse shading of one light at a time (OLAT): max(N·L, 0) × visibility, linear, at most 1."""

import torch

from shadow import infer_normals, inputs
from shadow.visibility import infer as infer_visibility


def base(normals, visibility, directions):
    """The base image of Section 4.4 from tensors: (3, H, W), (D, H, W) and (D, 3) to (D, H, W)."""
    return torch.einsum("dc,chw->dhw", directions, normals).clamp_min(0) * visibility


def infer(rgb, mask, directions, *, normals=None, visibility=None):
    """Diffuse shading of the person in an image, lit by one unit-intensity light at a time.

    Parameters
    ----------
    rgb: (H, W, 3) float, linear Rec.709, any size and exposure; NumPy or torch.
    mask: (H, W) in [0, 1], the matte of the person.
    directions: (D, 3) toward the lights, camera frame, any length but zero.
    normals: (H, W, 3) camera-frame normals to use instead of inferring them.
    visibility: (D, H, W) in [0, 1] to use instead of inferring it.

    Returns
    -------
    (D, H, W) float32 linear shading in [0, 1]; 1 is a surface facing an unoccluded light; zero outside the
    mask. NumPy or torch, as `rgb` was, on its device.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, an empty mask, a zero direction.
    """
    image = inputs.image("rgb", rgb)
    matte = inputs.mask("mask", mask, image.shape[1:]).to(image.device)
    lights = inputs.directions("directions", directions).to(image.device)
    if normals is None:
        normals = infer_normals(rgb, mask)
    surface = inputs.normals("normals", normals, image.shape[1:]).to(image.device)
    if visibility is None:
        visibility = infer_visibility(rgb, mask, directions, normals=normals)
    lit = inputs.visibility("visibility", visibility, (len(lights), *image.shape[1:])).to(image.device)
    return inputs.like(base(surface, lit, lights) * (matte > 0), rgb)
