"""One analysis of a photographed person: the network runs once, then any number of lights may be asked."""

import os
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F

from shadow import inputs
from shadow.framing import Framed
from shadow.mattes import person_in
from shadow.networks import checkpoints
from shadow.networks.field import VisibilityField
from shadow.networks.unet import LATENTS, PerLight
from shadow.normals import on_canvas, resolve

NETWORKS = {"field": VisibilityField} | dict.fromkeys(LATENTS, PerLight)

Array = np.ndarray | torch.Tensor
Normals = Array | Callable | str | os.PathLike  # whatever `shadow.normals.load` takes


def load(name: str | os.PathLike = "field", device: torch.device | str = "cpu") -> Any:
    """The shipped visibility network, or one trained by `relight train shadow` (a .safetensors path): the
    field or the paper's per-light network, whichever the file says."""
    return checkpoints.load(name, NETWORKS, package="shadow", device=device)


class Analysis:
    """What the visibility network found in one photograph. Made by `shadow.analyse`.

    Attributes
    ----------
    framed: shadow.framing.Framed, the photograph on the networks' canvas of h x w pixels.
    canvas_normals: (3, h, w) tensor of unit normals, zero outside the mask.
    canvas_visibility: unit directions (D, 3) to maps (D, h, w) in [0, 1], tensors, zero outside the mask.
    canvas_depth: (h, w) tensor as `depth`, zero outside the mask; None where the network says nothing of it.
    """

    def __init__(
        self, framed: Framed, network: Any, normals: torch.Tensor | None, like: Array | None = None
    ) -> None:
        """From a photograph on the canvas; `normals` (3, h, w) take the place of the network's own. Maps are
        handed out as what `like` is: tensors on its device, or else NumPy arrays."""
        self.framed = framed
        self._like: Any = like
        self.canvas_normals, self.canvas_visibility = network.analyse(framed.rgb, framed.mask, normals)
        self.canvas_depth: torch.Tensor | None = getattr(self.canvas_visibility, "depth", None)

    @cached_property
    def normals(self) -> Array:
        """(H, W, 3) float32 unit vectors in the camera frame (x right, y up, z to the camera), zero outside
        the matte."""
        maps = F.normalize(self.framed.restored(self.canvas_normals), dim=0)
        return inputs.like(maps.permute(1, 2, 0), self._like)

    @cached_property
    def depth(self) -> Array | None:
        """(H, W) float32 along the camera's axis, positive away from the camera, relative to its mean over
        the subject, in units of the height that the matte shows; zero outside the matte.

        None from networks that infer no depth: the paper's, and fields trained before there was any.
        """
        if self.canvas_depth is None:
            return None
        return inputs.like(self.framed.restored(self.canvas_depth[None])[0], self._like)

    def visibility(self, directions: Array) -> Array:
        """Self-shadow maps (D, H, W) float32 in [0, 1]: 1 is lit, zero outside the matte; binary = `> 0.5`.

        `directions` (D, 3) point toward the lights, camera frame, any length but zero. The memory is 4 D H W
        bytes. Raises TypeError or ValueError for a wrong shape or dtype, NaN or infinite values, or a
        direction of zero length.
        """
        return self._restored(self.canvas_visibility(self._lights(directions)))

    def _lights(self, directions: Array) -> torch.Tensor:
        return inputs.directions("directions", directions).to(self.framed.rgb.device)

    def _restored(self, maps: torch.Tensor) -> Array:
        """Canvas maps (D, h, w) in [0, 1] as the caller's (D, H, W)."""
        return inputs.like(self.framed.restored(maps).clamp(0, 1), self._like)


def analyse(
    rgb: Array,
    mask: Array,
    *,
    normals: Normals | None = None,
    model: str | os.PathLike = "field",
    device: str | torch.device | None = None,
) -> Analysis:
    """Analyse the person in an image, once.

    Parameters
    ----------
    rgb: (H, W, 3) float, linear Rec.709, any size and exposure; NumPy or torch.
    mask: (H, W) in [0, 1], the matte of the person.
    normals: (H, W, 3) camera-frame normals to use instead of the field's own (for a per-light network, the
        shipped field's); or anything else that `shadow.normals.load` takes.
    model: name of shipped weights, or the path of a checkpoint of either kind of network.
    device: where the networks run, such as "cuda"; where `rgb` is unless given.

    Returns
    -------
    Analysis: its `normals` and `depth`, and its `visibility(directions)`. With the field a light costs dot
    products and no network, with a per-light network one pass.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, an empty mask, an unknown device.
    """
    image, matte = inputs.photograph(rgb, mask, inputs.device("device", device))
    network = load(model, image.device)
    framed = Framed.of(image, person_in(matte), network.size)
    surface = on_canvas(resolve(normals, image, matte, network), framed.framing)
    return Analysis(framed, network, surface, rgb)
