"""Visibility (self-shadow) maps, as a user calls for them."""

import torch

from shadow import inputs
from shadow.framing import Framing, extend
from shadow.networks import checkpoints
from shadow.networks.field import VisibilityField
from shadow.networks.unet import LATENTS, PerLight
from shadow.normals import on_canvas, resolve

NETWORKS = {"field": VisibilityField} | dict.fromkeys(LATENTS, PerLight)


def load(name="field"):
    """The shipped visibility network, or one trained by `relight train shadow` (a .safetensors path): the
    field or the paper's per-light network, whichever the file says."""
    return checkpoints.load(name, NETWORKS, package="shadow")


def baseline(normals, directions):
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


def infer(rgb, mask, directions, *, normals=None, model="field"):
    """Visibility maps of the person in an image, for any light directions.

    Parameters
    ----------
    rgb: (H, W, 3) float, linear Rec.709, any size and exposure; NumPy or torch.
    mask: (H, W) in [0, 1], the matte of the person.
    directions: (D, 3) toward the lights, camera frame, any length but zero.
    normals: (H, W, 3) camera-frame normals to use instead of the field's own (for a per-light network, the
        shipped field's); or anything else that `shadow.normals.load` takes.
    model: name of shipped weights, or the path of a checkpoint of either kind of network.

    Returns
    -------
    (D, H, W) float32 in [0, 1], 1 = lit, zero outside the mask; binary = `> 0.5`. NumPy or torch, as `rgb`
    was, on its device. With the field the cost hardly depends on D (one network pass), with a per-light
    network it is D passes; the memory is 4 D H W bytes.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, an empty mask, a zero direction.
    """
    image = inputs.image("rgb", rgb)
    matte = inputs.mask("mask", mask, image.shape[1:]).to(image.device)
    lights = inputs.directions("directions", directions).to(image.device)
    network = load(model).to(image.device)
    framing = Framing.around(matte, network.size)
    framed, framed_mask = framing.crop(image), framing.crop(matte[None])[0]
    surface = on_canvas(resolve(normals, image, matte, network), framing)
    _, visibility = network.analyse(framed, framed_mask, surface)
    maps = framing.restore(extend(visibility(lights), framed_mask)).clamp(0, 1) * (matte > 0)
    return inputs.like(maps, rgb)
