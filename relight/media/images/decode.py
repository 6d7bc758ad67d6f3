"""Loading pictures: pixels, and the one place in which it is decided what a file says of them."""

import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from PIL import JpegImagePlugin

from relight.media import colour
from relight.media.buffers import Failing, problem
from relight.media.encodings import AP0, REC709, Encoding, decode_bt709, decode_linear, decode_srgb
from relight.media.icc import Profile
from relight.media.images.containers import headers, isobmff, pages, phone
from relight.media.images.containers.jpeg2000 import jpeg2000_header, jpeg2000_space
from relight.media.images.containers.photometric import GREY, check_photometric, white_is_one
from relight.media.images.cryptomatte import check_no_cryptomatte
from relight.media.images.layers import (
    Layer,
    Part,
    StoredPicture,
    find_beauty,
    find_layer,
    index_layers,
    split_layer,
)
from relight.media.pixel_aspect import SIDEWAYS, growth, upright
from relight.media.regular_file import naming
from shadow.files import AnyPath

# OpenImageIO's own limit, 1024, is passed by an OpenEXR file of 256 lights; more than this is a damaged file.
oiio.attribute("limits:channels", 1 << 14)
JPEG_XL = b"\xff\x0a", b"\0\0\0\x0cJXL "  # a codestream, a container
LEAST_JPEG_XL = 256  # bytes, below which OpenImageIO does not know one
LARGEST_PART = 1024  # number of parts of an OpenEXR file, beyond which it is damaged
PREMULTIPLIED_TARGA = 4  # attributes type of a Targa file's extension


def load(
    path: AnyPath,
    *,
    layer: str | None = None,
    wanted: Collection[str] | None = None,
    space: colour.Space | None = None,
    unconverted: bool = False,
) -> StoredPicture:
    """Load a picture as its file stores it.

    `layer`: of an OpenEXR file, which may also be `plate.exr:LAYER`: its channels, under the names R, G, B,
    A, X, Y, Z. Unless given, all channels of the file's only part, or of the part that holds the picture
    itself. `wanted`: names of the channels that are needed: the picture itself, and no more than lies from
    the first to the last of them. `space`: the colour space, where the caller knows it: then what the file
    states is not looked at. `unconverted`: whether the layer may hold numbers of objects (Cryptomatte).

    Raises FileNotFoundError, and ValueError, which names the file: no picture, a damaged one, no such layer,
    or a statement that cannot be honoured.
    """
    path, named = split_layer(path)
    layer = layer if layer is not None else named
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    if not path.is_file():
        raise ValueError(f"{path}: expected a file")
    read_phone = phone.reader(path)
    with naming(path):
        if read_phone is not None:
            if layer is not None:
                raise ValueError("layer: only OpenEXR files have layers")
            picture = read_phone(path)
            return picture if space is None else replace(picture, space=space)
        with _openable(path) as file:
            return _load(path, file, layer, wanted, space, unconverted)


def layers_of(path: AnyPath) -> dict[str, Layer]:
    """Return the layers of an OpenEXR file, the picture itself without a name; raises as `load` does."""
    path = Path(path)
    with naming(path), _openable(path) as file:
        return index_layers(_parts(_opened(file)))


def read_pixel_aspect(path: AnyPath) -> float:
    """Return how many times as wide as high a file's pixels are, standing upright; 1 where unknown."""
    path, _ = split_layer(path)
    if phone.reader(path) is not None:
        return 1.0
    with naming(path), _openable(path) as file:
        opened = _opened(file)
        return _upright_aspect(path, opened.format_name(), opened.spec())


def holds_display_light(path: AnyPath, space: colour.Space | None = None) -> bool:
    """Return whether a file holds code values of a display, integers whose white is 1; raises as `load`.

    `space`: the colour space, where the caller knows it.
    """
    path, _ = split_layer(path)
    with naming(path):
        if phone.reader(path) is not None:
            with path.open("rb") as start:
                points = isobmff.read_code_points(start.read(isobmff.HEADER))
            stated = space or (points and Encoding.from_code_points(*points, unspecified=decode_srgb))
            return colour.is_display_light(stated or colour.SRGB)
        with _openable(path) as file:
            opened = _opened(file)
            kind, spec = opened.format_name(), opened.spec()
            if str(spec.format) not in ("uint8", "uint16"):
                return kind == "jpeg"  # with a gain map: the base picture is read
            return colour.is_display_light(space or _stated_space(path, kind, spec, True))


