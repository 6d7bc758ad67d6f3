"""Validate public arguments: convert them to float32 tensors, or raise an error that names the argument."""

import sys
import warnings
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import ArrayLike

from shadow.errors import EmptyMatteError, refuse_gradient

Array = ArrayLike | torch.Tensor
PACKAGES = ("relight", "shading", "shadow", "torch")  # a warning shows the line that called these
MOST_LABELS = 128  # codes of a mask up to this one may be labels
LARGEST_VALUE = 1e15  # its square, summed over a picture, still fits in float32


def _tensor(name: str, value: Array, expected: str) -> torch.Tensor:
    refuse_gradient(name, value)
    if isinstance(value, torch.Tensor):
        tensor = value
    else:
        try:
            array = np.ascontiguousarray(value)
            array = array if array.flags.writeable else array.copy()  # torch has no read-only tensors
            tensor = torch.from_numpy(array.astype(array.dtype.newbyteorder("="), copy=False))
        except (TypeError, ValueError) as error:
            raise TypeError(f"{name}: expected {expected}, got {type(value).__name__}") from error
    if tensor.is_complex() or (tensor.dtype == torch.bool and name != "mask"):
        raise TypeError(f"{name}: expected {expected}, got dtype {tensor.dtype}")
    return tensor


def _finite(name: str, tensor: torch.Tensor) -> torch.Tensor:
    if tensor.numel() and not torch.isfinite(torch.stack(tensor.aminmax())).all():  # which pass NaN on
        raise ValueError(f"{name}: contains NaN or infinite values")
    return tensor


def image(name: str, value: Array) -> torch.Tensor:
    """Return a linear image (H, W, 3), float, as a (3, H, W) float32 tensor."""
    expected = "a float array of shape (H, W, 3), linear"
    tensor = _tensor(name, value, expected)
    if tensor.ndim != 3 or tensor.shape[-1] != 3 or 0 in tensor.shape:
        raise ValueError(f"{name}: expected {expected}, got shape {tuple(tensor.shape)}")
    if not tensor.is_floating_point():
        raise TypeError(f"{name}: expected {expected}, got dtype {tensor.dtype}")
    return _finite(name, tensor.float()).permute(2, 0, 1)


def bounded(name: str, pixels: torch.Tensor) -> torch.Tensor:
    """Return the pixels; raises ValueError if sums over them could overflow float32."""
    low, high = map(float, pixels.aminmax())
    if (largest := max(-low, high)) > LARGEST_VALUE:
        raise ValueError(f"{name}: expected values of at most {LARGEST_VALUE:g}, got {largest:g}")
    return pixels


def mask(name: str, value: Array, size: Sequence[int]) -> torch.Tensor:
    """Return a mask (H, W) in [0, 1], float or bool, of the image's size, as a float32 tensor (H, W).

    Raises EmptyMatteError if no value is above 0.5, and TypeError or ValueError for another mask.
    """
    expected = f"an array of shape {tuple(size)} in [0, 1], the size of the image"
    tensor = _tensor(name, value, expected)
    if tuple(tensor.shape) != tuple(size):
        raise ValueError(f"{name}: expected {expected}, got shape {tuple(tensor.shape)}")
    if not (tensor.is_floating_point() or tensor.dtype == torch.bool):
        raise TypeError(f"{name}: expected {expected}, got dtype {tensor.dtype}")
    tensor = _finite(name, tensor.float())
    low, high = tensor.aminmax()
    if low < 0 or high > 1:
        raise ValueError(f"{name}: expected values in [0, 1], got [{low:g}, {high:g}]")
    if high <= 0.5:
        raise EmptyMatteError(f"{name}: is empty (no value above 0.5), so there is no subject{faint(high)}")
    return tensor


def faint(highest: torch.Tensor | float) -> str:
    """Return what to do about the highest value of an empty mask, if it may be a label of 8 or 16 bits."""
    for full in (255, 65535):
        code = float(highest) * full
        if 1 <= round(code) <= MOST_LABELS and abs(code - round(code)) < 1e-3:
            return f": the highest is {round(code)} of {full}; multiply labels such as 0 and 1 by {full}"
    return ""


