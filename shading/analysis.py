"""The analysis of a photographed person: that of `shadow`, with the albedo and the shading for any light."""

import os
from functools import cached_property

import torch

from shading import diffuse
from shadow import analysis, inputs
from shadow.analysis import Array, Normals, VisibilityNetwork
from shadow.framing import Framed
from shadow.matte_cleanup import clean_matte
from shadow.normals import on_canvas, resolve
from shadow.torch_settings import isolated, isolated_class


@isolated_class
class Analysis(analysis.Analysis):
    """What both networks inferred from one photograph. Made by `shading.analyse`.

    Attributes
    ----------
    framed, canvas_normals, canvas_visibility
        As in `shadow.Analysis`.
    canvas_shading
        A function from unit directions (D, 3) to linear shading (D, h, w) in [0, 1], tensors. The visibility
        (D, h, w) of these directions is an optional second argument.
    canvas_albedo
        (3, h, w) tensor, linear in [0, 1]; None from a network that infers no albedo.

    Examples
    --------
    >>> rgb, mask = np.full((64, 48, 3), 0.3, np.float32), np.zeros((64, 48), np.float32)
    >>> mask[8:56, 12:36] = 1
    >>> analysis = shading.analyse(rgb, mask)
    >>> analysis.shading([[0.0, 0.0, 1.0]]).shape, analysis.albedo.shape
    ((1, 64, 48), (64, 48, 3))
    """

    def __init__(
        self,
        framed: Framed,
        field: VisibilityNetwork,
        network: diffuse.ShadingNetwork,
        normals: torch.Tensor | None = None,
        like: inputs.Array | None = None,
    ) -> None:
        super().__init__(framed, field, normals, like)
        inferred = network.analyse(framed.rgb, framed.mask, self.canvas_normals, self.canvas_visibility)
        self.canvas_shading, self.canvas_albedo = inferred

    def shading(self, directions: inputs.Array, visibility: inputs.Array | None = None) -> Array:
        """Return the diffuse shading (D, H, W), float32 in [0, 1], by each light of unit intensity alone.

        It is linear and includes light that the body reflects onto itself. 1 is a surface that faces an
        unoccluded light (brighter values are clamped). It is zero outside the matte.

        `directions` (D, 3) point toward the lights. `visibility` (D, H, W) replaces the inferred visibility
        of these lights. Raises TypeError or ValueError for wrong shapes or dtypes, NaN or infinite values,
        values out of range, or a direction of zero length.
        """
        lights, seen = self._lights(directions), None
        if visibility is not None:
            given = inputs.visibility("visibility", visibility, (len(lights), *self.framed.matte.shape))
            seen = self.framed.framing.crop(given.to(lights.device))
        return self._restored(self.canvas_shading(lights, seen))

    @cached_property
    def albedo(self) -> Array:
        """Albedo (H, W, 3), float32, linear Rec.709 in [0, 1], zero outside the matte.

        It has the mean colour of the photograph and is upsampled from the network's resolution. Raises
        ValueError if the network infers no albedo.
        """
        if self.canvas_albedo is None:
            raise ValueError("model: infers shading only, expected one that infers albedo as well")
        maps = self.framed.restored(self.canvas_albedo).clamp(0, 1)
        return inputs.like(maps.permute(1, 2, 0), self._like)


@isolated
def analyse(
    rgb: inputs.Array,
    mask: inputs.Array,
    *,
    normals: Normals | None = None,
    model: str | os.PathLike = "shading",
    device: str | torch.device | None = None,
) -> Analysis:
    """Analyse the person in an image, once for any number of lights.

    Parameters
    ----------
    rgb
        (H, W, 3) float, linear Rec.709, any size and exposure; NumPy or torch.
    mask
        (H, W) in [0, 1], the matte of the person.
    normals
        (H, W, 3) camera-frame normals that replace those of the shipped visibility field, or anything else
        that `shadow.normals.load` accepts.
    model
        Name of shipped shading weights, or the path of a checkpoint.
    device
        Where the networks run, such as "cuda". By default where `rgb` is.

    Returns
    -------
    Analysis
        Its `normals`, `albedo`, `visibility(directions)` and `shading(directions)`. Both networks run once
        here; a light costs dot products.

    Raises
    ------
    TypeError, ValueError
        Wrong shape or dtype, NaN or infinite values, an empty mask, an unknown device.

    Examples
    --------
    >>> rgb, mask = np.full((64, 48, 3), 0.3, np.float32), np.zeros((64, 48), np.float32)
    >>> mask[8:56, 12:36] = 1
    >>> analysis = shading.analyse(rgb, mask)
    >>> analysis.shading([[0.0, 0.0, 1.0]]).shape, analysis.albedo.shape
    ((1, 64, 48), (64, 48, 3))
    """
    image, matte = inputs.photograph(rgb, mask, inputs.device("device", device))
    network, field = diffuse.load(model, image.device), analysis.load(device=image.device)
    matte = clean_matte(matte)
    framed = Framed.of(image, matte, network.size)
    surface = on_canvas(resolve(normals, image, matte, field, network), framed.framing)
    return Analysis(framed, field, network, surface, rgb)


@isolated
def infer(
    rgb: inputs.Array,
    mask: inputs.Array,
    directions: inputs.Array,
    *,
    normals: Normals | None = None,
    visibility: inputs.Array | None = None,
    model: str | os.PathLike = "shading",
) -> Array:
    """Infer the diffuse shading of the person in an image by each light of unit intensity alone.

    Parameters
    ----------
    rgb, mask, normals, model
        As in `analyse`.
    directions
        (D, 3) toward the lights, camera frame, any length but zero.
    visibility
        (D, H, W) in [0, 1], self-shadow maps that replace the inferred ones of these lights.

    Returns
    -------
    Array
        (D, H, W) float32, linear shading in [0, 1], including light that the body reflects onto itself. 1 is
        a surface that faces an unoccluded light. It is zero outside the mask. NumPy or torch, as `rgb` was,
        on its device.

    Raises
    ------
    TypeError, ValueError
        Wrong shape or dtype, NaN or infinite values, an empty mask, a zero direction.

    Examples
    --------
    >>> rgb, mask = np.full((64, 48, 3), 0.3, np.float32), np.zeros((64, 48), np.float32)
    >>> mask[8:56, 12:36] = 1
    >>> shading.infer(rgb, mask, [[0.0, 0.0, 1.0]]).shape
    (1, 64, 48)
    """
    inputs.directions("directions", directions)  # fail before the networks run
    return analyse(rgb, mask, normals=normals, model=model).shading(directions, visibility)
