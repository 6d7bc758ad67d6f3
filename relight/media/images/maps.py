"""Mattes, normal maps and depths: their values are no colour, so no colour space is applied to them."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from relight.media.images.edge import coverage
from relight.media.images.reading import load
from relight.media.images.writing import Metadata, check_writable, checked_depth, new_spec, save
from shadow.directions import CAMERA, from_axes
from shadow.files import AnyPath


def read_mask(path: AnyPath) -> np.ndarray:
    """Read a matte: (H, W) float32 in [0, 1], from the alpha channel unless it is opaque, else from grey.

    A matte is coverage, not colour: its values are taken as they are stored. Raises as `read` does, and
    ValueError for a picture that is neither transparent nor grey.
    """
    pixels, _, names = load(path)
    if np.issubdtype(pixels.dtype, np.integer):
        pixels = pixels / np.float32(np.iinfo(pixels.dtype).max)
    if not np.isfinite(pixels).all():
        raise ValueError(f"{path}: contains NaN or infinite values")
    alpha = names.index("A") if "A" in names else -1  # of a GIF, OpenImageIO says a channel too far
    if alpha >= 0 and pixels[..., alpha].min() < 1:
        matte = pixels[..., alpha]
    else:
        matte = pixels[..., 0]
        if np.ptp(np.delete(pixels, alpha, axis=-1) if alpha >= 0 else pixels, axis=-1).max() > 0.01:
            raise ValueError(
                f"{path}: expected a mask (grey, or with transparency), got an opaque colour image"
            )
    return np.clip(matte, 0, 1, dtype=np.float32)


def write_mask(
    path: AnyPath, mask: ArrayLike, *, depth: str | None = None, metadata: Metadata | None = None
) -> None:
    """Write a matte as a grey image, which `read_mask` reads back: coverage as it is, no colour encoding.

    Parameters
    ----------
    path: .png, .tif or .exr. Its folder must exist.
    mask: (H, W) in [0, 1], or uint8 or uint16 over the full range.
    depth: as of `write`, but 16 bits unless given. metadata: as of `write`.

    Raises
    ------
    TypeError, ValueError: wrong shape, dtype or values, a format that may lose some. OSError: as of `write`.
    """
    path = Path(path)
    check_writable(path)
    if path.suffix.lower() not in (".exr", ".png", ".tif", ".tiff"):
        raise ValueError(f"{path}: expected .png, .tif or .exr for a matte")
    depth = checked_depth(path, depth or ("half" if path.suffix.lower() == ".exr" else "uint16"))
    pixels = coverage("mask", mask)[..., None]
    save(path, [pixels], new_spec(pixels.shape[:2], depth, ["Y"], metadata))


def read_depth(path: AnyPath) -> np.ndarray:
    """Read a depth: (H, W) float32, metres away from the camera, as they are stored.

    From the channel Z, unless the file has one channel alone. Raises as `read` does, and ValueError for other
    channels or for integers, of which nobody knows how many metres they are.
    """
    pixels, _, names = load(path)
    if "Z" not in names and len(names) > 1:
        raise ValueError(f"{path}: expected a channel Z, or one alone; got {', '.join(names)}")
    depth = pixels[..., names.index("Z") if "Z" in names else 0]
    if np.issubdtype(depth.dtype, np.integer):
        raise ValueError(f"{path}: holds integers, expected depth as floats, in metres")
    if not np.isfinite(depth).all():
        raise ValueError(f"{path}: contains NaN or infinite values")
    return np.asarray(depth, np.float32)


def read_normals(path: AnyPath, *, axes: str = CAMERA, layer: str | None = None) -> np.ndarray:
    """Read a normal map: unit vectors, as they are stored. No colour space is applied to them.

    Parameters
    ----------
    path: integers (PNG, TIFF) hold n = 2v - 1, v over their full range; floats (OpenEXR) n itself, signed.
    axes: what the file's first, second and third channel are measured along: "+x+y+z" is the camera frame (x
        right, y up, z to the camera), "+x-y-z" OpenCV's; see `shadow.directions.from_axes`. Normals in world
        space have to be turned by the camera's rotation first.
    layer: of an OpenEXR file, such as "N"; unless given, the channels R, G, B or X, Y, Z without a layer.

    Returns
    -------
    (H, W, 3) float32 in the camera frame; zero where the file holds no normal: black, white or mid-grey.

    Raises
    ------
    As `read` does, and ValueError for other channels, no such layer, unknown axes, or floats that are encoded
    as integers should be.
    """
    pixels, _, names = load(path)
    prefix = "" if layer is None else f"{layer}."
    for channels in ("RGB", "XYZ", "rgb", "xyz"):
        if all(prefix + channel in names for channel in channels):
            break
    else:
        wanted = f"{prefix}R, {prefix}G, {prefix}B or {prefix}X, {prefix}Y, {prefix}Z"
        raise ValueError(f"{path}: expected channels {wanted}; got {', '.join(names)}")
    stored = pixels[..., [names.index(prefix + channel) for channel in channels]]
    vectors = stored.astype(np.float32)
    if np.issubdtype(stored.dtype, np.integer):
        vectors = vectors * (2 / np.iinfo(stored.dtype).max) - 1
    if not np.isfinite(vectors).all():
        raise ValueError(f"{path}: contains NaN or infinite values")
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    known = (length > 0.5) & (length < 1.5)  # black and white decode to 1.73, mid-grey to 0
    if not known.any():
        raise ValueError(f"{path}: holds no vector of about unit length, expected normals")
    if vectors.min() >= 0 and np.median(length[known]) > 1.05:
        raise ValueError(f"{path}: holds floats in [0, 1], expected signed normals: decode it, n = 2v - 1")
    unit = np.divide(vectors, length, out=np.zeros_like(vectors), where=known)
    return unit @ from_axes(axes).T