def _upright_aspect(path: Path, kind: str, spec: oiio.ImageSpec) -> float:
    aspect = spec.get_float_attribute("PixelAspectRatio", 1.0) or 1.0
    if kind == "jpeg":  # OpenImageIO takes densities for aspects, which are the inverse (JFIF 1.02)
        aspect = 1 / aspect
    if kind == "hdr":
        aspect = headers.radiance_header(path).aspect
    if kind == "jpeg2000":
        aspect = jpeg2000_header(path).aspect
    return 1 / aspect if spec.get_int_attribute("Orientation", 1) in SIDEWAYS else aspect


@contextmanager
def _openable(path: Path) -> Iterator[Path]:
    """Give the file that OpenImageIO is to open: `path`, or a copy that it reads.

    It reads XYZE under the name of RGBE, and a small JPEG XL with zeros behind.
    """
    with path.open("rb") as file:
        start = file.read(LEAST_JPEG_XL)
    radiance = headers.radiance_header(path)
    if start.startswith(JPEG_XL) and len(start) < LEAST_JPEG_XL:
        name, content = "padded.jxl", start.ljust(LEAST_JPEG_XL, b"\0")
    elif radiance.is_xyz and radiance.format_at >= 0:
        head, _, rest = path.read_bytes().partition(b"_xyze")
        name, content = "rgbe.hdr", head + b"_rgbe" + rest
    else:
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / name
        copy.write_bytes(content)
        yield copy


def _opened(file: Path) -> oiio.ImageInput:
    """Open a picture. ValueError where it is none."""
    headers.check_png(file)
    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)  # or encoded values would come premultiplied
    hints.attribute("pnm:pfmflip", 1)  # a PFM's first row is the lowest
    opened = oiio.ImageInput.open(str(file), hints)
    if opened is None:
        raise ValueError(f"cannot be read as an image: {_reason(oiio)}")
    return opened


def _reason(source: Failing) -> str:
    """Return OpenImageIO's words, or what to do where it cannot read chroma of half the size."""
    reason = problem(source)
    if "could not find a format reader" in reason:
        return "its format is not known"
    if "subsampl" in reason.lower():
        reason = reason.rstrip(".") + "; save it as red, green and blue, or with chroma of full size"
    return reason


def _parts(file: oiio.ImageInput, first: int = 0) -> list[Part]:
    """Return the parts of an OpenEXR file that are not deep; of other files the picture `first`."""
    many, parts = file.format_name() == "openexr", []
    for index in range(LARGEST_PART) if many else (first,):
        if not file.seek_subimage(index, 0):
            problem(file)  # clears the error, which the next file would report
            break
        spec = file.spec(index, 0)
        if not spec.deep:
            parts.append(Part(index, spec.get_string_attribute("oiio:subimagename"), _channels(spec)))
    if not parts:
        raise ValueError("is a deep image, expected a flat one")
    return parts


def _channels(spec: oiio.ImageSpec) -> tuple[str, ...]:
    try:
        names = tuple(spec.channelnames)
    except UnicodeDecodeError as error:
        raise ValueError("is damaged: its channels' names are garbled") from error
    if not names:
        raise ValueError("is damaged: it has no channels")
    if len(names) > 1 and spec.get_int_attribute("tiff:PhotometricInterpretation", -1) in GREY:
        # OpenImageIO calls samples that the file does not name R, G, B, by their count.
        return ("Y", *(name if name == "A" else f"channel{index}" for index, name in enumerate(names[1:], 1)))
    return names


