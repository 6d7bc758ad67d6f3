"""What the headers of PNG, BMP, Targa, Radiance and Exif say that OpenImageIO does not pass on."""

import math
import struct
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from PIL import ExifTags, Image, ImageFile, JpegImagePlugin, TiffImagePlugin, WebPImagePlugin

from relight.media.colour import SRGB
from relight.media.encodings import (
    ADOBE_GAMMA,
    ADOBE_RGB,
    D65,
    REC709,
    XYZ,
    Chromaticities,
    Encoding,
    Transfer,
    decode_srgb,
    power,
)

VERSION_INFO = 1057  # resource of a Photoshop file
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
LARGEST_CHUNK = 1 << 20  # bytes: what states a PNG's colour is small, but for its profile
EXPONENTS = 0.1, 10.0  # of transfer functions that are believed
PARSERS: dict[str, type[ImageFile.ImageFile]] = {
    "jpeg": JpegImagePlugin.JpegImageFile,
    "webp": WebPImagePlugin.WebPImageFile,
}
ADOBE = 2  # of Exif's ColorSpace: in no standard, but written by cameras
WHITE_POINT, PRIMARY_CHROMATICITIES = 0x13E, 0x13F  # of TIFF, and of Exif
BITFIELDS = 3, 6  # of a BMP's compression: masks say which bits are red, green, blue and alpha
ALPHA_BITFIELDS = 6
RADIANCE_HEADER = 1 << 16  # bytes of a Radiance file that are searched


def png_encoding(path: Path) -> tuple[Encoding | str | None, bool]:
    """Return what a PNG's chunks say of its colour, and whether they come before its ICC profile.

    The order is that of the PNG specification, third edition, section 4.3: cICP, iCCP, sRGB, then gAMA and
    cHRM. (None, False) where none of them is there. Raises ValueError for values that mean nothing.
    """
    chunks = png_chunks(path)
    if "cICP" in chunks and len(chunks["cICP"]) == 4:
        primaries, transfer, matrix, full = chunks["cICP"]
        if matrix != 0 or full != 1:
            raise ValueError(
                f"its chunk cICP says matrix {matrix} and range {full}; expected red, green and blue of full "
                "range (0 and 1)"
            )
        return Encoding.from_code_points(primaries, transfer, unspecified=decode_srgb), True
    if "sRGB" in chunks:
        return SRGB, False
    if "gAMA" not in chunks and "cHRM" not in chunks:
        return None, False
    curve: Transfer = decode_srgb
    chromaticities: Chromaticities = REC709
    if len(chunks.get("gAMA", b"")) == 4:
        (gamma,) = struct.unpack(">I", chunks["gAMA"])
        curve = power(_exponent(100000 / gamma if gamma else math.inf))
    if len(chunks.get("cHRM", b"")) == 32:
        values = [value / 100000 for value in struct.unpack(">8I", chunks["cHRM"])]
        chromaticities = (*values[2:], *values[:2])
    return Encoding(chromaticities, curve), False


def _exponent(exponent: float) -> float:
    if not EXPONENTS[0] <= exponent <= EXPONENTS[1]:
        raise ValueError(f"its header states an exponent of {exponent:.3g}; say which colour_space it is")
    return exponent


def png_chunks(path: Path) -> dict[str, bytes]:
    """Return the small chunks of a PNG before its pixels, the first of each kind."""
    chunks: dict[str, bytes] = {}
    with path.open("rb") as file:
        if file.read(8) != PNG_SIGNATURE:
            return chunks
        while len(head := file.read(8)) == 8:
            (length,), kind = struct.unpack(">I", head[:4]), head[4:].decode("latin-1")
            if kind in ("IDAT", "IEND"):
                break
            if length <= LARGEST_CHUNK:
                chunks.setdefault(kind, file.read(length))
                file.seek(4, 1)
            else:
                file.seek(length + 4, 1)
    return chunks


