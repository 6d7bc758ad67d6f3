"""Writing images: layers, depths, and what a file says of itself."""

import reprlib
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import OpenImageIO as oiio
from numpy.typing import ArrayLike

from relight.media import colour, content_hash
from relight.media.encodings import Transfer
from relight.media.images.arrays import as_array, scene_linear
from relight.media.images.containers.exr import save_exr
from relight.media.images.encode import LARGEST, QUALITY, save
from relight.media.images.metadata import TypedValue
from relight.version import __version__
from shadow import files
from shadow.files import AnyPath
from shadow.srgb import encode_srgb

if TYPE_CHECKING:
    import torch

# {name: value} of a file's header
Metadata = Mapping[str, str | int | float | tuple[float, ...] | TypedValue]

DEPTHS = {  # what each format is written as: the first is the default
    ".exr": ("half", "float"),
    ".hdr": ("float",),
    ".jpeg": ("uint8",),
    ".jpg": ("uint8",),
    ".png": ("uint8", "uint16"),
    ".tif": ("uint16", "uint8", "float"),
    ".tiff": ("uint16", "uint8", "float"),
    ".webp": ("uint8",),
}
OPAQUE_SUFFIXES = (".hdr", ".jpeg", ".jpg")  # of formats without alpha
HALF_MAX = 65504.0
HALF_OVER = 65520.0  # the least value that rounds to infinity
DEPTH = "Z"  # the layer, and OpenEXR's name of its channel: half floats would make steps of it
LONGEST_LAYER = 253  # bytes of UTF-8: with ".R" behind, the 255 of OpenEXR
NO_COLOUR = ("N", "P")  # layers of three channels that are no colour
SAMPLED = 16  # one pixel in so many tells that a layer is bright
LOST = 0.01  # share of a layer's light that half floats may lose before a warning says so


def check_writable(path: AnyPath) -> tuple[str, ...]:
    """Return the depths in which `path` can be written, default first.

    Raises as `write` does if there are none.
    """
    return DEPTHS[files.check_writable(path, DEPTHS).suffix.lower()]