def _load(
    path: Path,
    file: Path,
    layer: str | None,
    wanted: Collection[str] | None,
    space: colour.Space | None,
    unconverted: bool,
) -> StoredPicture:
    opened = _opened(file)
    kind = opened.format_name()
    if layer is not None and kind != "openexr":
        raise ValueError("layer: only OpenEXR files have layers")
    pages.warn_of_animation(file, kind)
    chosen = _chosen(_parts(opened, pages.whole_page(opened, path)), kind, layer, wanted)
    names = {number: name for name, number in chosen.channels.items()}
    if "X" in chosen.channels:  # vectors: their Y is not a grey picture
        wanted = None
    numbers = sorted(number for number, name in names.items() if wanted is None or name in wanted)
    numbers = numbers or sorted(names)
    spec = opened.spec(chosen.part.index, 0)
    if kind == "openexr" and not unconverted:
        whole = (chosen.part.channels[number] for number in numbers)
        check_no_cryptomatte(spec, {name.rpartition(".")[0] or chosen.part.name for name in whole})
    width = round(max(spec.width, spec.full_width) * growth(_upright_aspect(path, kind, spec)))
    pages.check_size(width, max(spec.height, spec.full_height), path.stat().st_size)
    if kind == "jpeg" and str(spec.format) != "uint8":  # with a gain map, which OpenImageIO has applied
        return _base_of_gain_map(path, space)
    if kind == "psd":
        headers.check_merged_picture(path)
    if kind == "bmp":
        with path.open("rb") as start:
            headers.check_bmp_masks(start.read(256))
    check_photometric(spec)
    first, last = numbers[0], numbers[-1] + 1
    try:
        pixels, unsigned = _pixels(opened, chosen.part, spec, first, last)
    except ValueError as error:
        if "Ultra HDR" not in str(error):  # its gain map cannot be applied, and is not wanted
            raise
        return _base_of_gain_map(path, space)
    pixels = white_is_one(spec, pixels, [names.get(number, "") for number in range(first, last)])
    if len(numbers) < last - first:
        pixels = pixels[..., [number - first for number in numbers]]
    if space is None:
        space = _stated_space(path, kind, spec, np.issubdtype(pixels.dtype, np.integer))
    return _stated(path, kind, spec, pixels, tuple(names[number] for number in numbers), space, unsigned)


def _chosen(parts: list[Part], kind: str, layer: str | None, wanted: Collection[str] | None) -> Layer:
    """Return the layer to load; its channels have their whole names where all of a part are asked for."""
    if layer is not None:
        return find_layer(index_layers(parts), layer)
    if kind == "openexr" and (wanted is not None or len(parts) > 1):
        beauty = find_beauty(index_layers(parts))
        if wanted is not None:
            return beauty
        parts = [beauty.part]
    return Layer(parts[0], {name: number for number, name in enumerate(parts[0].channels)})


def _pixels(
    file: oiio.ImageInput, part: Part, spec: oiio.ImageSpec, first: int, last: int
) -> tuple[np.ndarray, bool]:
    """Return the channels of a part from `first` to before `last`, (H, W, C) in its display window, and
    whether any of them is OpenEXR's UINT."""
    exr = file.format_name() == "openexr"
    formats = [str(kind) for kind in (spec.channelformats or [spec.format] * spec.nchannels)][first:last]
    unsigned = [index for index, kind in enumerate(formats) if exr and kind == "uint"]
    kind = "float"
    if not exr and str(spec.format) in ("uint8", "uint16"):
        kind = str(spec.format)
    elif not exr and "int" in str(spec.format):  # 32 bits, or signed: over the full range of the type
        kind = "uint16"
    try:
        pixels = file.read_image(part.index, 0, first, last, kind)
        failure = problem(file)  # a truncated JPEG returns a picture *and* an error
        if pixels is None or failure:
            raise ValueError(f"is damaged or truncated: {failure}")
        for index in unsigned:  # as float, OpenImageIO would divide them by the highest number
            values = file.read_image(part.index, 0, first + index, first + index + 1, "uint")
            pixels[..., index] = 0 if values is None else values[..., 0]
        file.close()
        return _in_display_window(pixels, spec), bool(unsigned)
    except MemoryError as error:
        size = f"{spec.full_width} x {spec.full_height}"
        raise ValueError(f"is damaged, or too large to read: it says {size} pixels") from error


def _base_of_gain_map(path: Path, space: colour.Space | None) -> StoredPicture:
    """Load the base picture of a JPEG with a gain map (ISO 21496-1, Ultra HDR): what every display shows."""
    try:
        with JpegImagePlugin.JpegImageFile(path) as file:
            profile, orientation = file.info.get("icc_profile"), file.getexif().get(0x112, 1)
            if space is None:
                space = Profile.parse(profile) if profile else headers.encoding_of_exif(file.getexif())
            pixels = np.asarray(file.convert("RGB"))
    except (OSError, SyntaxError) as error:
        raise ValueError(f"cannot be read as an image: {error}") from error
    pixels = upright(pixels, orientation)
    return StoredPicture(pixels, ("R", "G", "B"), space or colour.SRGB, straight=True)