def check_png(path: Path) -> None:
    """Raise ValueError for a PNG that Xcode has converted, before libpng prints a line of its own."""
    with path.open("rb") as file:
        if file.read(16) == PNG_SIGNATURE + b"\0\0\0\4CgBI":
            raise ValueError(
                "was converted for iOS by Xcode (chunk CgBI) and is no PNG any more; use the original, or "
                "convert it by Xcode's `pngcrush -revert-iphone-optimizations`"
            )


def check_merged_picture(path: Path) -> None:
    """Raise ValueError for a Photoshop file without a merged picture, which is white there.

    The resource 1057 (Adobe Photoshop File Formats Specification, "Version Info") says whether there is one.
    """
    with path.open("rb") as file:
        head = file.read(30)
        file.seek(int.from_bytes(head[26:30]), 1)  # the colour table
        resources = file.read(int.from_bytes(file.read(4)))
    at = 0
    while resources[at : at + 4] == b"8BIM":
        kind, name = int.from_bytes(resources[at + 4 : at + 6]), resources[at + 6 : at + 7]
        at += 6 + (2 + name[0] & ~1 if name else 2)  # the name, with its length, fills whole words
        size, content = int.from_bytes(resources[at : at + 4]), at + 4
        if kind == VERSION_INFO and resources[content + 4 : content + 5] == b"\0":
            raise ValueError(
                "holds layers and no merged picture; save it with Photoshop's preference `Maximize PSD and "
                "PSB File Compatibility`"
            )
        at = content + size + size % 2


def exif_encoding(path: Path, kind: str) -> Encoding | str | None:
    """Return what the Exif data of a JPEG, PNG, TIFF or WebP file says of its colour; None if nothing.

    Exif that cannot be parsed says nothing.
    """
    if kind not in (*PARSERS, "png", "tiff"):
        return None
    try:
        if kind == "png":  # Pillow decodes the whole picture to look for Exif behind it
            exif = Image.Exif()
            exif.load(png_chunks(path)["eXIf"])
            return encoding_of_exif(exif)
        if kind == "tiff":
            with path.open("rb") as file, warnings.catch_warnings():
                warnings.simplefilter("ignore")  # Pillow's, of truncated files
                return encoding_of_exif(_tiff_exif(file))
        with PARSERS[kind](path) as file:
            return encoding_of_exif(file.getexif())
    except Exception:  # of many classes: Exif is a format of its own, and often damaged
        return None


def _tiff_exif(file: BinaryIO) -> Image.Exif:
    """Return the fields of a TIFF as Exif. Pillow's reader of TIFF refuses floats."""
    head, exif = file.read(16), Image.Exif()
    exif.bigtiff, exif.endian = 43 in head[2:4], "<" if head.startswith(b"II") else ">"
    first = TiffImagePlugin.ImageFileDirectory_v2(head if exif.bigtiff else head[:8]).next
    exif.load_from_fp(file, first)
    return exif


def encoding_of_exif(exif: Image.Exif) -> Encoding | str | None:
    """Return what Exif data says of colour: DCF 2.0's Adobe RGB, sRGB, or chromaticities and gamma."""
    details = exif.get_ifd(ExifTags.IFD.Exif)
    space = details.get(ExifTags.Base.ColorSpace)
    try:
        index = str(exif.get_ifd(ExifTags.IFD.Interop).get(1, "")).strip("\0 ")
    except KeyError:  # Pillow before 13, where there is no such directory
        index = ""
    if space == 1:
        return SRGB
    if index == "R03" or space == ADOBE:
        return Encoding(ADOBE_RGB, power(ADOBE_GAMMA))
    if PRIMARY_CHROMATICITIES not in exif:
        return None
    white = exif.get(WHITE_POINT, D65)
    chromaticities = tuple(float(value) for value in (*exif[PRIMARY_CHROMATICITIES], *white))
    gamma = details.get(ExifTags.Base.Gamma)
    return Encoding(chromaticities, decode_srgb if gamma is None else power(_exponent(float(gamma))))


