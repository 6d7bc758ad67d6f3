"""Timecode, camera and lens that a picture's header states, for the files that are made from it."""

from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import OpenImageIO as oiio

from relight.media.buffers import problem
from relight.media.images.containers import phone
from relight.media.images.layers import split_layer
from relight.media.privacy import is_private
from shadow.files import AnyPath

# What belongs to the pixels, the file or the program that wrote it, and not to the scene and its camera.
OWN = {
    "acesImageContainerFlag", "adoptedNeutral", "chromaticities", "chunkCount", "colorInteropID",
    "compression", "dwaCompressionLevel", "envmap", "ICCProfile", "lookModTransform", "multiView", "name",
    "Orientation", "PixelAspectRatio", "planarconfig", "preview", "renderingTransform", "ResolutionUnit",
    "screenWindowCenter", "screenWindowWidth", "Software", "textureformat", "thumbnail_height",
    "thumbnail_image", "thumbnail_nchannels", "thumbnail_width", "type", "version", "view", "whiteLuminance",
    "wrapmodes", "XResolution", "YResolution",
    "Exif:ColorSpace", "Exif:Gamma", "Exif:ImageUniqueID", "Exif:InteroperabilityIndex", "Exif:MakerNote",
    "Exif:PixelXDimension", "Exif:PixelYDimension",
    # Whose the camera is, and which.
    "Exif:CameraOwnerName", "Exif:BodySerialNumber", "Exif:LensSerialNumber",
}  # fmt: skip
OWN_PREFIXES = ("oiio:", "openexr:", "relight:", "ICCProfile:", "GPS:", "nuke/node_hash", "nuke/version")
# What is kept of pictures other than OpenEXR files, whose headers hold much of their own.
CAMERA = (
    "Artist", "Copyright", "DateTime", "ExposureTime", "FNumber", "ImageDescription", "Keywords",
    "Make", "Model", "IPTC:Rating",
)  # fmt: skip
CAMERA_PREFIXES = ("Exif:", "smpte:")
TIMECODE = "smpte:TimeCode"
RATES = ("FramesPerSecond", "dpx:FrameRate", "dpx:TelevisionFrameRate")  # OpenEXR, DPX of film, of video
SLOWEST, FASTEST = 1, 1000  # frames a second that are believed


@dataclass(frozen=True)
class TypedValue:
    """A value of a header and OpenImageIO's name of its type, such as `timecode` or `matrix`."""

    kind: str
    value: Any


def read_metadata(path: AnyPath) -> dict[str, TypedValue]:
    """Read what a picture's header states of the scene and its camera: {name: value}.

    Timecode, frame rate, lens, exposure, camera matrices and whatever else an OpenEXR file holds; of other
    files Exif's camera, and DPX's timecode. Empty for AVIF, HEIC and camera raw, and where the header cannot
    be read. What is private is left out, see `relight.media.privacy`.
    """
    try:
        opened = _opened(path)
        if opened is None:
            return {}
        is_exr = opened.format_name() == "openexr"
        return {
            attribute.name: _typed(str(attribute.type), attribute.value)
            for attribute in opened.spec().extra_attribs
            if _is_kept(attribute.name, is_exr)
            and attribute.value is not None
            and not is_private(attribute.name, attribute.value)
        }
    except (OSError, UnicodeDecodeError):
        return {}


def _typed(kind: str, value: object) -> TypedValue:
    """Return a value with its type; OpenImageIO makes an array of one of a TIFF's sensitivity."""
    if kind.endswith("[1]") and isinstance(value, tuple) and len(value) == 1:
        return TypedValue(kind.removesuffix("[1]"), value[0])
    return TypedValue(kind, value)


def read_frame_rate(path: AnyPath) -> Fraction | None:
    """Read how many frames a second the header of a sequence's picture states; None where it states none."""
    try:
        opened = _opened(path)
    except OSError:
        return None
    if opened is None:
        return None
    for name in RATES:
        with suppress(ArithmeticError, TypeError, ValueError):  # text that is not UTF-8 is a ValueError
            stated = opened.spec().getattribute(name)
            is_ratio = isinstance(stated, tuple)
            rate = Fraction(*stated) if is_ratio else Fraction(stated).limit_denominator(1001)
            if SLOWEST <= rate <= FASTEST:
                return rate
    return None


def _opened(path: AnyPath) -> oiio.ImageInput | None:
    """Open a picture for its header; None for a phone's picture, and where OpenImageIO cannot open it."""
    path, _ = split_layer(path)
    opened = None if phone.reader(path) is not None else oiio.ImageInput.open(str(path))
    if opened is None:
        problem(oiio)  # clears the error, which would be reported later
    return opened


def _is_kept(name: str, is_exr: bool) -> bool:
    if name in OWN or name.startswith(OWN_PREFIXES):
        return False
    if is_exr and name == "Copyright":  # what OpenImageIO makes of OpenEXR's `owner`
        return False
    return is_exr or name in CAMERA or name.startswith(CAMERA_PREFIXES)
