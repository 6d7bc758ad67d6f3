"""Images in and out through OpenImageIO: alpha, colour, layers, and files that are whole or not there.

Inside, an image is (H, W, 3) or (H, W, 4) float32: linear Rec.709, premultiplied. A file of integers is
sRGB-encoded with straight alpha, a file of floats scene-linear and premultiplied, unless it says otherwise.
"""

import itertools
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from relight import __version__
from relight.media import colour
from shadow import files
from shadow.directions import CAMERA, from_axes

DEPTHS = {  # what each format is written as: the first is the default
    ".exr": ("half", "float"),
    ".hdr": ("float",),
    ".jpeg": ("uint8",),
    ".jpg": ("uint8",),
    ".png": ("uint8", "uint16"),
    ".tif": ("uint16", "uint8", "float"),
    ".tiff": ("uint16", "uint8", "float"),
}
HALF_MAX = 65504.0
ICC_SPACES = {"Display P3": "srgb_p3d65_scene", "Adobe RGB (1998)": "g22_adobergb_scene"}


def scene_linear(name, image):
    """An image at the public edge to linear Rec.709, premultiplied.

    Parameters
    ----------
    name: what to call it in an error.
    image: (H, W, 3) or (H, W, 4). uint8 and uint16 are sRGB-encoded with straight alpha; floating dtypes
        are scene-linear Rec.709 with premultiplied alpha.

    Returns
    -------
    (H, W, 3) or (H, W, 4) float32, colour unbounded, alpha in [0, 1].

    Raises
    ------
    TypeError: another dtype. ValueError: another shape, NaN or infinite values, alpha outside [0, 1].
    """
    pixels = np.asarray(image)
    if pixels.dtype not in (np.uint8, np.uint16) and not np.issubdtype(pixels.dtype, np.floating):
        raise TypeError(f"{name}: expected uint8, uint16 or a floating dtype, got {pixels.dtype}")
    if pixels.ndim != 3 or pixels.shape[-1] not in (3, 4) or 0 in pixels.shape:
        raise ValueError(f"{name}: expected shape (H, W, 3) or (H, W, 4), got {pixels.shape}")
    integer = np.issubdtype(pixels.dtype, np.integer)
    linear = _linear(pixels, straight=integer, space=colour.SRGB if integer else colour.LINEAR)
    if not np.isfinite(linear).all():
        raise ValueError(f"{name}: contains NaN or infinite values")
    if linear.shape[-1] == 4:
        alpha = linear[..., 3]
        if alpha.min() < -1e-3 or alpha.max() > 1 + 1e-3:  # filtering overshoots a little
            raise ValueError(f"{name}: expected alpha in [0, 1], got [{alpha.min():g}, {alpha.max():g}]")
        linear = np.concatenate([linear[..., :3], alpha[..., None].clip(0, 1)], axis=-1)
    return linear


def _linear(pixels, *, straight, space):
    """Pixels (H, W, 3|4) of a colour space, with straight or premultiplied alpha, to linear premultiplied."""
    if pixels.shape[-1] == 3:
        return colour.decode(pixels, space)
    rgb, alpha = pixels[..., :3], pixels[..., 3:]
    if np.issubdtype(pixels.dtype, np.integer):
        alpha = alpha / np.float32(np.iinfo(pixels.dtype).max)
    if not straight and not isinstance(space, str):  # other primaries, but linear
        return np.concatenate([colour.decode(rgb, space), alpha], axis=-1, dtype=np.float32)
    if not straight and colour.resolve(space) == colour.resolve(colour.LINEAR):
        return np.asarray(pixels, np.float32)
    if not straight:  # the encoding was applied before the alpha: take the alpha out first
        scale = np.iinfo(pixels.dtype).max if np.issubdtype(pixels.dtype, np.integer) else 1
        rgb = np.divide(rgb / np.float32(scale), alpha, out=np.zeros(rgb.shape, np.float32), where=alpha > 0)
    return np.concatenate([colour.decode(rgb, space) * alpha, alpha], axis=-1, dtype=np.float32)