def has_unused_bmp_alpha(data: bytes) -> bool:
    """Return whether the fourth byte of a 32-bit BMP's pixels is unused."""
    _, bits, compression = _bmp_header(data)
    if bits != 32:
        return False
    return compression == 0 or _bmp_masks(data)[3] == 0  # BI_RGB has none


def check_bmp_masks(data: bytes) -> None:
    """Raise ValueError for masks of a BMP that OpenImageIO does not look at.

    It takes 32 bits for blue, green, red and a fourth byte, and 16 bits for opaque.
    """
    _, bits, compression = _bmp_header(data)
    if compression not in BITFIELDS or bits not in (16, 32):
        return
    *colours, alpha = _bmp_masks(data)
    is_usual = bits == 16 or tuple(colours) == (0xFF0000, 0xFF00, 0xFF)
    if not is_usual or (bits == 16 and alpha) or alpha not in (0, 0xFF000000, 0x8000):
        masks = ", ".join(f"{mask:#x}" for mask in (*colours, alpha))
        raise ValueError(f"its header states the masks {masks} of {bits} bits; save it as PNG")


def _bmp_masks(data: bytes) -> tuple[int, ...]:
    """Return the masks of red, green, blue and alpha that follow the fields of a BMP's header."""
    size, _, compression = _bmp_header(data)
    has_alpha = size >= 56 or compression == ALPHA_BITFIELDS
    count = 4 if has_alpha else 3
    if len(data) < 54 + 4 * count:
        return (0, 0, 0, 0)
    masks = struct.unpack_from(f"<{count}I", data, 54)
    return masks if has_alpha else (*masks, 0)


def _bmp_header(data: bytes) -> tuple[int, int, int]:
    """Return the header's size, the bits a pixel and the compression."""
    if len(data) < 34:
        return 0, 0, 0
    return (
        struct.unpack_from("<I", data, 14)[0],
        struct.unpack_from("<H", data, 28)[0],
        struct.unpack_from("<I", data, 30)[0],
    )


def bmp_encoding(data: bytes) -> Encoding | bytes | str | None:
    """Return what the header of a BMP of version 4 or 5 says of its colour; bytes are an ICC profile.

    Raises ValueError for a profile that is in another file.
    """
    size = _bmp_header(data)[0]
    if size < 108 or len(data) < 14 + size:
        return None
    kind = data[70:74]
    if kind == b"BGRs":  # "sRGB" as a little-endian number
        return SRGB
    if kind == bytes(4):  # calibrated: end points in CIE XYZ, and gamma
        points = [value / 2**30 for value in struct.unpack_from("<9i", data, 74)]
        gammas = [value / 2**16 for value in struct.unpack_from("<3I", data, 110)]
        if not any(points) or not all(gammas):
            return None
        return _calibrated(points, gammas)
    if kind == b"DEBM" and size >= 124:  # embedded: an ICC profile
        start, length = struct.unpack_from("<II", data, 14 + 112)
        return data[14 + start : 14 + start + length]
    if kind == b"KNIL":
        raise ValueError("its colour profile is in another file; say which colour_space it is")
    return None


def _calibrated(points: list[float], gammas: list[float]) -> Encoding:
    """Return the encoding of end points (X, Y, Z of red, green and blue) and exponents."""
    if max(gammas) - min(gammas) > 0.01:
        raise ValueError("its header states a gamma for each channel; say which colour_space it is")
    xy, white = [], [sum(points[axis::3]) for axis in range(3)]
    for x, y, z in (points[:3], points[3:6], points[6:], white):
        total = x + y + z
        xy += [x / total if total else 0.0, y / total if total else 0.0]
    return Encoding(tuple(xy), power(_exponent(gammas[0])))


