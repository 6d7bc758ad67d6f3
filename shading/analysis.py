"""One analysis of a photographed person: shadow's, and on top of it shading for any light, and albedo."""

import os
from functools import cached_property
from typing import Any

import torch

from shading import diffuse
from shadow import analysis, inputs
from shadow.analysis import Array, Normals
from shadow.framing import Framed
from shadow.mattes import person_in
from shadow.normals import on_canvas, resolve


class Analysis(analysis.Analysis):
    """What both networks found in one photograph. Made by `shading.analyse`.

    Attributes
    ----------
    framed, canvas_normals, canvas_visibility: as of `shadow.Analysis`.
    canvas_shading: unit directions (D, 3) to linear shading (D, h, w) in [0, 1], tensors; their visibility
        (D, h, w) may be given as well.
    canvas_albedo: (3, h, w) tensor, linear in [0, 1]; None from a network that infers none.
    """

    def __init__(
        self,
        framed: Framed,
        field: Any,
        network: Any,
        normals: torch.Tensor | None = None,
        like: Array | None = None,
    ) -> None:
        super().__init__(framed, field, normals, like)
        found = network.analyse(framed.rgb, framed.mask, self.canvas_normals, self.canvas_visibility)
        self.canvas_shading, self.canvas_albedo = found

    def shading(self, directions: Array, visibility: Array | None = None) -> Array:
        """Diffuse shading (D, H, W) float32 in [0, 1] by one light of unit intensity at a time.

        Linear, bounce light from the body included; 1 is a surface that faces an unoccluded light, or
        brighter; zero outside the matte.

        `directions` (D, 3) point toward the lights; their `visibility` (D, H, W) may be given. Raises
        TypeError or ValueError for wrong shapes or dtypes, NaN or infinite values, values out of range, or a
        direction of zero length.
        """
        lights, seen = self._lights(directions), None
        if visibility is not None:
            given = inputs.visibility("visibility", visibility, (len(lights), *self.framed.matte.shape))
            seen = self.framed.framing.crop(given.to(lights.device))
        return self._restored(self.canvas_shading(lights, seen))

    @cached_property
    def albedo(self) -> Array:
        """(H, W, 3) float32 linear Rec.709 in [0, 1], zero outside the matte, in the photograph's colours, at
        the network's resolution, enlarged. ValueError from a network that infers none."""
        if self.canvas_albedo is None:
            raise ValueError("model: infers shading only, expected one that infers albedo as well")
        maps = self.framed.restored(self.canvas_albedo).clamp(0, 1)
        return inputs.like(maps.permute(1, 2, 0), self._like)


def analyse(
    rgb: Array,
    mask: Array,
    *,
    normals: Normals | None = None,
    model: str | os.PathLike = "shading",
    device: str | torch.device | None = None,
) -> Analysis:
    """Analyse the person in an image, once.

    Parameters
    ----------
    rgb: (H, W, 3) float, linear Rec.709, any size and exposure; NumPy or torch.
    mask: (H, W) in [0, 1], the matte of the person.
    normals: (H, W, 3) camera-frame normals to use instead of inferring them with the shipped network; or
        anything else that `shadow.normals.load` takes.
    model: name of shipped shading weights, or the path of a checkpoint.
    device: where the networks run, such as "cuda"; where `rgb` is unless given.

    Returns
    -------
    Analysis: `normals`, `albedo`, `visibility(directions)` and `shading(directions)`. Two network passes in
    all; a light costs dot products.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, an empty mask, an unknown device.
    """
    image, matte = inputs.photograph(rgb, mask, inputs.device("device", device))
    network, field = diffuse.load(model, image.device), analysis.load(device=image.device)
    framed = Framed.of(image, person_in(matte), network.size)
    surface = on_canvas(resolve(normals, image, matte, field, network), framed.framing)
    return Analysis(framed, field, network, surface, rgb)


def infer(
    rgb: Array,
    mask: Array,
    directions: Array,
    *,
    normals: Normals | None = None,
    visibility: Array | None = None,
    model: str | os.PathLike = "shading",
) -> Array:
    """Diffuse shading of the person in an image, lit by one unit-intensity light at a time.

    Parameters
    ----------
    rgb, mask, normals, model: as of `analyse`.
    directions: (D, 3) toward the lights, camera frame, any length but zero.
    visibility: (D, H, W) in [0, 1], self-shadow maps of these lights to use instead of inferring them.

    Returns
    -------
    (D, H, W) float32 linear shading in [0, 1], bounce light from the body included; 1 is a surface facing an
    unoccluded light, or brighter; zero outside the mask. NumPy or torch, as `rgb` was, on its device.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, an empty mask, a zero direction.
    """
    inputs.directions("directions", directions)  # what is wrong is said before the networks run
    return analyse(rgb, mask, normals=normals, model=model).shading(directions, visibility)