def coverage(name, mask):
    """A matte at the public edge as (H, W) float32 in [0, 1].

    `mask` is floating in [0, 1], or uint8 or uint16 over the full range. TypeError for another dtype,
    ValueError for another shape, NaN or values out of range; `name` is what the error calls it.
    """
    matte = np.asarray(mask)
    if matte.dtype not in (np.uint8, np.uint16) and not np.issubdtype(matte.dtype, np.floating):
        raise TypeError(f"{name}: expected uint8, uint16 or a floating dtype, got {matte.dtype}")
    if matte.ndim != 2 or 0 in matte.shape:
        raise ValueError(f"{name}: expected shape (H, W), got {matte.shape}")
    if np.issubdtype(matte.dtype, np.integer):
        return matte / np.float32(np.iinfo(matte.dtype).max)
    if not (matte.min() >= 0 and matte.max() <= 1):
        raise ValueError(f"{name}: expected values in [0, 1], got [{matte.min():g}, {matte.max():g}]")
    return matte.astype(np.float32)


def read(path, *, colour_space=None):
    """Read an image.

    Parameters
    ----------
    path: a file that OpenImageIO reads: PNG, JPEG, TIFF, OpenEXR, HDR and others.
    colour_space: the file's colour space ("sRGB", "lin_rec709", "ACEScg", "Rec.2020"...: see
        `relight.media.colour`) where it does not say, or says what is wrong. A file says it by
        `oiio:ColorSpace` or what OpenImageIO
        takes for it, its chromaticities, or an ICC profile of sRGB, Display P3 or Adobe RGB.

    Returns
    -------
    (H, W, 3), or (H, W, 4) if there is alpha: float32, linear Rec.709, premultiplied, unbounded. Grey becomes
    three equal channels. The picture stands upright (Exif orientation) and fills its display window.

    Raises
    ------
    FileNotFoundError: no such file. ValueError: not an image, truncated, NaN or infinite values, an unknown
    colour space or profile.
    """
    pixels, spec, names = _load(path, wanted="RGBAY")
    colours = [names.index(c) for c in "RGB" if c in names] or [names.index(c) for c in "Y" if c in names]
    if len(colours) not in (1, 3):
        raise ValueError(f"{path}: expected channels R, G, B or Y, with or without A; got {', '.join(names)}")
    alpha = [names.index("A")] if "A" in names else []
    if [*colours, *alpha] != list(range(len(names))) or len(colours) == 1:
        pixels = pixels[..., [*(colours * 3)[:3], *alpha]]
    space = _declared_space(path, spec, pixels.dtype) if colour_space is None else colour_space
    try:
        linear = _linear(pixels, straight=bool(spec.get_int_attribute("oiio:UnassociatedAlpha")), space=space)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    if not np.isfinite(linear).all():
        raise ValueError(f"{path}: contains NaN or infinite values")
    return np.ascontiguousarray(linear)  # as other libraries want it


def read_layers(path):
    """Read the named layers of an OpenEXR file: {name: (H, W, C) float32}, as written, in the file's order.

    A layer holds the channels `name.*`; the channels without a name, the beauty, are `read`'s. Empty if there
    are no layers. Raises as `read` does.
    """
    pixels, _, names = _load(path)
    channels = {}
    for index, channel in enumerate(names):
        layer, dot, _ = channel.rpartition(".")
        if dot:
            channels.setdefault(layer, []).append(index)
    return {layer: np.asarray(pixels[..., indices], np.float32) for layer, indices in channels.items()}


def read_mask(path):
    """Read a matte: (H, W) float32 in [0, 1], from the alpha channel unless it is opaque, else from grey.

    A matte is coverage, not colour: its values are taken as they are stored. Raises as `read` does, and
    ValueError for a picture that is neither transparent nor grey.
    """
    pixels, spec, _ = _load(path)
    if np.issubdtype(pixels.dtype, np.integer):
        pixels = pixels / np.float32(np.iinfo(pixels.dtype).max)
    if not np.isfinite(pixels).all():
        raise ValueError(f"{path}: contains NaN or infinite values")
    alpha = spec.alpha_channel
    if alpha >= 0 and pixels[..., alpha].min() < 1:
        matte = pixels[..., alpha]
    else:
        matte = pixels[..., 0]
        if np.ptp(np.delete(pixels, alpha, axis=-1) if alpha >= 0 else pixels, axis=-1).max() > 0.01:
            raise ValueError(
                f"{path}: expected a mask (grey, or with transparency), got an opaque colour image"
            )
    return np.clip(matte, 0, 1, dtype=np.float32)