def has_unused_targa_alpha(path: Path, alpha_type: int) -> bool:
    """Return whether the fourth channel of a Targa file is no alpha.

    `alpha_type` is what its extension says, -1 without one: 0 to 2 are no alpha. Without an extension, a
    header of no attribute bits says so.
    """
    with path.open("rb") as file:
        header = file.read(18)
    if alpha_type >= 0:
        return alpha_type <= 2
    return len(header) == 18 and header[17] & 0x0F == 0


@dataclass(frozen=True)
class RadianceHeader:
    """The variables of a Radiance picture's header that change its values.

    exposure: what radiances were multiplied by, three numbers with COLORCORR. chromaticities: of PRIMARIES,
    None without, and for eight zeros. gamma: the exponent that gives light, at least 1. is_xyz: whether
    pixels are XYZE. aspect: width of a pixel over its height. format_at: where the format's name begins, in
    bytes.
    """

    exposure: tuple[float, float, float] = (1.0, 1.0, 1.0)
    chromaticities: tuple[float, ...] | None = None
    gamma: float = 1.0
    is_xyz: bool = False
    aspect: float = 1.0
    format_at: int = -1


def radiance_header(path: Path) -> RadianceHeader:
    """Read the header of a Radiance picture (its reference manual, "File Formats"); none of another file.

    EXPOSURE, COLORCORR and PIXASPECT multiply where they stand several times. Indented lines are those of
    pictures that this one was made from. Raises ValueError for values that are no numbers.
    """
    with path.open("rb") as file:
        data = file.read(RADIANCE_HEADER)
    if not data.startswith(b"#?"):
        return RadianceHeader()
    head = data[:RADIANCE_HEADER].partition(b"\n\n")[0]
    exposure, aspect, chromaticities, is_xyz = [1.0, 1.0, 1.0], 1.0, None, False
    gamma = 1.0
    for line in head.split(b"\n")[1:]:
        name, _, value = line.decode("latin-1").partition("=")
        name = name.rstrip().upper()
        if name == "EXPOSURE":
            factor = _numbers(name, value, 1)[0]
            exposure = [factor * number for number in exposure]
        elif name == "COLORCORR":
            exposure = [a * b for a, b in zip(exposure, _numbers(name, value, 3), strict=True)]
        elif name == "PIXASPECT":  # height over width
            aspect /= _numbers(name, value, 1)[0]
        elif name == "PRIMARIES":
            chromaticities = _chromaticities(name, value)
        elif name == "GAMMA":  # some programs mean the exponent of the encoding, others of its inverse
            (stated,) = _numbers(name, value, 1)
            gamma = _exponent(max(stated, 1 / stated))
        elif name == "FORMAT":
            is_xyz = value.strip().lower() == "32-bit_rle_xyze"
    return RadianceHeader(
        (exposure[0], exposure[1], exposure[2]), chromaticities, gamma, is_xyz, aspect, head.find(b"_xyze")
    )


def radiance_encoding(path: Path) -> Encoding:
    """Return what the header of a Radiance picture says of its colour."""
    header = radiance_header(path)
    return Encoding(XYZ if header.is_xyz else header.chromaticities or REC709, power(header.gamma))


def _numbers(name: str, text: str, count: int) -> list[float]:
    """Return positive numbers of a header's line."""
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(0 < number < math.inf for number in numbers):
        raise ValueError(f"its header states {name}={text.strip()!r}, expected {count} numbers > 0")
    return numbers


def _chromaticities(name: str, text: str) -> tuple[float, ...] | None:
    """Return eight numbers of a header's line; None for zeros, which several programs write."""
    try:
        numbers = tuple(float(word) for word in text.split())
    except ValueError:
        numbers = ()
    if len(numbers) != 8:
        raise ValueError(f"its header states {name}={text.strip()!r}, expected eight numbers")
    return numbers if any(numbers) else None
