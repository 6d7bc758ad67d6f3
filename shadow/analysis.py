"""The analysis of a photographed person: the network runs once, then answers for any number of lights."""

import os
from collections.abc import Callable
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import torch
import torch.nn.functional as F

from shadow import inputs
from shadow.framing import Framed
from shadow.matte_cleanup import clean_matte
from shadow.networks import checkpoints
from shadow.networks.field import Visibility, VisibilityField
from shadow.networks.unet import LATENTS, PerLight
from shadow.normals import on_canvas, resolve
from shadow.torch_settings import isolated, isolated_class

VisibilityNetwork: TypeAlias = VisibilityField | PerLight
NETWORKS: dict[str, type[VisibilityNetwork]] = {"field": VisibilityField, **dict.fromkeys(LATENTS, PerLight)}

Visible: TypeAlias = Visibility | Callable[[torch.Tensor], torch.Tensor]  # of unit directions (D, 3)
Array = np.ndarray | torch.Tensor
Normals = Array | Callable | str | os.PathLike  # what `shadow.normals.load` takes


def load(name: str | os.PathLike = "field", device: torch.device | str = "cpu") -> Any:
    """Load the shipped visibility network, or one trained by `relight train shadow` (a .safetensors path).

    It is the field or the paper's per-light network, as the file says.
    """
    return checkpoints.load(name, NETWORKS, package="shadow", device=device)


@isolated_class
class Analysis:
    """What the visibility network inferred from one photograph. Made by `shadow.analyse`.

    Attributes
    ----------
    framed
        shadow.framing.Framed, the photograph on the networks' canvas of h x w pixels.
    canvas_normals
        (3, h, w) tensor of unit normals, zero outside the mask.
    canvas_visibility
        Unit directions (D, 3) to maps (D, h, w) in [0, 1], tensors, zero outside the mask.
    canvas_depth
        (h, w) tensor like `depth`, zero outside the mask; None from a network that infers no depth.

    Examples
    --------
    >>> rgb, mask = np.full((64, 48, 3), 0.3, np.float32), np.zeros((64, 48), np.float32)
    >>> mask[8:56, 12:36] = 1
    >>> analysis = shadow.analyse(rgb, mask)
    >>> analysis.visibility([[0.0, 0.0, 1.0]]).shape
    (1, 64, 48)
    """

    def __init__(
        self,
        framed: Framed,
        network: VisibilityNetwork,
        normals: torch.Tensor | None,
        like: inputs.Array | None = None,
        passes: int | None = None,
    ) -> None:
        """Run the network on a framed photograph; `normals` (3, h, w) replace the network's own.

        `passes` is that of `analyse`. Maps are returned in the type of `like`: tensors on its device, or
        NumPy arrays.
        """
        self.framed = framed
        self._like = like
        given = framed.rgb, framed.mask, normals
        if isinstance(network, VisibilityField) and passes is not None:
            inferred: tuple[torch.Tensor | None, Visible] = network.analyse(*given, passes=passes)
        else:
            inferred = network.analyse(*given)
        surface, self.canvas_visibility = inferred
        assert surface is not None  # a per-light network is given normals
        self.canvas_normals = surface
        self.canvas_depth: torch.Tensor | None = getattr(self.canvas_visibility, "depth", None)

    @cached_property
    def normals(self) -> Array:
        """Unit normals (H, W, 3), float32, in the camera frame (x right, y up, z to the camera).

        They are zero outside the matte.
        """
        maps = F.normalize(self.framed.restored(self.canvas_normals), dim=0)
        return inputs.like(maps.permute(1, 2, 0), self._like)

    @cached_property
    def depth(self) -> Array | None:
        """Depth (H, W), float32, along the camera's axis: positive away from the camera.

        It is relative to its mean over the subject, in units of the height of the matte, and zero outside the
        matte. It is None for networks that infer no depth: the paper's, and fields trained without it.
        """
        if self.canvas_depth is None:
            return None
        return inputs.like(self.framed.restored(self.canvas_depth[None])[0], self._like)

    def visibility(self, directions: inputs.Array) -> Array:
        """Return self-shadow maps (D, H, W), float32 in [0, 1]: 1 is lit, zero outside the matte.

        `directions` (D, 3) point toward the lights, in the camera frame, and may have any length but zero.
        For binary maps use `> 0.5`. The maps take 4 D H W bytes. Raises TypeError or ValueError for a wrong
        shape or dtype, NaN or infinite values, or a direction of zero length.
        """
        return self._restored(self.canvas_visibility(self._lights(directions)))

    def _lights(self, directions: inputs.Array) -> torch.Tensor:
        return inputs.directions("directions", directions).to(self.framed.rgb.device)

    def _restored(self, maps: torch.Tensor) -> Array:
        """Bring canvas maps (D, h, w) in [0, 1] to the plate (D, H, W), in the caller's type."""
        return inputs.like(self.framed.restored(maps).clamp(0, 1), self._like)


@isolated
def analyse(
    rgb: inputs.Array,
    mask: inputs.Array,
    *,
    normals: Normals | None = None,
    model: str | os.PathLike = "field",
    passes: int | None = None,
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
        (H, W, 3) camera-frame normals that replace those of the field (for a per-light network: of the
        shipped field), or anything else that `shadow.normals.load` accepts.
    model
        Name of shipped weights, or the path of a checkpoint of either kind of network.
    passes
        2 to average the field's maps of the photograph and of its mirror image, as by default, or 1 for those
        of the photograph alone in half the time. A per-light network takes None only.
    device
        Where the networks run, such as "cuda". By default where `rgb` is.

    Returns
    -------
    Analysis
        Its `normals`, `depth` and `visibility(directions)`. A light costs dot products with the field, and a
        network pass with a per-light network.

    Raises
    ------
    TypeError, ValueError
        Wrong shape or dtype, NaN or infinite values, an empty mask, an unknown device, other `passes`.

    Examples
    --------
    >>> rgb, mask = np.full((64, 48, 3), 0.3, np.float32), np.zeros((64, 48), np.float32)
    >>> mask[8:56, 12:36] = 1
    >>> analysis = shadow.analyse(rgb, mask)
    >>> analysis.visibility([[0.0, 0.0, 1.0]]).shape
    (1, 64, 48)
    """
    image, matte = inputs.photograph(rgb, mask, inputs.device("device", device))
    network = load(model, image.device)
    counted = isinstance(passes, int) and passes in (1, 2)
    if passes is not None and not (counted and isinstance(network, VisibilityField)):
        got = passes if isinstance(passes, int) else type(passes).__name__
        raise ValueError(f"passes: expected 1 or 2 with a field, None with another network, got {got}")
    matte = clean_matte(matte)
    framed = Framed.of(image, matte, network.size)
    surface = on_canvas(resolve(normals, image, matte, network), framed.framing)
    return Analysis(framed, network, surface, rgb, passes)