def read_normals(path, *, axes=CAMERA, layer=None):
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
    pixels, _, names = _load(path)
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


def _load(path, wanted=None):
    """Pixels (H, W, C) of a file, uint8 and uint16 as they are and float32 otherwise, its spec, and the names
    of the channels: all, or no more than lie from the first to the last of those `wanted`."""
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)  # or encoded values would come premultiplied
    file = oiio.ImageInput.open(str(path), hints)
    if file is None:
        raise ValueError(f"{path}: cannot be read as an image: {_problem(oiio)}")
    spec = file.spec()
    if spec.deep:
        raise ValueError(f"{path}: is a deep image, expected a flat one")
    try:
        names = list(spec.channelnames)
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is damaged: its channels' names are garbled") from error
    found = [index for index, name in enumerate(names) if wanted is None or name in wanted]
    first, last = (found[0], found[-1] + 1) if found else (0, len(names))
    native = str(spec.format)
    try:
        pixels = file.read_image(0, 0, first, last, native if native in ("uint8", "uint16") else "float")
        problem = _problem(file)  # a truncated JPEG returns a picture *and* an error
        file.close()
        if pixels is None or problem:
            raise ValueError(f"{path}: is damaged or truncated: {problem}")
        return _upright(_in_display_window(pixels, spec), spec), spec, names[first:last]
    except MemoryError as error:
        size = f"{spec.full_width} x {spec.full_height}"
        raise ValueError(f"{path}: is damaged, or too large to read: it says {size} pixels") from error


def _problem(source):
    """OpenImageIO's account of an error, which quotes what may be garbled."""
    try:
        return source.geterror().strip()
    except UnicodeDecodeError:
        return "what it holds is garbled"


def _in_display_window(pixels, spec):
    """Crop overscan and pad with nothing, so that the picture is what its display window shows."""
    left, top = spec.x - spec.full_x, spec.y - spec.full_y
    if (left, top, spec.width, spec.height) == (0, 0, spec.full_width, spec.full_height):
        return pixels
    window = np.zeros((spec.full_height, spec.full_width, pixels.shape[-1]), pixels.dtype)
    rows = slice(max(top, 0), max(top + spec.height, 0))
    columns = slice(max(left, 0), max(left + spec.width, 0))
    inside = window[rows, columns]
    inside[:] = pixels[max(-top, 0) :, max(-left, 0) :][: inside.shape[0], : inside.shape[1]]
    return window


def _upright(pixels, spec):
    """Turn the picture as its Exif orientation asks."""
    orientation = spec.get_int_attribute("Orientation", 1)
    if orientation == 1:
        return pixels
    lying = oiio.ImageBuf(np.ascontiguousarray(pixels))
    lying.orientation = orientation
    upright = oiio.ImageBufAlgo.reorient(lying)
    return upright.get_pixels(upright.spec().format)


def _declared_space(path, spec, dtype):
    """The colour space that a file declares, or its dtype implies: a name, or chromaticities."""
    integer = np.issubdtype(dtype, np.integer)
    profile = spec.get_string_attribute("ICCProfile:profile_description")
    if integer and profile and spec.nchannels >= 3:
        if "sRGB" in profile:
            return colour.SRGB
        if profile not in ICC_SPACES:
            raise ValueError(f"{path}: has the colour profile {profile!r}; say which colour_space that is")
        return ICC_SPACES[profile]
    declared = spec.get_string_attribute("oiio:ColorSpace")
    if not declared.isprintable():
        raise ValueError(f"{path}: is damaged: the name of its colour space is garbled")
    if declared not in ("", "unknown"):  # a colorInteropID may say that the writer did not know
        return declared
    primaries = spec.getattribute("chromaticities")
    if primaries is not None and not integer:
        return tuple(primaries)
    return colour.SRGB if integer else colour.LINEAR


