"""Saving encoded pixels in the format of a file's suffix, to files that are whole or not there."""

import functools
import io
import math
import struct
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from PIL import ExifTags, Image, ImageCms, PngImagePlugin
from PIL.TiffImagePlugin import IFDRational

from relight.media import content_hash
from relight.media.buffers import problem
from relight.media.images.containers import tiff_fields, xmp
from relight.media.images.containers.headers import PRIMARY_CHROMATICITIES, WHITE_POINT
from relight.media.images.containers.tiff_fields import Field
from shadow import files

LARGEST = {".jpg": 65500, ".jpeg": 65500, ".webp": 16383}  # pixels a side, of libjpeg and libwebp
QUALITY = 98  # of 100, of JPEG and WebP: differences that the eye does not find
LOSSY = {".jpg": "JPEG", ".jpeg": "JPEG", ".webp": "WEBP"}  # formats that Pillow writes
EXIF = "Exif:"  # before names in the metadata of OpenImageIO
OF_EXPOSURE = ("ExposureTime", "FNumber")  # which OpenImageIO names without Exif
SENSITIVITY = f"{EXIF}PhotographicSensitivity"
LARGEST_SENSITIVITY = 65535  # means that it is larger (Exif 2.32, PhotographicSensitivity)
DENOMINATOR = 1_000_000  # of a fraction of Exif, at most
RENAMED = {"PhotographicSensitivity": "ISOSpeedRatings"}  # Pillow has the tag's older name


def save(path: Path, pixels: np.ndarray, spec: oiio.ImageSpec, quality: int = QUALITY) -> None:
    """Write pixels (H, W, C) to a file, not OpenEXR, that is whole or not there.

    `quality`: of JPEG and WebP, 1 to 100.
    """
    is_tiff = path.suffix.lower() in (".tif", ".tiff")
    if is_tiff and _is_srgb(spec):
        profile = _srgb_profile()
        spec.attribute(
            "ICCProfile", oiio.TypeDesc(f"uint8[{len(profile)}]"), np.frombuffer(profile, np.uint8)
        )
    if spec.get_int_attribute(SENSITIVITY) > LARGEST_SENSITIVITY:
        spec.attribute(SENSITIVITY, LARGEST_SENSITIVITY)
    with files.replacing(path) as beside:
        if kind := LOSSY.get(path.suffix.lower()):
            beside.write_bytes(_lossy(pixels, spec, kind, quality))
            return
        file = oiio.ImageOutput.create(str(path))  # by its suffix
        if file is None:
            raise OSError(f"{path}: cannot be written: {problem(oiio)}")
        written = file.open(str(beside), spec) and file.write_image(np.ascontiguousarray(pixels))
        if not (file.close() and written):
            raise OSError(f"{path}: cannot be written: {problem(file)}")
        if path.suffix.lower() == ".png":
            _check_png(path, beside)
            if about := xmp.packet(spec):
                xmp.add_to_png(beside, about)
        elif is_tiff:
            _complete_tiff(beside, spec)


def _complete_tiff(path: Path, spec: oiio.ImageSpec) -> None:
    """Add to a TIFF what OpenImageIO leaves out: chromaticities, keywords, sensitivity, the lens's range."""
    order = tiff_fields.byte_order(path)
    fields: dict[int, Field] = {}
    exif: dict[int, Field] = {}

    def ratios(numbers: Sequence[float]) -> Field:
        kind, code = (tiff_fields.RATIONAL, "I") if min(numbers) >= 0 else (tiff_fields.SRATIONAL, "i")
        pairs = [(ratio.numerator, ratio.denominator) for ratio in map(_rational, numbers)]
        data = b"".join(struct.pack(f"{order}2{code}", *pair) for pair in pairs)
        return Field(kind, len(pairs), data)

    chromaticities = spec.getattribute("chromaticities")
    if chromaticities is not None:
        fields[WHITE_POINT] = ratios(chromaticities[6:])
        fields[PRIMARY_CHROMATICITIES] = ratios(chromaticities[:6])
    if spec.getattribute("Keywords"):
        about = xmp.packet(spec)
        fields[xmp.TIFF_TAG] = Field(tiff_fields.BYTE, len(about), about)
    sensitivity = spec.get_int_attribute(SENSITIVITY)
    if sensitivity > 0:
        data = struct.pack(f"{order}H", sensitivity)
        exif[ExifTags.Base.ISOSpeedRatings] = Field(tiff_fields.SHORT, 1, data)
    lens = spec.getattribute(f"{EXIF}LensSpecification")
    if isinstance(lens, tuple):
        exif[ExifTags.Base.LensSpecification] = ratios(lens)
    if fields or exif:
        tiff_fields.add_fields(path, fields, exif)