def write(
    path: AnyPath,
    image: ArrayLike,
    *,
    layers: Mapping[str, ArrayLike] | None = None,
    depth: str | None = None,
    autocrop: bool = False,
    metadata: Metadata | None = None,
    background: ArrayLike | None = None,
    view: str | None = None,
    exposure: float = 0.0,
    white: float | None = None,
    colour_space: str | None = None,
    quality: int | None = None,
) -> None:
    """Write an image. The file appears when it is complete; after an error, the old file is unchanged.

    The suffix is the format: .exr, .hdr, .jpg, .png, .tif, .webp. The image is (H, W, 3|4), integers sRGB
    with straight alpha, floats linear Rec.709 premultiplied. Floats are written scene-linear, premultiplied.
    Integers are encoded for a display, with straight alpha: without a `view` as sRGB, in which values up to 1
    are exact and brighter highlights are compressed; `view`, `exposure`, `white`: see
    `relight.media.colour.encode`.

    - `layers`: {name: (H, W) or (H, W, 1|3|4) float}, for .exr: written as `name.R` ... `name.A`, or
      `name.Y`, or `N.X` ... `N.Z` for normals, after the image's R, G, B, A. Values are not converted. A
      layer "Z" (H, W) is the depth: the channel Z, which is always float32. A warning names a layer so dim
      that half floats lose more than 1 % of its light.
    - `depth`: "uint8", "uint16", "half" or "float", if the format has it. The default is half for .exr, uint8
      for .png, .jpg and .webp, uint16 for .tif, float for .hdr.
    - `autocrop`: whether an .exr stores only the box of its pixels that are not zero, its data window.
      `read`, and programs that honour the display window, show the whole picture; others show the box only.
    - `metadata`: {name: text, number or tuple of numbers} for the file's header.
    - `background`: (H, W, 3), of the image's size, what stands behind an image with alpha. Formats of
      integers show it as it is: only the image's own highlights are compressed, so that where the image's
      alpha is 0, codes that were read are written bit for bit, see `relight.media.colour.encode_over`. With a
      `view`, and in formats of floats, it is composited in linear light.
    - `colour_space`: a linear colour space for an .exr or a .tif of floats, such as "ACEScg", "ACES2065-1" or
      "Rec.2020". The image and its layers are converted to it, except normals, positions and single values.
      The file states its chromaticities. The default is linear Rec.709.
    - `quality`: of a .jpg or .webp, 1 to 100; 98 by default. Other formats lose nothing, whatever it is.

    Raises TypeError or ValueError for a wrong shape, dtype, suffix or depth, NaN or infinite values, values
    that half cannot hold, alpha that is not 1 in a format without alpha, and layers in a format other than
    .exr; OSError if the folder does not exist, or the file cannot be written.

    >>> image = relight.read("examples/person.png")
    >>> relight.write("copy.exr", image, layers={"C_key": image})
    """
    path = Path(path)
    depth = checked_depth(path, depth)
    suffix = path.suffix.lower()
    if (layers or autocrop) and suffix != ".exr":
        raise ValueError(f"{path}: {'layers need' if layers else 'autocrop needs'} a .exr file")
    if colour_space is not None:
        if suffix not in (".exr", ".tif", ".tiff") or depth.startswith("uint"):
            raise ValueError(f"{path}: colour_space needs an .exr, or a .tif of floats")
        colour.linear_space(colour_space)
    pixels = scene_linear("image", image)
    back = None if background is None else _background(background, pixels)
    if back is not None and not depth.startswith("uint"):
        pixels, back = composited(pixels, back), None
    if back is None and pixels.shape[-1] == 4 and suffix in OPAQUE_SUFFIXES:
        if pixels[..., 3].min() < 1:
            raise ValueError(f"{path}: {path.suffix} holds no alpha; put the image over a background first")
        pixels = pixels[..., :3]
    if suffix in LARGEST and max(pixels.shape[:2]) > LARGEST[suffix]:
        raise ValueError(f"{path}: {path.suffix} holds at most {LARGEST[suffix]} pixels a side")
    if depth.startswith("uint"):
        pixels = encoded(pixels, back, view=view, exposure=exposure, white=white)
    names = list("RGBA"[: pixels.shape[-1]])
    stacks = {name: _layer(name, layer, pixels.shape[:2]) for name, layer in (layers or {}).items()}
    if colour_space is not None:
        pixels = _in_space(pixels, colour_space)
        stacks = {
            name: stack if name in NO_COLOUR or stack.shape[-1] < 3 else _in_space(stack, colour_space)
            for name, stack in stacks.items()
        }
    for name, stack in stacks.items():
        prefix = "" if _is_depth(name, stack) else f"{name}."
        names += [prefix + channel for channel in _channels(name, stack)]
    stacks = {"image": pixels, **{f"layers[{name!r}]": stack for name, stack in stacks.items()}}
    rows, columns = _occupied(list(stacks.values())) if suffix == ".exr" else map(slice, pixels.shape[:2])
    spec = new_spec(pixels.shape[:2], depth, names, metadata)
    if autocrop:
        spec.x, spec.y, (spec.height, spec.width) = columns.start, rows.start, pixels[rows, columns].shape[:2]
    spec = _header(suffix, spec, depth, names, view, metadata, colour_space or colour.LINEAR)
    if suffix != ".exr":
        return save(path, pixels, spec, QUALITY if quality is None else quality)
    stacks = {name: stack[rows, columns] for name, stack in stacks.items()}
    for name, stack in stacks.items():
        _check_stack(path, name, stack, depth)
    save_exr(path, list(stacks.values()), (rows.start - spec.y, columns.start - spec.x), spec)


def _header(
    suffix: str,
    spec: oiio.ImageSpec,
    depth: str,
    names: list[str],
    view: str | None,
    metadata: Metadata | None,
    colour_space: str,
) -> oiio.ImageSpec:
    """Return the spec of a file of channels `names`, with its compression and encoding."""
    if depth == "half" and DEPTH in names:
        spec.channelformats = tuple("float" if name == DEPTH else "half" for name in names)
    if suffix in (".exr", ".tif", ".tiff"):
        spec.attribute("compression", "zip")
    if suffix == ".exr" and metadata and content_hash.HASH_ATTRIBUTE in metadata:
        spec.attribute(content_hash.CONTENTS_ATTRIBUTE, content_hash.describe_contents(spec))
    if depth.startswith("uint"):
        if view is None or "srgb" in " ".join(colour.find_view(view)[1:]).lower():
            spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
        spec.attribute("oiio:UnassociatedAlpha", 1)
    else:
        name, encoding = colour.linear_space(colour_space)
        spec.attribute("oiio:ColorSpace", name)
        spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), encoding.chromaticities)
    return spec


