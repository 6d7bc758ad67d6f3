"""Reading images: alpha, colour, layers, orientation and windows, whatever program wrote them."""

from collections.abc import Collection
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from relight.media import colour, identity
from relight.media.buffers import problem, to_array
from relight.media.images import phone
from relight.media.images.edge import linearise
from relight.media.profiles import Profile
from shadow.files import AnyPath

LUMINANCE_CHROMA = ("Y", "RY", "BY")
# OpenImageIO's own limit, 1024, is passed by an OpenEXR file of 256 lights; more than this is a damaged file.
oiio.attribute("limits:channels", 1 << 14)


def read(path: AnyPath, *, colour_space: str | None = None) -> np.ndarray:
    """Read an image.

    Parameters
    ----------
    path: a file that OpenImageIO reads: PNG, JPEG, WebP, TIFF, OpenEXR, HDR and others; with the extra
        `phone` also HEIC, AVIF and camera raw, which is developed with the camera's white balance.
    colour_space: the file's colour space ("sRGB", "lin_rec709", "ACEScg", "Rec.2020"...: see
        `relight.media.colour`) where it does not say, or says what is wrong. A file says it by its ICC
        profile, whose curves and primaries count and not its name; by `oiio:ColorSpace`, or what OpenImageIO
        takes for it; or by its chromaticities.

    Returns
    -------
    (H, W, 3), or (H, W, 4) if there is alpha: float32, linear Rec.709, premultiplied, unbounded. Grey becomes
    three equal channels; OpenEXR's luminance and chroma become red, green and blue. The picture stands
    upright (Exif orientation) and fills its display window.

    Raises
    ------
    FileNotFoundError: no such file. ValueError: not an image, truncated, NaN or infinite values, an unknown
    colour space or profile.
    """
    pixels, spec, names = load(path, wanted=("R", "G", "B", "A", *LUMINANCE_CHROMA))
    pixels = _colours(path, pixels, spec, names)
    space = _declared_space(path, spec, pixels.dtype) if colour_space is None else colour_space
    try:
        light = linearise(
            pixels, straight=bool(spec.get_int_attribute("oiio:UnassociatedAlpha")), space=space
        )
    except ValueError as error:
        subject = "its colour profile " if isinstance(space, Profile) else ""
        raise ValueError(f"{path}: {subject}{error}") from error
    if not np.isfinite(light).all():
        raise ValueError(f"{path}: contains NaN or infinite values")
    return np.ascontiguousarray(light)  # as other libraries want it


def _colours(path: AnyPath, pixels: np.ndarray, spec: oiio.ImageSpec, names: list[str]) -> np.ndarray:
    """Red, green, blue, and alpha if there is one, of a file's channels."""
    alpha = [names.index("A")] if "A" in names else []
    if all(name in names for name in LUMINANCE_CHROMA):
        y, ry, by = (pixels[..., names.index(name)] for name in LUMINANCE_CHROMA)
        weights = colour.luminance_weights(spec.getattribute("chromaticities"))
        red, blue = (ry + 1) * y, (by + 1) * y  # OpenEXR's technical introduction, "Luminance/Chroma Images"
        green = (y - weights[0] * red - weights[2] * blue) / weights[1]
        return np.concatenate([np.stack([red, green, blue], axis=-1), pixels[..., alpha]], axis=-1)
    colours = [names.index(name) for name in "RGB" if name in names]
    colours = colours or [names.index(name) for name in "Y" if name in names]
    if len(colours) not in (1, 3):
        raise ValueError(f"{path}: expected channels R, G, B or Y, with or without A; got {', '.join(names)}")
    if [*colours, *alpha] == list(range(len(names))) and len(colours) == 3:
        return pixels
    return pixels[..., [*(colours * 3)[:3], *alpha]]