def check_writable(path):
    """The depths that `path` can be written with, default first; raises as `write` does if there are none."""
    return DEPTHS[files.check_writable(path, DEPTHS).suffix.lower()]


def write(path, image, *, layers=None, depth=None, metadata=None, view=None, exposure=0.0, white=None):
    """Write an image. The file appears when it is complete; an error leaves what was there before.

    Parameters
    ----------
    path: its suffix is the format: .exr, .hdr, .jpg, .png, .tif. Its folder must exist.
    image: (H, W, 3|4), integers sRGB with straight alpha, floats linear Rec.709 premultiplied.
    layers: {name: (H, W) or (H, W, 1|3|4) float}, for .exr: written as `name.R` ... `name.A`, or `name.Y`, or
        `N.X` ... `N.Z` for normals, behind the image's own R, G, B, A. Values are kept as they are.
    depth: "uint8", "uint16", "half" or "float", as the format allows. Unless given: half for .exr, uint8 for
        .png and .jpg, uint16 for .tif, float for .hdr.
    metadata: {name: text, number or tuple of numbers} for the file's header.
    view, exposure, white: how integers show what may be brighter than a display; see
        `relight.media.colour.encode`.

    Floats are written scene-linear Rec.709 and premultiplied. Integers are written for display, with straight
    alpha: unless there is a `view`, sRGB, in which light up to 1 is exact and brighter highlights roll off.

    Raises
    ------
    TypeError, ValueError: wrong shape, dtype, suffix or depth; NaN or infinite values; values that half
    cannot hold; alpha that is not 1 in a format without alpha; layers outside .exr.
    OSError: the folder does not exist or the file cannot be written.
    """
    path = Path(path)
    depths = check_writable(path)
    depth = depth or depths[0]
    if depth not in depths:
        raise ValueError(f"depth: expected {' or '.join(depths)} for {path.suffix}, got {depth!r}")
    pixels = scene_linear("image", image)
    if pixels.shape[-1] == 4 and path.suffix.lower() in (".hdr", ".jpeg", ".jpg"):
        if pixels[..., 3].min() < 1:
            raise ValueError(f"{path}: {path.suffix} holds no alpha; put the image over a background first")
        pixels = pixels[..., :3]
    names = list("RGBA"[: pixels.shape[-1]])
    if depth.startswith("uint"):
        pixels = _encoded(pixels, view, exposure, white)
    if layers and path.suffix.lower() != ".exr":
        raise ValueError(f"{path}: layers need a .exr file")
    stacks = {name: _layer(name, layer, pixels.shape[:2]) for name, layer in (layers or {}).items()}
    names += [f"{name}.{channel}" for name, stack in stacks.items() for channel in _channels(name, stack)]
    pixels = _joined(path, [pixels, *stacks.values()], np.float16 if depth == "half" else np.float32)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], depth)
    spec.channelnames = names
    spec.alpha_channel = names.index("A") if "A" in names else -1
    spec.attribute("Software", f"relight {__version__}")
    spec.attribute("compression", "zip" if path.suffix.lower() in (".exr", ".tif", ".tiff") else "")
    if depth.startswith("uint"):
        if view is None or "srgb" in " ".join(colour.find_view(view)[1:]).lower():
            spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
        spec.attribute("oiio:UnassociatedAlpha", 1)
    else:
        spec.attribute("oiio:ColorSpace", "lin_rec709_scene")
        spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), colour.REC709)
    for name, value in (metadata or {}).items():
        if isinstance(value, tuple):
            spec.attribute(name, oiio.TypeDesc(f"float[{len(value)}]"), value)
        else:
            spec.attribute(name, value)
    _save(path, pixels, spec)


