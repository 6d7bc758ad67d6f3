"""Mattes, normal maps and depths: their values are no colour, so no colour space is applied to them."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from relight import quantities
from relight.arguments import checks_arguments
from relight.media import colour
from relight.media.images.arrays import coverage
from relight.media.images.containers.exr import save_exr
from relight.media.images.decode import layers_of, load
from relight.media.images.encode import save
from relight.media.images.layers import Layer, StoredPicture, find_beauty
from relight.media.images.read_image import squared
from relight.media.images.write_image import check_writable, checked_depth, new_spec
from relight.media.matte import matte_of
from relight.media.streams import as_file, is_stream
from shadow.directions import CAMERA, from_axes
from shadow.files import AnyPath

UNNAMED = re.compile(r"channel\d+")
GREY = 0.01  # most that red, green and blue of a grey picture differ


@checks_arguments
def read_mask(path: quantities.FileOrStream, *, layer: str | None = None) -> np.ndarray:
    """Read a matte (H, W), float32 in [0, 1], from the alpha channel, or from grey if there is no alpha.

    A matte is coverage, not colour, so no colour space is applied. An opaque alpha channel is ignored.
    `path` may be a stream, and `layer` is a layer of an OpenEXR file, as in `relight.read`. Raises as `read`
    does, and ValueError for a picture that is neither transparent nor grey, or for object numbers (OpenEXR's
    UINT) other than 0 and 1.

    Examples
    --------
    >>> matte = relight.read_mask("matte.png")
    >>> float(matte.max())
    1.0
    """
    if is_stream(path):
        with as_file(path) as file:
            return read_mask(file, layer=layer)
    if layer is None and Path(path).suffix.lower() == ".exr" and Path(path).is_file():
        layer = _picture_layer(layers_of(path))
    stored = load(path, layer=layer, space=colour.LINEAR)
    matte = squared(path, _coverage(path, stored), stored.aspect)
    return np.clip(matte, 0, 1, dtype=np.float32)


def _picture_layer(layers: dict[str, Layer]) -> str | None:
    """Return the name of the picture's layer where all channels have one, as Blender's; else None."""
    if "" in layers:
        return None
    try:
        picture = find_beauty(layers)
    except ValueError:
        return None
    return next(name for name, layer in layers.items() if layer is picture)


def _coverage(path: AnyPath, stored: StoredPicture) -> np.ndarray:
    """Return the matte (H, W) of a picture's channels, as they are stored."""
    pixels, names = stored.pixels, stored.names
    if np.issubdtype(pixels.dtype, np.integer):
        pixels = pixels / np.float32(np.iinfo(pixels.dtype).max)
    if not np.isfinite(pixels).all():
        raise ValueError(f"{path}: contains NaN or infinite values")
    if stored.unsigned and pixels.max() > 1:
        raise ValueError(
            f"{path}: holds OpenEXR's UINT with numbers up to {pixels.max():g}, expected 0 and 1: choose one "
            "object and write its matte"
        )
    at = names.index("A") if "A" in names else None  # of a GIF, OpenImageIO says a channel too far
    # Samples that a TIFF does not name are no colour (TIFF 6.0, ExtraSamples).
    known = [index for index, name in enumerate(names) if name != "A" and not UNNAMED.fullmatch(name)]
    colours = pixels[..., known]
    alpha = None if at is None else pixels[..., at]
    matte = matte_of(colours, alpha, opaque=1, grey=GREY)
    if matte is None:
        raise ValueError(f"{path}: expected a mask (grey, or with transparency), got an opaque colour image")
    return matte


@checks_arguments
def write_mask(
    path: quantities.File,
    mask: ArrayLike,
    *,
    depth: str | None = None,
    metadata: quantities.Entries | None = None,
) -> None:
    """Write a matte as a grey image without colour encoding, which `read_mask` reads back.

    Parameters
    ----------
    path
        .png, .tif or .exr. Its folder must exist.
    mask
        (H, W) in [0, 1], or uint8 or uint16 over the full range.
    depth
        See `write`; 16 bits by default.
    metadata
        See `write`.

    Raises
    ------
    TypeError, ValueError
        Wrong shape, dtype or values, or a lossy format.
    OSError
        See `write`.

    Examples
    --------
    >>> relight.write_mask("copy.png", relight.read_mask("matte.png"))
    """
    path = Path(path)
    check_matte(path)
    depth = checked_depth(path, depth or ("half" if path.suffix.lower() == ".exr" else "uint16"))
    pixels = coverage("mask", mask)[..., None]
    spec = new_spec(pixels.shape[:2], depth, ["Y"], metadata)
    if path.suffix.lower() == ".exr":
        save_exr(path, [pixels], (0, 0), spec)
    else:
        save(path, pixels, spec)