def _lossy(pixels: np.ndarray, spec: oiio.ImageSpec, kind: str, quality: int) -> bytes:
    """Return a file, "JPEG" or "WEBP", of encoded pixels (H, W, 1|3|4) in [0, 1].

    By Pillow, in memory: OpenImageIO's writer ends the process when the disk is full.
    """
    exif = Image.Exif()
    for attribute in spec.extra_attribs:
        if attribute.name in ExifTags.Base.__members__ and attribute.name not in OF_EXPOSURE:
            exif[ExifTags.Base[attribute.name]] = attribute.value
        elif attribute.name == content_hash.HASH_ATTRIBUTE:
            exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.ImageUniqueID] = attribute.value
        elif attribute.name.startswith((EXIF, *OF_EXPOSURE)):
            name = attribute.name.removeprefix(EXIF)
            tag = ExifTags.Base.__members__.get(RENAMED.get(name, name))
            value = _exif_value(attribute.value)
            if tag is not None and value is not None:
                exif.get_ifd(ExifTags.IFD.Exif)[tag] = value
    profile = _srgb_profile() if _is_srgb(spec) else None
    options = {"exif": exif, "icc_profile": profile, "xmp": xmp.packet(spec)}
    given = {key: value for key, value in options.items() if value} if kind == "WEBP" else options
    return compressed(pixels, kind, quality=quality, **given)


def compressed(pixels: np.ndarray, kind: str, **options: object) -> bytes:
    """Return a file, "PNG", "JPEG" or "WEBP", of encoded pixels in [0, 1], 8 bits; `options`: of Pillow."""
    file = io.BytesIO()
    Image.fromarray(np.rint(pixels * 255).astype(np.uint8)).save(file, kind, **options)
    return file.getvalue()


def _exif_value(value: object) -> object:
    """Return a value of OpenImageIO as Pillow writes it: real numbers are fractions. None for other types."""
    if isinstance(value, tuple) and all(isinstance(number, float) for number in value):
        return tuple(map(_rational, value))
    if isinstance(value, float):
        return _rational(value)
    return value if isinstance(value, str | int) else None


def _rational(value: float) -> IFDRational:
    """Return a number of seven digits as a fraction: 0.008 as 1/125; 0/0, unknown, where it is not finite."""
    if not math.isfinite(value):
        return IFDRational(0, 0)
    ratio = Fraction(f"{value:.7g}").limit_denominator(DENOMINATOR)
    return IFDRational(ratio.numerator, ratio.denominator)


def _is_srgb(spec: oiio.ImageSpec) -> bool:
    """Return whether pixels are colours, sRGB-encoded, and no matte."""
    return spec.nchannels >= 3 and spec.getattribute("oiio:ColorSpace") == "srgb_rec709_scene"


@functools.cache
def _srgb_profile() -> bytes:
    """Return an ICC profile of sRGB, with a date of its own, so that equal pictures are equal files."""
    made = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    date = struct.pack(">6H", 2000, 1, 1, 0, 0, 0)  # ICC.1:2022, 7.2.8: bytes 24 to 35
    return made[:24] + date + made[36:]


def _check_png(path: Path, written: Path) -> None:
    """Raise OSError unless a file is a whole PNG: OpenImageIO's writer does not notice a full disk."""
    try:
        # Not Image.open, which refuses pictures above 179 megapixels.
        with PngImagePlugin.PngImageFile(written) as file:
            file.verify()  # every chunk's checksum, to the end
    except (OSError, SyntaxError) as error:
        raise OSError(f"{path}: cannot be written: it came out truncated; is the disk full?") from error