def directions(name: str, value: Array) -> torch.Tensor:
    """Return light directions (D, 3) of any length but zero as unit float32 vectors."""
    expected = "light directions of shape (D, 3)"
    tensor = _tensor(name, value, expected)
    if tensor.ndim != 2 or tensor.shape[-1] != 3 or len(tensor) == 0:
        raise ValueError(f"{name}: expected {expected}, got shape {tuple(tensor.shape)}")
    tensor = _finite(name, tensor.float())
    length = tensor.norm(dim=-1, keepdim=True)
    if (length < 1e-6).any():
        raise ValueError(f"{name}: direction {int((length[:, 0] < 1e-6).nonzero()[0])} has zero length")
    return tensor / length


def normals(name: str, value: Array, size: Sequence[int]) -> torch.Tensor:
    """Return camera-frame normals (H, W, 3) as a (3, H, W) float32 tensor; zero vectors stay zero."""
    tensor = image(name, value)
    if tuple(tensor.shape[1:]) != tuple(size):
        raise ValueError(f"{name}: expected shape {(*size, 3)}, got {(*tensor.shape[1:], 3)}")
    return torch.nn.functional.normalize(tensor, dim=0)


def visibility(name: str, value: Array, shape: Sequence[int]) -> torch.Tensor:
    """Return visibility maps (D, H, W) in [0, 1] as a float32 tensor."""
    tensor = _tensor(name, value, f"a float array of shape {shape} in [0, 1]")
    if tuple(tensor.shape) != tuple(shape):
        raise ValueError(f"{name}: expected shape {shape}, got {tuple(tensor.shape)}")
    tensor = _finite(name, tensor.float())
    if tensor.min() < 0 or tensor.max() > 1:
        raise ValueError(f"{name}: expected values in [0, 1], got [{tensor.min():g}, {tensor.max():g}]")
    return tensor


def device(name: str, value: str | torch.device | None) -> torch.device | None:
    """Return a torch.device that this machine has; None stays None."""
    if value is None:
        return None
    if not isinstance(value, str | torch.device):
        raise TypeError(
            f"{name}: expected a device of this machine, {_devices()}; got {type(value).__name__}"
        )
    try:
        place = torch.device(value)
    except (RuntimeError, TypeError) as error:
        raise ValueError(f"{name}: expected a device of this machine, {_devices()}; got {value!r}") from error
    if place.type == "meta":
        raise ValueError(f"{name}: 'meta' holds no values; expected a device of this machine, {_devices()}")
    try:
        torch.empty(0, device=place)
    except (AssertionError, AttributeError, ImportError, RuntimeError, NotImplementedError) as error:
        raise ValueError(
            f"{name}: {str(value)!r} is not available: this machine, or this build of torch "
            f"({torch.__version__}), has no such device; use {_devices()}"
        ) from error
    return place


def _devices() -> str:
    """Return the devices that torch can use here, for an error."""
    found = ["cpu"] + ["cuda"] * torch.cuda.is_available() + ["mps"] * torch.backends.mps.is_available()
    return " or ".join(found)


def photograph(
    rgb: Array, matte: Array, place: torch.device | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return a linear image (H, W, 3) and its matte (H, W) as tensors (3, H, W) and (H, W).

    They are on the device `place`, or on the image's device. Errors call the arguments `rgb` and `mask`.
    """
    pixels = bounded("rgb", image("rgb", rgb))
    coverage = mask("mask", matte, pixels.shape[1:])
    place = place or pixels.device
    return pixels.to(place), coverage.to(place)


def like(result: torch.Tensor, original: object) -> np.ndarray | torch.Tensor:
    """Return `result` in the type of `original`: a NumPy array, or a tensor on its device."""
    return result.to(original.device) if isinstance(original, torch.Tensor) else result.cpu().numpy()


def warn(message: str) -> None:
    """Emit a warning that shows the line from which our packages were called.

    Python 3.12 can do this with `skip_file_prefixes`; this package supports 3.11.
    """
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in PACKAGES:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, stacklevel=level)