def check_matte(path: Path) -> None:
    """Raise as `write_mask` does if a matte cannot be written to `path`."""
    check_writable(path)
    if path.suffix.lower() not in (".exr", ".png", ".tif", ".tiff"):
        raise ValueError(f"{path}: expected .png, .tif or .exr for a matte")


@checks_arguments
def read_depth(path: quantities.File, *, layer: str | None = None) -> np.ndarray:
    """Read a depth: (H, W) float32, metres away from the camera, as they are stored.

    From the layer, else from the channel Z of the file or of its only layer "depth", whose name may have
    several words (`ViewLayer.Depth`), unless the file has one channel alone. What is infinite or not a number
    stays so: renderers write it where there is nothing.
    Raises as `read` does, and ValueError for other channels or for integers, of which nobody knows how many
    metres they are.
    """
    if layer is None and Path(path).suffix.lower() == ".exr" and Path(path).is_file():
        layer = _depth_layer(list(layers_of(path)))
    stored = load(path, layer=layer, space=colour.LINEAR)
    pixels, names = stored.pixels, stored.names
    if "Z" not in names and len(names) > 1:
        raise ValueError(f"{path}: expected a channel Z, or one alone; got {', '.join(names)}")
    depth = pixels[..., names.index("Z") if "Z" in names else 0]
    if stored.unsigned or np.issubdtype(depth.dtype, np.integer):
        raise ValueError(f"{path}: holds integers, expected depth as floats, in metres")
    if not np.isfinite(depth).any():
        raise ValueError(f"{path}: contains NaN or infinite values alone")
    return squared(path, np.asarray(depth, np.float32), stored.aspect, nearest=True)


def _depth_layer(names: list[str]) -> str | None:
    """Return the name of the layer that is the depth; None if there is none, or if several may be it."""
    whole = [name for name in names if name.lower() in ("z", "depth")]
    last_words = [name for name in names if name.lower().endswith(".depth")]
    if whole:
        return whole[0]
    return last_words[0] if len(last_words) == 1 else None


@checks_arguments
def read_normals(path: quantities.File, *, axes: str = CAMERA, layer: str | None = None) -> np.ndarray:
    """Read a normal map as unit vectors, without a colour space.

    Parameters
    ----------
    path
        Integers (PNG, TIFF) hold n = 2v - 1, v over their full range; floats (OpenEXR) n itself, signed.
    axes
        Axes of the file's three channels: "+x+y+z" is the camera frame (x right, y up, z to the camera),
        "+x-y-z" is OpenCV's; see `shadow.directions.from_axes`. Normals in world space have to be converted
        by the camera's rotation first.
    layer
        A layer of an OpenEXR file, such as "N"; by default the channels R, G, B or X, Y, Z without a layer.

    Returns
    -------
    np.ndarray
        (H, W, 3) float32 in the camera frame; zero where the file has no normal: black, white or mid-grey.

    Raises
    ------
    FileNotFoundError
        See `read`.
    ValueError
        See `read`; also other channels, no such layer, unknown axes, or floats in the encoding of integers.

    Examples
    --------
    >>> normals = relight.read_normals("normals.exr", axes="+x-y-z")
    >>> normals.shape[2]
    3
    """
    stored = load(path, layer=layer, space=colour.LINEAR)
    names = stored.names
    for channels in ("RGB", "XYZ", "rgb", "xyz", ("Y", "channel1", "channel2")):
        if all(channel in names for channel in channels):
            break
    else:
        prefix = "" if layer is None else f"{layer}."
        wanted = f"{prefix}R, {prefix}G, {prefix}B or {prefix}X, {prefix}Y, {prefix}Z"
        raise ValueError(f"{path}: expected channels {wanted}; got {', '.join(names)}")
    pixels = stored.pixels[..., [names.index(channel) for channel in channels]]
    vectors = pixels.astype(np.float32)
    if np.issubdtype(pixels.dtype, np.integer):
        vectors = vectors * (2 / np.iinfo(pixels.dtype).max) - 1
    if not np.isfinite(vectors).all():
        raise ValueError(f"{path}: contains NaN or infinite values")
    vectors = squared(path, vectors, stored.aspect, nearest=True)
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    known = (length > 0.5) & (length < 1.5)  # black and white decode to 1.73, mid-grey to 0
    if not known.any():
        raise ValueError(f"{path}: holds no vector of about unit length, expected normals")
    if vectors.min() >= 0 and np.median(length[known]) > 1.05:
        raise ValueError(f"{path}: holds floats in [0, 1], expected signed normals: decode it, n = 2v - 1")
    unit = np.divide(vectors, length, out=np.zeros_like(vectors), where=known)
    return unit @ from_axes(axes).T