def _in_space(pixels: np.ndarray, colour_space: str) -> np.ndarray:
    """Return linear Rec.709 (H, W, 3|4) in another linear space, alpha as it is."""
    rgb = colour.from_rec709(pixels[..., :3].astype(np.float32, copy=False), colour_space)
    return np.concatenate([rgb, pixels[..., 3:]], axis=-1, dtype=np.float32)


def checked_depth(path: Path, depth: str | None) -> str:
    """Return `depth`, or the default of the format if it is None.

    Raises ValueError if the format does not have this depth.
    """
    depths = check_writable(path)
    if depth is None:
        return depths[0]
    if depth not in depths:
        raise ValueError(f"depth: expected {' or '.join(depths)} for {path.suffix}, got {depth!r}")
    return depth


def new_spec(
    size: tuple[int, ...], depth: str, names: list[str], metadata: Metadata | None = None
) -> oiio.ImageSpec:
    """Return the spec of a file of `size` (H, W) with channels of these names."""
    spec = oiio.ImageSpec(size[1], size[0], len(names), depth)
    spec.channelnames = tuple(names)
    spec.alpha_channel = names.index("A") if "A" in names else -1
    spec.attribute("Software", f"relight {__version__}")
    for name, value in (metadata or {}).items():
        if isinstance(value, TypedValue):
            kind = "int" if value.kind == "uint16" else value.kind  # OpenImageIO's Python sets no uint16
            spec.attribute(name, oiio.TypeDesc(kind), value.value)
        elif isinstance(value, tuple):
            spec.attribute(name, oiio.TypeDesc(f"float[{len(value)}]"), value)
        else:
            spec.attribute(name, value)
    return spec


def _background(background: ArrayLike, pixels: np.ndarray) -> np.ndarray:
    """Check the background of linear pixels (H, W, 4), and return it as (H, W, 3), linear."""
    if pixels.shape[-1] == 3:
        raise ValueError("background: is behind an image with alpha, (H, W, 4); this one has none")
    behind = scene_linear("background", background)
    if behind.shape[:2] != pixels.shape[:2] or behind.shape[-1] != 3:
        expected = (*pixels.shape[:2], 3)
        raise ValueError(f"background: expected shape {expected}, of the image's size, got {behind.shape}")
    return behind


def composited(pixels: np.ndarray, background: np.ndarray) -> np.ndarray:
    """Composite premultiplied pixels (H, W, 4) over a background (H, W, 3) in linear light: (H, W, 3)."""
    return pixels[..., :3] + (1 - pixels[..., 3:]) * background


def encoded(
    pixels: np.ndarray,
    background: np.ndarray | None = None,
    *,
    view: str | None = None,
    exposure: float = 0.0,
    white: float | None = None,
    transfer: Transfer = encode_srgb,
) -> np.ndarray:
    """Encode linear, premultiplied (H, W, 3|4) for a display, with straight alpha: float32 in [0, 1].

    Over a `background` (H, W, 3), linear, it is (H, W, 3), see `relight.media.colour.encode_over`; with a
    view it is composited in linear light. `view`, `exposure`, `white`, `transfer`: see
    `relight.media.colour.encode`.
    """
    if background is not None and view is None:
        return colour.encode_over(pixels, background, exposure=exposure, white=white, transfer=transfer)
    if background is not None:
        pixels = composited(pixels, background)
    if pixels.shape[-1] == 3:
        return colour.encode(pixels, view=view, exposure=exposure, white=white, transfer=transfer)
    rgb, alpha = pixels[..., :3], pixels[..., 3:]
    straight = np.divide(rgb, alpha, out=np.zeros_like(rgb), where=alpha > 0)
    if white is None:  # the brightest that shows: dividing by a faint alpha can make anything of it
        white = max(1.0, float(rgb.max()) * 2.0**exposure)
    shown = colour.encode(straight, view=view, exposure=exposure, white=white, transfer=transfer)
    return np.concatenate([shown, alpha], axis=-1)


def _is_depth(name: str, stack: np.ndarray) -> bool:
    return name == DEPTH and stack.shape[-1] == 1


def _channels(name: str, stack: np.ndarray) -> str:
    """Return the names of a layer's channels: colour, one value, axes of normals, or depth."""
    if _is_depth(name, stack):
        return DEPTH
    return (
        "XYZ"
        if name in ("N", "P") and stack.shape[-1] == 3
        else {1: "Y", 3: "RGB", 4: "RGBA"}[stack.shape[-1]]
    )


