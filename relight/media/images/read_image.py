"""Reading images: light, layers and what a picture's file carries, whatever program wrote it."""

import warnings
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from relight import quantities
from relight.arguments import checks_arguments
from relight.media import colour, content_hash
from relight.media.buffers import problem
from relight.media.encodings import REC709, Encoding, rgb_to_xyz
from relight.media.icc import Profile
from relight.media.images.arrays import linearise
from relight.media.images.decode import layers_of, load
from relight.media.images.layers import StoredPicture
from relight.media.pixel_aspect import SQUARED, is_square, square_pixels
from relight.media.streams import as_file, is_stream
from shadow.files import AnyPath

LUMINANCE_CHROMA = ("Y", "RY", "BY")
ALPHA = ("straight", "premultiplied")
OVERSHOOT = 0.5  # most by which a filter with negative lobes (Lanczos, Mitchell) takes alpha beyond 0 and 1
_warned: set[tuple[Path, float]] = set()  # folders whose pictures have pixels that are not square

READ = (  # suffixes by which pictures are known among the files of a folder
    ".jpg", ".jpeg", ".png", ".tif", ".tiff", ".exr", ".hdr", ".webp", ".avif", ".heic", ".heif", ".bmp",
    ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".rw2", ".orf", ".ppm", ".dpx",
)  # fmt: skip


@checks_arguments
def read(
    path: quantities.FileOrStream,
    *,
    colour_space: quantities.ColourSpace = None,
    layer: str | None = None,
    alpha: str | None = None,
) -> np.ndarray:
    """Read an image.

    Parameters
    ----------
    path
        A file that OpenImageIO reads: PNG, JPEG, WebP, TIFF, OpenEXR, Radiance, PPM and others; AVIF; with
        the extra `phone` also HEIC and camera raw, which is developed with the camera's white balance.
        `plate.exr:albedo` is the layer "albedo" of an OpenEXR file. Or a stream of such a file's bytes, from
        where it stands; errors call it "stream".
    colour_space
        The file's colour space ("sRGB", "lin_rec709", "ACEScg", "Rec.2020", "ARRI LogC4"..., see
        `relight.media.colour`), if the file does not state it or states it wrongly. `docs/files.md` lists the
        statements of each container, and their priority.
    layer
        A layer of an OpenEXR file of one or several parts. By default the channels R, G, B, or the layer or
        part with the name rgba, beauty, C, or another usual name of the picture itself.
    alpha
        "straight" or "premultiplied", if the file states it wrongly. By default what the file states, or else
        straight for integers and premultiplied for floats.

    Returns
    -------
    np.ndarray
        (H, W, 3), or (H, W, 4) if there is alpha: float32, linear Rec.709, premultiplied, unbounded. Grey
        becomes three equal channels; OpenEXR's luminance and full-size chroma become red, green and blue. The
        picture is upright (Exif orientation), fills its display window and has square pixels.

    Raises
    ------
    FileNotFoundError
        No such file.
    ValueError
        Not an image, truncated, NaN or infinite values, an unknown colour space, profile or layer.

    Examples
    --------
    >>> image = relight.read("examples/person.png")
    >>> str(image.dtype)
    'float32'
    """
    if is_stream(path):
        with as_file(path) as file:
            return read(file, colour_space=colour_space, layer=layer, alpha=alpha)
    if alpha is not None and alpha not in ALPHA:
        raise ValueError(f"alpha: expected {' or '.join(ALPHA)}, got {alpha!r}")
    stored = load(path, layer=layer, wanted=("R", "G", "B", "A", *LUMINANCE_CHROMA), space=colour_space)
    if stored.unsigned:
        raise ValueError(
            f"{path}: holds OpenEXR's UINT, which are numbers of objects; expected half or float"
        )
    straight = stored.straight if alpha is None else alpha == "straight"
    try:
        light = linearise(_colours(stored), straight=straight, space=stored.space)
    except ValueError as error:
        subject = "its colour profile " if isinstance(stored.space, Profile) else ""
        raise ValueError(f"{path}: {subject}{error}") from error
    if not np.isfinite(light).all():
        raise ValueError(f"{path}: contains NaN or infinite values")
    if light.shape[-1] == 4:
        low, high = float(light[..., 3].min()), float(light[..., 3].max())
        if low < -OVERSHOOT or high > 1 + OVERSHOOT:
            raise ValueError(f"{path}: expected alpha in [0, 1], got [{low:g}, {high:g}]")
        light[..., 3] = light[..., 3].clip(0, 1)
    return np.ascontiguousarray(squared(path, light, stored.aspect))  # as other libraries want it