def read_layers(path: AnyPath) -> dict[str, np.ndarray]:
    """Read the named layers of an OpenEXR file: {name: (H, W, C) float32}, as written, in the file's order.

    A layer holds the channels `name.*`, or is the depth, `Z`; the channels without a name, the beauty, are
    `read`'s. Empty if there are no layers. Raises as `read` does.
    """
    pixels, _, names = load(path)
    channels: dict[str, list[int]] = {}
    for index, channel in enumerate(names):
        layer, dot, _ = channel.rpartition(".")
        if dot or channel == "Z":
            layer = layer or channel
            channels.setdefault(layer, []).append(index)
    return {layer: np.asarray(pixels[..., indices], np.float32) for layer, indices in channels.items()}


def read_identity(path: AnyPath) -> str | None:
    """The identity that a picture's file carries (see `relight.media.identity`); None where it has none, or
    there is no picture, or not all of it: its last row cannot be read, or its size and channels are not those
    that it was written with."""
    file = oiio.ImageInput.open(str(path))
    if file is None:
        problem(oiio)  # is taken note of, or it would be reported later
        return None
    spec = file.spec()
    found, holds = spec.get_string_attribute(identity.NAME), spec.get_string_attribute(identity.HOLDS)
    try:
        if not found or (holds and holds != identity.contents(spec)):
            return None
    except UnicodeDecodeError:  # the channels' names are garbled
        return None
    last = spec.y + spec.height - 1
    pixels = file.read_scanlines(0, 0, last, last + 1, 0, 0, spec.nchannels, str(spec.format))
    return None if pixels is None or problem(file) else found


def load(
    path: AnyPath, wanted: Collection[str] | None = None
) -> tuple[np.ndarray, oiio.ImageSpec, list[str]]:
    """Pixels (H, W, C) of a file, uint8 and uint16 as they are and float32 otherwise, its spec, and the names
    of the channels: all, or no more than lie from the first to the last of those `wanted`."""
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    read_phone = phone.reader(path)
    if read_phone is not None:
        developed, spec = read_phone(path)
        return developed, spec, list(spec.channelnames)
    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)  # or encoded values would come premultiplied
    file = oiio.ImageInput.open(str(path), hints)
    if file is None:
        raise ValueError(f"{path}: cannot be read as an image: {problem(oiio)}")
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
        failure = problem(file)  # a truncated JPEG returns a picture *and* an error
        file.close()
        if pixels is None or failure:
            raise ValueError(f"{path}: is damaged or truncated: {failure}")
        return _upright(_in_display_window(pixels, spec), spec), spec, names[first:last]
    except MemoryError as error:
        size = f"{spec.full_width} x {spec.full_height}"
        raise ValueError(f"{path}: is damaged, or too large to read: it says {size} pixels") from error


def _in_display_window(pixels: np.ndarray, spec: oiio.ImageSpec) -> np.ndarray:
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


def _upright(pixels: np.ndarray, spec: oiio.ImageSpec) -> np.ndarray:
    """Turn the picture as its Exif orientation asks."""
    orientation = spec.get_int_attribute("Orientation", 1)
    if orientation == 1:
        return pixels
    lying = oiio.ImageBuf(np.ascontiguousarray(pixels))
    lying.orientation = orientation
    upright = oiio.ImageBufAlgo.reorient(lying)
    return to_array(upright, str(upright.spec().format))


def _declared_space(path: AnyPath, spec: oiio.ImageSpec, dtype: np.dtype) -> colour.Space:
    """The colour space that a file declares, or its dtype implies."""
    integer = np.issubdtype(dtype, np.integer)
    profile = spec.getattribute("ICCProfile")
    if profile is not None:
        try:
            return Profile.of(np.asarray(profile, np.uint8).tobytes())
        except ValueError as error:
            raise ValueError(f"{path}: its colour profile {error}; say which colour_space it is") from error
    declared = spec.get_string_attribute("oiio:ColorSpace")
    if not declared.isprintable():
        raise ValueError(f"{path}: is damaged: the name of its colour space is garbled")
    if declared not in ("", "unknown"):  # a colorInteropID may say that the writer did not know
        return declared
    primaries = spec.getattribute("chromaticities")
    if primaries is not None and not integer:
        return tuple(primaries)
    return colour.SRGB if integer else colour.LINEAR
