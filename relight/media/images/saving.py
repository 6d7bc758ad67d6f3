"""Saving encoded pixels in the format of a file's suffix, to files that are whole or not there."""

import functools
import io
import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from PIL import ExifTags, Image, ImageCms, PngImagePlugin
from PIL.TiffImagePlugin import IFDRational

from relight.media import content_hash
from relight.media.buffers import problem
from relight.media.images import xmp
from shadow import files

JPEG_LARGEST = 65500  # pixels a side, of libjpeg
JPEG_QUALITY = 98  # of 100: differences that the eye does not find
EXIF = "Exif:"  # before names in the metadata of OpenImageIO
RENAMED = {"PhotographicSensitivity": "ISOSpeedRatings"}  # Pillow has the tag's older name


def save(path: Path, blocks: Iterable[np.ndarray], spec: oiio.ImageSpec) -> None:
    """Write a file that is whole or not there, from its rows (rows, W, C), some or all at a time."""
    is_tiff = path.suffix.lower() in (".tif", ".tiff")
    if is_tiff and _is_srgb(spec):
        profile = _srgb_profile()
        spec.attribute(
            "ICCProfile", oiio.TypeDesc(f"uint8[{len(profile)}]"), np.frombuffer(profile, np.uint8)
        )
    with files.replacing(path) as beside:
        if path.suffix.lower() in (".jpeg", ".jpg"):
            beside.write_bytes(_jpeg(np.concatenate(list(blocks)), spec))
            return
        file = oiio.ImageOutput.create(str(path))  # by its suffix
        if file is None:
            raise OSError(f"{path}: cannot be written: {problem(oiio)}")
        written, row = file.open(str(beside), spec), spec.y
        for block in blocks if written else ():
            written = written and file.write_scanlines(row, row + len(block), 0, block)
            row += len(block)
        if not (file.close() and written):
            raise OSError(f"{path}: cannot be written: {problem(file)}")
        if path.suffix.lower() == ".png":
            _check_png(path, beside)
            if about := xmp.packet(spec):
                xmp.add_to_png(beside, about)
        elif is_tiff and spec.getattribute("Keywords"):
            xmp.replace_in_tiff(beside, xmp.packet(spec))  # OpenImageIO's XMP has no keywords


def _jpeg(pixels: np.ndarray, spec: oiio.ImageSpec) -> bytes:
    """Return a JPEG file of encoded pixels (H, W, 1|3) in [0, 1].

    By Pillow, in memory: OpenImageIO's writer ends the process when the disk is full.
    """
    exif = Image.Exif()
    for attribute in spec.extra_attribs:
        if attribute.name in ExifTags.Base.__members__:
            exif[ExifTags.Base[attribute.name]] = attribute.value
        elif attribute.name == content_hash.HASH_ATTRIBUTE:
            exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.ImageUniqueID] = attribute.value
        elif attribute.name.startswith(EXIF) and isinstance(attribute.value, str | int | float):
            name = attribute.name.removeprefix(EXIF)
            tag = ExifTags.Base.__members__.get(RENAMED.get(name, name))
            if tag is not None:  # whose numbers, unless they are whole, are fractions
                is_real = isinstance(attribute.value, float)
                value = IFDRational(float(attribute.value)) if is_real else attribute.value
                exif.get_ifd(ExifTags.IFD.Exif)[tag] = value
    file = io.BytesIO()
    codes = np.rint(pixels * 255).astype(np.uint8)
    profile = _srgb_profile() if _is_srgb(spec) else None
    Image.fromarray(codes).save(
        file, "JPEG", quality=JPEG_QUALITY, exif=exif, icc_profile=profile, xmp=xmp.packet(spec)
    )
    return file.getvalue()


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