def write_mask(path, mask, *, depth=None):
    """Write a matte as a grey image, which `read_mask` reads back: coverage as it is, no colour encoding.

    Parameters
    ----------
    path: .png, .tif or .exr. Its folder must exist.
    mask: (H, W) in [0, 1], or uint8 or uint16 over the full range.
    depth: as of `write`, but 16 bits unless given.

    Raises
    ------
    TypeError, ValueError: wrong shape, dtype or values, a format that may lose some. OSError: as of `write`.
    """
    path = Path(path)
    depths = check_writable(path)
    if path.suffix.lower() not in (".exr", ".png", ".tif", ".tiff"):
        raise ValueError(f"{path}: expected .png, .tif or .exr for a matte")
    depth = depth or {".exr": "half"}.get(path.suffix.lower(), "uint16")
    if depth not in depths:
        raise ValueError(f"depth: expected {' or '.join(depths)} for {path.suffix}, got {depth!r}")
    matte = coverage("mask", mask)
    spec = oiio.ImageSpec(matte.shape[1], matte.shape[0], 1, depth)
    spec.channelnames = ["Y"]
    spec.attribute("Software", f"relight {__version__}")
    _save(path, matte[..., None], spec)


def _encoded(pixels, view, exposure, white):
    """Linear premultiplied (H, W, 3|4) to a display's encoding with straight alpha, float32 in [0, 1]."""
    if pixels.shape[-1] == 3:
        return colour.encode(pixels, view=view, exposure=exposure, white=white)
    rgb, alpha = pixels[..., :3], pixels[..., 3:]
    straight = np.divide(rgb, alpha, out=np.zeros_like(rgb), where=alpha > 0)
    if white is None:  # the brightest that shows: dividing by a faint alpha can make anything of it
        white = max(1.0, float(rgb.max()) * 2.0**exposure)
    return np.concatenate(
        [colour.encode(straight, view=view, exposure=exposure, white=white), alpha], axis=-1
    )


def _channels(name, stack):
    """Names of a layer's channels: colour, one value, or the axes of the normals."""
    return "XYZ" if name == "N" and stack.shape[-1] == 3 else {1: "Y", 3: "RGB", 4: "RGBA"}[stack.shape[-1]]


def _layer(name, layer, size):
    """A layer as (H, W, 1|3|4), checked."""
    if not isinstance(name, str) or not name:
        raise TypeError(f"layers: expected names that are non-empty strings, got {name!r}")
    stack = np.asarray(layer)
    if not np.issubdtype(stack.dtype, np.floating):
        raise TypeError(f"layers[{name!r}]: expected a floating dtype, got {stack.dtype}")
    stack = stack[..., None] if stack.ndim == 2 else stack
    if stack.ndim != 3 or stack.shape[:2] != size or stack.shape[-1] not in (1, 3, 4):
        raise ValueError(f"layers[{name!r}]: expected shape {size} or {(*size, '1|3|4')}, got {stack.shape}")
    if not np.isfinite(stack).all():
        raise ValueError(f"layers[{name!r}]: contains NaN or infinite values")
    return stack


def _joined(path, stacks, dtype):
    """All channels (H, W, C) of a file in one array of the file's own depth, to hold them only once."""
    channels = np.cumsum([0] + [stack.shape[-1] for stack in stacks])
    joined = np.empty((*stacks[0].shape[:2], channels[-1]), dtype)
    for stack, (first, last) in zip(stacks, itertools.pairwise(channels), strict=True):
        if dtype == np.float16 and max(stack.max(), -stack.min()) > HALF_MAX:
            raise ValueError(
                f"{path}: values above {HALF_MAX:g} do not fit half; write it with depth='float'"
            )
        joined[..., first:last] = stack
    return joined


def _save(path, pixels, spec):
    """Write a file that is whole or not there."""
    with files.replacing(path) as beside:
        file = oiio.ImageOutput.create(str(path))  # by its suffix
        if file is None:
            raise OSError(f"{path}: cannot be written: {oiio.geterror().strip()}")
        written = file.open(str(beside), spec) and file.write_image(np.ascontiguousarray(pixels))
        if not (file.close() and written):
            raise OSError(f"{path}: cannot be written: {file.geterror().strip()}")
