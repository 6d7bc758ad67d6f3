"""What phones and cameras write and OpenImageIO does not read: HEIC, AVIF and camera raw (extra `phone`)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from relight.media import colour

HEIF = (".heic", ".heif", ".hif")
AVIF = (".avif",)
RAW = (".arw", ".cr2", ".cr3", ".dng", ".nef", ".orf", ".pef", ".raf", ".raw", ".rw2", ".srw")
# Colour that a HEIF file says by numbers (ITU-T H.273): a display's curve, and P3's or Rec.709's primaries.
CURVES = (1, 2, 6, 13)
PRIMARIES = {1: colour.SRGB, 2: colour.SRGB, 12: "Display P3 - Display"}

Pixels = tuple[np.ndarray, oiio.ImageSpec]


def reader(path: Path) -> Callable[[Path], Pixels] | None:
    """What reads a file of this name here, or None for OpenImageIO.

    It returns pixels (H, W, C), upright, uint8, uint16 or float32, and the file's spec. It raises ImportError
    without the extra, ValueError for a damaged file.
    """
    readers = (
        dict.fromkeys(HEIF, _read_heif) | dict.fromkeys(AVIF, _read_avif) | dict.fromkeys(RAW, _read_raw)
    )
    return readers.get(path.suffix.lower())


def _read_heif(path: Path) -> Pixels:
    """HEIC by libheif, which turns it upright itself; 10 and 12 bits become 16."""
    try:
        import pillow_heif
    except ImportError as error:
        raise _missing(path, "pillow-heif") from error
    try:
        file = pillow_heif.open_heif(str(path), convert_hdr_to_8bit=False)
        pixels = np.asarray(file)
    except (RuntimeError, OSError, EOFError, SyntaxError, ValueError) as error:
        raise ValueError(f"{path}: cannot be read as HEIC: {error}") from error
    depth = int(file.info.get("bit_depth", 8))
    if pixels.dtype == np.uint16:  # libheif shifts codes up: white would be less than full
        codes = pixels >> (16 - depth)
        pixels = np.rint(codes * (65535 / (2**depth - 1))).astype(np.uint16)
    return _described(path, pixels, file.info.get("icc_profile"), file.info.get("nclx_profile"))


def _read_avif(path: Path) -> Pixels:
    """AVIF by Pillow, 8 bits a channel."""
    from PIL import Image, ImageOps

    try:
        with Image.open(path, formats=["AVIF"]) as file:
            profile = file.info.get("icc_profile")
            upright = ImageOps.exif_transpose(file)
            pixels = np.asarray(upright)
    except (OSError, SyntaxError, ValueError) as error:
        raise ValueError(f"{path}: cannot be read as AVIF: {error}") from error
    return _described(path, pixels, profile, None)


def _read_raw(path: Path) -> Pixels:
    """Camera raw by LibRaw: the camera's white balance, no brightening, linear Rec.709, upright."""
    try:
        import rawpy
    except ImportError as error:
        raise _missing(path, "rawpy") from error
    try:
        with rawpy.imread(str(path)) as file:
            developed = file.postprocess(
                gamma=(1, 1), no_auto_bright=True, use_camera_wb=True, output_bps=16,
                output_color=rawpy.ColorSpace.sRGB,
            )  # fmt: skip
    except rawpy.LibRawError as error:
        words = error.args[0] if error.args else error
        text = words.decode(errors="replace") if isinstance(words, bytes) else words
        raise ValueError(f"{path}: cannot be read as camera raw: {text}") from error
    pixels = developed.astype(np.float32) / 65535
    spec = _spec(pixels)
    spec.attribute("oiio:ColorSpace", colour.LINEAR)
    return pixels, spec


def _described(path: Path, pixels: np.ndarray, profile: bytes | None, numbers: Any) -> Pixels:
    """Pixels with straight alpha and what the file says of its colour: a profile, or H.273's numbers."""
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    spec = _spec(pixels)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    if profile:
        spec.attribute(
            "ICCProfile", oiio.TypeDesc(f"uint8[{len(profile)}]"), np.frombuffer(profile, np.uint8)
        )
    elif numbers:
        primaries, curve = numbers["color_primaries"], numbers["transfer_characteristics"]
        if primaries not in PRIMARIES or curve not in CURVES:
            raise ValueError(
                f"{path}: expected sRGB or Display P3, got colour of primaries {primaries} and curve {curve} "
                "(ITU-T H.273); convert it first"
            )
        spec.attribute("oiio:ColorSpace", PRIMARIES[primaries])
    return pixels, spec


def _spec(pixels: np.ndarray) -> oiio.ImageSpec:
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, str(pixels.dtype).replace("float32", "float"))
    spec.channelnames = {1: ("Y",), 2: ("Y", "A")}.get(channels, ("R", "G", "B", "A")[:channels])
    return spec


def _missing(path: Path, package: str) -> ImportError:
    return ImportError(f"{path}: needs {package}; install it with: pip install 'relight[phone]'")
