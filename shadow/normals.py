"""Surface normals of the photographed person in the camera frame, from the field or from another source."""

from pathlib import Path
from typing import Any, Protocol, TypeGuard, cast

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

from shadow import inputs
from shadow.directions import CAMERA, from_axes
from shadow.files import is_path
from shadow.framing import Framed, Framing
from shadow.matte_cleanup import clean_matte
from shadow.networks import checkpoints, pifuhd
from shadow.networks.field import VisibilityField
from shadow.networks.foreign import OnnxNormals
from shadow.torch_settings import isolated


class NormalsSource(Protocol):
    """What infers normals: a network, or what a user provides in its place."""

    def normals(self, rgb: torch.Tensor, mask: torch.Tensor) -> torch.Tensor: ...


class ProvidedNormals:
    """Normals that the user provides: an array, or a function of the image."""

    def __init__(self, values: object, axes: str = CAMERA, origin: checkpoints.Origin | None = None) -> None:
        self.values, self.matrix, self.origin = values, torch.from_numpy(from_axes(axes)), origin

    def normals(self, rgb: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return unit normals (3, H, W), zero outside the mask, of linear rgb (3, H, W) and mask (H, W)."""
        values = self.values
        if callable(values):
            values = values(rgb.permute(1, 2, 0).contiguous().cpu().numpy(), mask.cpu().numpy())
        given = inputs.normals("normals", cast(inputs.Array, values), mask.shape).to(mask.device)
        vectors = torch.einsum("ij,jhw->ihw", self.matrix.to(mask.device), given) * (mask > 0)
        if vectors[2].sum() < 0:
            raise ValueError("normals: point away from the camera; give their axes, such as +x-y-z")
        return vectors


def load(
    source: object = "field",
    *,
    axes: str = CAMERA,
    order: str | None = None,
    device: torch.device | str = "cpu",
) -> Any:
    """Load a source of normals, for `infer_normals` and for every argument `normals`.

    It is one of the following:

    - "field", the shipped visibility field, or the .safetensors file of a field that was trained by `relight
      train shadow`;
    - the path of your own PIFuHD checkpoint, a .pt file (see `shadow.networks.pifuhd`);
    - the path of your own .onnx file (extra `matte`): DAViD's normals and multi-task models are recognised by
      their inputs and outputs, any other needs `order` (see `shadow.networks.foreign.OnnxNormals`);
    - a function (rgb, mask) -> (H, W, 3) of float32 NumPy arrays: the photograph (H, W, 3), linear Rec.709,
      and the matte (H, W) in [0, 1];
    - an array (H, W, 3) of the photograph's size, such as `relight.read_normals` reads from an image.

    `axes`: of the vectors of a function, an array or an ONNX file: "+x+y+z" is the camera frame (x right, y
    up, z to the camera), "+x-y-z" OpenCV's; see `shadow.directions.from_axes`. `order`: channel order, "rgb"
    or "bgr", of the input of an ONNX file that is not DAViD's. `device`: where a network that is loaded from
    a file runs; an ONNX file runs on the CPU.

    Returns an object with the method `normals(rgb, mask)`. It takes tensors (3, H, W), linear, and (H, W),
    and returns unit normals (3, H, W) in the camera frame, zero outside the mask. A field expects both on its
    canvas.

    Raises FileNotFoundError, and ValueError for no such weights, a damaged file, another kind of network,
    unknown axes, or axes given for a network whose convention is known.
    """
    if not is_path(source):
        if not _infers_normals(source):
            name = getattr(source, "__name__", "a function") if callable(source) else "another program"
            return ProvidedNormals(source, axes, checkpoints.Origin(name, None, {}))
    elif Path(source).suffix.lower() == ".onnx":
        return OnnxNormals(source, axes=axes, order=order)
    if order is not None:
        raise ValueError("order: applies to .onnx files only; leave it out")
    if axes != CAMERA:
        known = source if is_path(source) else type(source).__name__
        raise ValueError(f"axes: those of {known} are known; leave axes out, got {axes!r}")
    if not is_path(source):
        return source
    if Path(source).suffix in ("", ".safetensors"):
        return checkpoints.load(source, {"field": VisibilityField}, package="shadow", device=device)
    if Path(source).suffix == ".pt":
        return pifuhd.load(source, device)
    raise ValueError(
        f"normals: expected a name, a .safetensors, a .pt or an .onnx, got {source}; "
        "relight.read_normals reads images"
    )


def _infers_normals(source: object) -> TypeGuard[NormalsSource]:
    return callable(getattr(source, "normals", None))


def on_plate(source: NormalsSource, rgb: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return unit normals (3, H, W), zero outside the mask, of a photograph (3, H, W) and its matte (H, W).

    The photograph is linear. `source` is what `load` returns. A field sees the person on its canvas. A
    network runs on the device to which it was loaded.
    """
    here = rgb.device
    if isinstance(source, nn.Module):
        device = next(source.parameters()).device
        rgb, mask = rgb.to(device), mask.to(device)
    if not isinstance(source, VisibilityField):
        return source.normals(rgb, mask).to(here)
    framed = Framed.of(rgb, mask, source.size)
    return F.normalize(framed.restored(source.normals(framed.rgb, framed.mask)), dim=0).to(here)


def resolve(
    given: object, rgb: Any, mask: torch.Tensor, network: nn.Module, *more: nn.Module
) -> torch.Tensor | None:
    """Return the normals that the networks are given, (3, H, W) on the plate, or None for the field's own.

    The result is None if `network` is a visibility field and its own normals are used. Warns if `network`, or
    one of `more` that take the same normals, was trained with normals from another source. An array gives no
    warning, since its source is unknown.
    """
    if given is None:
        source = network if isinstance(network, VisibilityField) else load(device=rgb.device)
    elif callable(given) or _infers_normals(given) or is_path(given):
        source = load(given, device=rgb.device)
    else:
        source = ProvidedNormals(given)
    for trained in (network, *more):
        _warn_if_unfamiliar(trained, source)
    same = getattr(source, "origin", source) == getattr(network, "origin", network)
    return None if same else on_plate(source, rgb, mask)


def _warn_if_unfamiliar(network: nn.Module, source: object) -> None:
    """Warn if a network was trained with normals from another source."""
    used, own = getattr(source, "origin", None), getattr(network, "origin", None)
    if used is None or own is None or own.recipe.get("normals") is None:
        return
    name, checksum = own.recipe["normals"], own.recipe.get("normals_sha256")
    same = name == used.name if checksum is None else checksum == used.sha256
    if same:
        return
    inputs.warn(
        f"the network {own.name!r} was trained with the normals of {_label(name, checksum)} and is given "
        f"those of {_label(used.name, used.sha256)}, whose errors it has not learned to expect (Table 3)"
    )


def _label(name: str, checksum: str | None) -> str:
    return repr(name) if checksum is None else f"{name!r} ({checksum[:8]})"


def on_canvas(given: torch.Tensor | None, framing: Framing) -> torch.Tensor | None:
    """Resample the result of `resolve` to the canvas: unit normals (3, h, w); None stays None."""
    return None if given is None else F.normalize(framing.crop(given), dim=0)


@isolated
def infer_normals(
    rgb: np.ndarray | torch.Tensor, mask: np.ndarray | torch.Tensor, *, model: object = "field"
) -> np.ndarray | torch.Tensor:
    """Infer surface normals of the person in an image.

    Parameters
    ----------
    rgb
        (H, W, 3) float, linear Rec.709, any size and exposure; NumPy or torch.
    mask
        (H, W) in [0, 1], the matte of the person.
    model
        Name of shipped weights, path of a checkpoint, or anything else that `shadow.normals.load` accepts.

    Returns
    -------
    np.ndarray | torch.Tensor
        (H, W, 3) float32 unit vectors in the camera frame (x right, y up, z to the camera), zero outside the
        mask. NumPy or torch, as `rgb` was, on its device.

    Raises
    ------
    TypeError, ValueError
        Wrong shape or dtype, NaN or infinite values, an empty mask.

    Examples
    --------
    >>> rgb, mask = np.full((64, 48, 3), 0.3, np.float32), np.zeros((64, 48), np.float32)
    >>> mask[8:56, 12:36] = 1
    >>> shadow.infer_normals(rgb, mask).shape
    (64, 48, 3)
    """
    image, matte = inputs.photograph(rgb, mask)
    if not (is_path(model) or callable(model) or _infers_normals(model) or getattr(model, "ndim", False)):
        raise TypeError(
            f"model: expected the name of weights, a file or a network, got {type(model).__name__}"
        )
    source = load(model, device=image.device)
    return inputs.like(on_plate(source, image, clean_matte(matte)).permute(1, 2, 0), rgb)