def _stated(
    path: Path,
    kind: str,
    spec: oiio.ImageSpec,
    pixels: np.ndarray,
    names: tuple[str, ...],
    space: colour.Space,
    unsigned: bool,
) -> StoredPicture:
    """Return a picture with what else its file states: orientation, alpha, pixel shape and exposure."""
    orientation = spec.get_int_attribute("Orientation", 1)
    if kind == "hdr":
        pixels = pixels / np.array(headers.radiance_header(path).exposure, np.float32)
    if kind in ("bmp", "targa") and len(names) == 4 and _alpha_is_unused(path, kind, spec):
        pixels, names = pixels[..., :3], names[:3]
    return StoredPicture(
        upright(pixels, orientation),
        names,
        space,
        straight=_is_straight(path, kind, spec, pixels),
        aspect=_upright_aspect(path, kind, spec),
        unsigned=unsigned,
    )


def _is_straight(path: Path, kind: str, spec: oiio.ImageSpec, pixels: np.ndarray) -> bool:
    """Return whether colours are not multiplied by alpha: integers, unless their file says so."""
    if kind == "jpeg2000":
        return not jpeg2000_header(path).is_premultiplied
    if kind == "targa" and spec.get_int_attribute("targa:alpha_type", -1) == PREMULTIPLIED_TARGA:
        return False
    integer = np.issubdtype(pixels.dtype, np.integer)
    return bool(spec.get_int_attribute("oiio:UnassociatedAlpha")) or (integer and kind != "tiff")


def _alpha_is_unused(path: Path, kind: str, spec: oiio.ImageSpec) -> bool:
    """Return whether the fourth channel of a BMP or Targa file is no alpha."""
    if kind == "targa":
        return headers.has_unused_targa_alpha(path, spec.get_int_attribute("targa:alpha_type", -1))
    with path.open("rb") as file:
        return headers.has_unused_bmp_alpha(file.read(256))


def _stated_space(path: Path, kind: str, spec: oiio.ImageSpec, integer: bool) -> colour.Space:
    """Return the colour space that a file states, in the order of its specification, or its type implies."""
    first: colour.Space | bytes | None = None
    if kind == "png":
        stated, precedes = headers.png_encoding(path)
        first = stated if precedes or spec.getattribute("ICCProfile") is None else None
    elif kind == "bmp":
        first = headers.bmp_encoding(path.read_bytes())
    elif kind == "hdr":
        first = headers.radiance_encoding(path)
    elif kind == "jpeg2000":
        first = jpeg2000_space(path)
    if isinstance(first, bytes):
        return Profile.parse(first)
    if first is not None:
        return first
    profile = spec.getattribute("ICCProfile")
    if profile is not None:
        return Profile.parse(np.asarray(profile, np.uint8).tobytes())
    exif = headers.exif_encoding(path, kind)
    if isinstance(exif, Encoding):
        return exif if integer else Encoding(exif.chromaticities)
    if exif is not None and integer:
        return exif
    if kind == "pnm":  # its specification says BT.709; what writes it writes sRGB, and light as floats
        return colour.SRGB if integer else colour.LINEAR
    if kind == "tiff" and not integer:  # OpenImageIO calls every TIFF with Exif sRGB
        return colour.LINEAR
    return _named_space(spec, integer)


def _named_space(spec: oiio.ImageSpec, integer: bool) -> colour.Space:
    """Return the colour space of OpenImageIO's name, of chromaticities, or of the type."""
    declared = spec.get_string_attribute("oiio:ColorSpace")
    if not declared.isprintable():
        raise ValueError("is damaged: the name of its colour space is garbled")
    if declared == "Rec709":  # DPX and Cineon
        return Encoding(REC709, decode_bt709)
    if declared not in ("", "unknown"):  # a colorInteropID may say that the writer did not know
        return declared
    primaries, neutral = spec.getattribute("chromaticities"), spec.getattribute("adoptedNeutral")
    if integer or (primaries is None and neutral is None):
        is_aces = spec.get_int_attribute("acesImageContainerFlag") == 1 and not integer
        return Encoding(AP0) if is_aces else colour.SRGB if integer else colour.LINEAR
    white = None if neutral is None or len(neutral) != 2 else (float(neutral[0]), float(neutral[1]))
    return Encoding(tuple(REC709 if primaries is None else primaries), decode_linear, white)


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
