"""Arrays at the public edge: what a caller hands over becomes linear Rec.709, premultiplied, or an error."""

import os
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from relight.arguments import shown
from relight.media import colour
from relight.media.encodings import Encoding
from shadow.errors import refuse_gradient
from shadow.files import is_path

if TYPE_CHECKING:
    import torch

    from shadow import inputs


def scene_linear(name: str, image: "inputs.Array") -> np.ndarray:
    """Convert a public image to linear Rec.709, premultiplied; `name` is what an error calls it.

    (H, W, 3|4): uint8 and uint16 are sRGB-encoded with straight alpha; floating dtypes are scene-linear
    Rec.709 with premultiplied alpha. Returns float32, colour unbounded, alpha in [0, 1]. Raises TypeError for
    another dtype; ValueError for another shape, NaN or infinite values, or alpha outside [0, 1].
    """
    pixels = as_array(name, image)
    if pixels.dtype not in (np.uint8, np.uint16) and not np.issubdtype(pixels.dtype, np.floating):
        raise TypeError(f"{name}: expected uint8, uint16 or a floating dtype, got {pixels.dtype}")
    if pixels.ndim != 3 or pixels.shape[-1] not in (3, 4) or 0 in pixels.shape:
        raise ValueError(f"{name}: expected shape (H, W, 3) or (H, W, 4), got {pixels.shape}")
    integer = np.issubdtype(pixels.dtype, np.integer)
    linear = linearise(pixels, straight=integer, space=colour.SRGB if integer else colour.LINEAR)
    if not linear.flags.writeable:  # torch has no read-only tensors
        linear = linear.copy()
    if not np.isfinite(linear).all():
        raise ValueError(f"{name}: contains NaN or infinite values")
    if linear.shape[-1] == 4:
        alpha = linear[..., 3]
        low, high = alpha.min(), alpha.max()
        if low < -1e-3 or high > 1 + 1e-3:  # filtering overshoots a little
            raise ValueError(f"{name}: expected alpha in [0, 1], got [{low:g}, {high:g}]")
        if low < 0 or high > 1:
            linear = np.concatenate([linear[..., :3], alpha[..., None].clip(0, 1)], axis=-1)
    return linear


def without_empty_alpha(name: str, plate: np.ndarray) -> np.ndarray:
    """Return a plate (H, W, 3|4), without its alpha if that is zero everywhere beside light; warn of it.

    Cameras' converters and compositors leave such a channel. Alpha of zero without light cuts all out.
    """
    if plate.shape[-1] == 3 or plate[..., 3].any() or not plate[..., :3].any():
        return plate
    warnings.warn(
        f"{name}: its alpha is 0 everywhere, which is no matte; its colours count alone", stacklevel=3
    )
    return np.ascontiguousarray(plate[..., :3])


def as_array(name: str, value: "inputs.Array") -> np.ndarray:
    """Return whatever a caller hands over as a NumPy array in this machine's byte order.

    Raises TypeError if it is no array, such as a ragged list, ValueError for a tensor that requires a
    gradient; `name` is what the error calls it.
    """
    if is_path(value):
        raise TypeError(
            f"{name}: expected an array, got the path {shown(os.fspath(value))}; read it with relight.read"
        )
    refuse_gradient(name, value)
    if hasattr(value, "cpu"):  # a tensor, without importing torch to ask
        tensor = value.cpu()
        value = tensor.float() if str(tensor.dtype) == "torch.bfloat16" else tensor  # NumPy has no such type
    try:
        array = np.asarray(value)
    except (RecursionError, RuntimeError, TypeError, ValueError) as error:
        raise TypeError(f"{name}: expected an array, got {type(value).__name__}: {error}") from error
    return array.astype(array.dtype.newbyteorder("="), copy=False)


def linearise(pixels: np.ndarray, *, straight: bool, space: colour.Space) -> np.ndarray:
    """Convert pixels (H, W, 3|4) of a colour space, straight or premultiplied, to linear premultiplied."""
    if pixels.shape[-1] == 3:
        return colour.decode(pixels, space)
    rgb, alpha = pixels[..., :3], pixels[..., 3:]
    if np.issubdtype(pixels.dtype, np.integer):
        alpha = alpha / np.float32(np.iinfo(pixels.dtype).max)
    is_rec709 = isinstance(space, str) and colour.resolve(space) == colour.resolve(colour.LINEAR)
    if is_rec709 and not straight and np.issubdtype(pixels.dtype, np.floating):
        return np.ascontiguousarray(pixels, np.float32)
    if not straight and _is_light(space):  # of other primaries: light without coverage stays
        return np.concatenate([colour.decode(rgb, space), alpha], axis=-1, dtype=np.float32)
    if not straight:  # the encoding was applied before the alpha: take the alpha out first
        scale = np.iinfo(pixels.dtype).max if np.issubdtype(pixels.dtype, np.integer) else 1
        rgb = np.divide(rgb / np.float32(scale), alpha, out=np.zeros(rgb.shape, np.float32), where=alpha > 0)
    return np.concatenate([colour.decode(rgb, space) * alpha, alpha], axis=-1, dtype=np.float32)


def _is_light(space: colour.Space) -> bool:
    """Return whether values of a space are linear light, in any primaries."""
    if isinstance(space, str):
        return colour.is_linear(space)
    return isinstance(space, tuple) or (isinstance(space, Encoding) and space.is_linear)


def coverage(name: str, mask: "inputs.Array") -> np.ndarray:
    """Convert a public matte to (H, W) float32 in [0, 1].

    `mask` is bool, floating in [0, 1], or uint8 or uint16 over the full range. Raises TypeError for another
    dtype, ValueError for another shape, NaN or values out of range; `name` is what the error calls it.
    """
    matte = as_array(name, mask)
    matte = matte.astype(np.float32) if matte.dtype == bool else matte
    if matte.dtype not in (np.uint8, np.uint16) and not np.issubdtype(matte.dtype, np.floating):
        raise TypeError(f"{name}: expected uint8, uint16 or a floating dtype, got {matte.dtype}")
    if matte.ndim != 2 or 0 in matte.shape:
        raise ValueError(f"{name}: expected shape (H, W), got {matte.shape}")
    if np.issubdtype(matte.dtype, np.integer):
        return matte / np.float32(np.iinfo(matte.dtype).max)
    if not (matte.min() >= 0 and matte.max() <= 1):
        raise ValueError(f"{name}: expected values in [0, 1], got [{matte.min():g}, {matte.max():g}]")
    return matte.astype(np.float32)


def person_mask(name: str, mask: "inputs.Array", size: Sequence[int]) -> "torch.Tensor":
    """Convert a public matte of a person, which an error calls `name`, to a float32 tensor (H, W) in [0, 1].

    (H, W), which `size` must be: floats or bools in [0, 1], or uint8 or uint16 over the full range. Raises
    TypeError or ValueError for another dtype or shape, NaN or values out of range; EmptyMatteError if no
    coverage is above one half.
    """
    from shadow import inputs

    values = as_array(name, mask)
    values = coverage(name, values) if values.dtype.kind == "u" else values
    return inputs.mask(name, values, size)