def squared(path: AnyPath, pixels: np.ndarray, aspect: float, *, nearest: bool = False) -> np.ndarray:
    """Return pixels (H, W, C) or (H, W), resampled to square ones; warn once for the files of a folder."""
    if is_square(aspect):
        return pixels
    key = (Path(path).parent, round(aspect, 3))
    if key not in _warned:
        _warned.add(key)
        warnings.warn(f"{path}: its pixels are {aspect:.4g} times as wide as high; {SQUARED}", stacklevel=3)
    return square_pixels(pixels, aspect, nearest=nearest)


def _colours(stored: StoredPicture) -> np.ndarray:
    """Return red, green, blue, and alpha if there is one, of a picture's channels: (H, W, 3|4)."""
    pixels, names = stored.pixels, list(stored.names)
    alpha = [names.index("A")] if "A" in names else []
    if all(name in names for name in LUMINANCE_CHROMA):
        y, ry, by = (pixels[..., names.index(name)] for name in LUMINANCE_CHROMA)
        primaries = stored.space.chromaticities if isinstance(stored.space, Encoding) else REC709
        weights = rgb_to_xyz(primaries)[1]
        red, blue = (ry + 1) * y, (by + 1) * y  # OpenEXR's technical introduction, "Luminance/Chroma Images"
        green = (y - weights[0] * red - weights[2] * blue) / weights[1]
        return np.concatenate([np.stack([red, green, blue], axis=-1), pixels[..., alpha]], axis=-1)
    colours = [names.index(name) for name in "RGB" if name in names]
    colours = colours or [names.index(name) for name in "Y" if name in names and "X" not in names]
    if len(colours) not in (1, 3):
        raise ValueError(f"expected channels R, G, B or Y, with or without A; got {', '.join(names)}")
    if [*colours, *alpha] == list(range(len(names))) and len(colours) == 3:
        return pixels
    return pixels[..., [*(colours * 3)[:3], *alpha]]


@checks_arguments
def read_layers(path: quantities.File) -> dict[str, np.ndarray]:
    """Read the layers of an OpenEXR file: {name: (H, W, C) float32}, unconverted, in the file's order.

    A layer has the channels `name.*`, or those of the part `name`, or is the depth, `Z`. The channels without
    a layer name, and a part `rgba`, are the picture itself, which `read` reads. The result is empty if there
    are no layers. Raises as `read` does.

    Examples
    --------
    >>> image = relight.read("examples/person.png")
    >>> relight.write("copy.exr", image, layers={"C_key": image})
    >>> list(relight.read_layers("copy.exr"))
    ['C_key']
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    names = [name for name in layers_of(path) if name.lower() not in ("", "rgba")]
    layers = {}
    for name in names:
        stored = load(path, layer=name, space=colour.LINEAR, unconverted=True)
        layers[name] = np.asarray(stored.pixels, np.float32)
    return layers


def read_size(path: AnyPath) -> tuple[int, int]:
    """Read the size (H, W) of a picture as it is stored. ValueError where it cannot be read."""
    file = oiio.ImageInput.open(str(path))
    if file is None:
        raise ValueError(f"{path}: cannot be read as an image: {problem(oiio)}")
    return file.spec().full_height, file.spec().full_width


def read_camera(path: AnyPath) -> tuple[tuple[float, float, float], float] | None:
    """Read the camera that the header of a picture with the pass P states; None where it states none.

    Returns (x, y, z) in metres from the origin of positions, and the focal length in pixels.
    """
    file = oiio.ImageInput.open(str(path))
    if file is None:
        problem(oiio)
        return None
    eye = file.spec().getattribute("relight:camera")
    focal = file.spec().getattribute("relight:focal_length")
    if eye is None or focal is None:
        return None
    x, y, z = map(float, eye)
    return (x, y, z), float(focal)


def read_content_hash(path: AnyPath) -> str | None:
    """Read the content hash that a picture's file carries.

    None if it carries none, if there is no picture, or if a part of it is missing: its last row cannot be
    read, or its size and channels are not those that it was written with.
    """
    file = oiio.ImageInput.open(str(path))
    if file is None:
        problem(oiio)  # clears the error, which the next file would report
        return None
    spec = file.spec()
    digest = spec.get_string_attribute(content_hash.HASH_ATTRIBUTE)
    holds = spec.get_string_attribute(content_hash.CONTENTS_ATTRIBUTE)
    try:
        if not digest or (holds and holds != content_hash.describe_contents(spec)):
            return None
    except UnicodeDecodeError:  # the channels' names are garbled
        return None
    last = spec.y + spec.height - 1
    pixels = file.read_scanlines(0, 0, last, last + 1, 0, 0, spec.nchannels, str(spec.format))
    return None if pixels is None or problem(file) else digest