def _layer(name: str, layer: ArrayLike, size: tuple[int, ...]) -> np.ndarray:
    """Check a layer, and return it as (H, W, 1|3|4)."""
    if not isinstance(name, str) or not name:
        raise TypeError(f"layers: expected names that are non-empty strings, got {name!r}")
    text = name.encode(errors="replace")
    if "\0" in name or len(text) > LONGEST_LAYER or text.decode() != name:
        raise ValueError(
            f"layers: expected names of up to {LONGEST_LAYER} bytes of UTF-8, without NUL, "
            f"got {reprlib.repr(name)}"
        )
    stack = as_array(f"layers[{name!r}]", layer)
    if not np.issubdtype(stack.dtype, np.floating):
        raise TypeError(f"layers[{name!r}]: expected a floating dtype, got {stack.dtype}")
    stack = stack[..., None] if stack.ndim == 2 else stack
    if stack.ndim != 3 or stack.shape[:2] != size or stack.shape[-1] not in (1, 3, 4):
        raise ValueError(f"layers[{name!r}]: expected shape {size} or {(*size, '1|3|4')}, got {stack.shape}")
    return stack


def half(values: np.ndarray, name: str) -> np.ndarray:
    """float32 values (..., C) rounded to what a half float holds, unless one of them is too bright for it.

    Warns if that loses more than 1 % of the light, such as a light of intensity 1e-6: near zero, half floats
    come in steps of 6e-8. `name` is what the warning calls them. A fourth channel is alpha, and no light.
    """
    import torch

    tensor = torch.from_numpy(np.ascontiguousarray(values))  # torch rounds many at a time
    low, high = map(float, tensor.aminmax())
    if not -HALF_OVER < low <= high < HALF_OVER:
        return values
    _check_lost(tensor, name)
    return tensor.half().float().numpy()


def _check_lost(values: "torch.Tensor", name: str) -> None:
    """Warn where half floats lose too much of the light of `values` (..., C)."""
    # What half floats lose of a value is at most 2**-12 of it, or 2**-25: then bright layers need no look.
    # A part that is as bright is enough to know.
    enough = values.numel() * 2**-25 / (LOST - 2**-12)
    for part in (values.flatten(0, -2)[::SAMPLED], values.flatten(0, -2)):
        light = float(part[:, :3].abs().sum())
        if light >= enough:
            return
    lost = float((values - values.half())[..., :3].double().abs().sum()) / max(light, 1e-300)
    if lost > LOST:
        warnings.warn(
            f"{name}: is so dim that half floats lose {100 * lost:.0f} % of its light; "
            "raise its intensity, or write floats (depth='float', --exr-type float)",
            stacklevel=3,
        )


def _check_stack(path: Path, name: str, stack: np.ndarray, depth: str) -> None:
    """Raise ValueError for a stack (H, W, C) that a file of `depth` cannot hold; warns as `half` does."""
    if not np.isfinite(stack).all():
        raise ValueError(f"{name}: contains NaN or infinite values")
    if depth != "half" or name == f"layers[{DEPTH!r}]":
        return
    import torch

    tensor = torch.from_numpy(np.require(stack, requirements=("C", "W")))  # torch warns of what is read-only
    low, high = map(float, tensor.aminmax())
    if max(high, -low) > HALF_MAX:
        raise ValueError(
            f"{path}: values above {HALF_MAX:g} do not fit half; "
            "write it with depth='float' (--exr-type float)"
        )
    _check_lost(tensor, name)


def _occupied(stacks: Sequence[np.ndarray]) -> tuple[slice, slice]:
    """Return the rows and columns beyond which all stacks (H, W, C) are zero; one pixel if all is zero."""
    rows, columns = np.zeros(stacks[0].shape[0], bool), np.zeros(stacks[0].shape[1], bool)
    for stack in stacks:
        bits = np.ascontiguousarray(stack, np.float32).view(np.uint32).reshape(len(stack), -1)
        rows |= np.bitwise_or.reduce(bits, axis=1) != 0  # several times as fast as comparing each
        columns |= np.bitwise_or.reduce(bits, axis=0).reshape(len(columns), -1).any(axis=1)
    return _span(rows), _span(columns)


def _span(occupied: np.ndarray) -> slice:
    """From the first to the last that is; the first of all where none is."""
    indices = np.flatnonzero(occupied)
    return slice(int(indices[0]), int(indices[-1]) + 1) if len(indices) else slice(0, 1)
