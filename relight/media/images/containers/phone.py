"""What phones and cameras write and OpenImageIO does not read: AVIF, HEIC and camera raw."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image

from relight.media import colour
from relight.media.encodings import Encoding, decode_srgb
from relight.media.icc import Profile
from relight.media.images.containers import headers, isobmff, pages
from relight.media.images.layers import StoredPicture
from relight.media.pixel_aspect import upright
from shadow.installing import install_command

HEIF = (".heic", ".heif", ".hif")
AVIF = (".avif",)
RAW = (
    *(".3fr", ".arw", ".cr2", ".cr3", ".crw", ".dcr", ".dng", ".erf", ".fff", ".gpr", ".iiq", ".k25"),
    *(".kdc", ".mef", ".mos", ".mrw", ".nef", ".nrw", ".orf", ".pef", ".raf", ".raw", ".rw2", ".rwl"),
    *(".sr2", ".srf", ".srw", ".x3f"),
)
AVIF_BRANDS = {b"avif", b"avis"}
HEIF_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"}
BRANDS = 256  # bytes at a file's start that hold its brands (ISO/IEC 14496-12)
NAMED_WRONGLY = (b"\xff\xd8\xff", b"\x89PNG", b"RIFF")  # JPEG, PNG, WebP, which phones also name .heic
UNSPECIFIED = 2  # of H.273's code points
NAMES = {1: ("Y",), 2: ("Y", "A"), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}


def reader(path: Path) -> Callable[[Path], StoredPicture] | None:
    """Return what reads a file of this name here, or None for OpenImageIO.

    The brand of an ISO file counts before its name. The reader raises ImportError without the extra,
    ValueError for a damaged file.
    """
    suffix = path.suffix.lower()
    if suffix in RAW:
        return _read_raw
    with path.open("rb") as file:
        start = file.read(BRANDS)
    if start[4:8] == b"ftyp":
        brands = {start[at : at + 4] for at in range(8, min(len(start), int.from_bytes(start[:4])), 4)}
        if brands & AVIF_BRANDS:
            return _read_avif
        if brands & HEIF_BRANDS:
            return _read_heif
    if start.startswith(NAMED_WRONGLY):
        return None
    if pages.holds_raw(path):
        return _read_raw
    return _read_heif if suffix in HEIF else _read_avif if suffix in AVIF else None


def _read_heif(path: Path) -> StoredPicture:
    """Read HEIC by libheif, which turns it upright itself; 10 and 12 bits become 16."""
    try:
        import pillow_heif
    except ImportError as error:
        raise _missing(path, "pillow-heif") from error
    from relight.media.video_frames import UNDECODED

    try:
        file = pillow_heif.open_heif(str(path), convert_hdr_to_8bit=False)
        if len(file) > 1:  # such as those of a burst
            pages.warn(path, f"holds {len(file)} pictures; the main one is read")
        width, height = file.size
        pages.check_size(width, height, path.stat().st_size)
        pixels = np.asarray(file)
    except (RuntimeError, OSError, EOFError, LookupError, SyntaxError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: cannot be read as HEIC: {_line(error)}") from error
    depth = int(file.info.get("bit_depth", 8))
    if pixels.dtype == np.uint16:  # libheif shifts codes up: white would be less than full
        codes = pixels >> (16 - depth)
        pixels = np.rint(codes * (65535 / (2**depth - 1))).astype(np.uint16)
    numbers = file.info.get("nclx_profile")
    points = numbers and (numbers["color_primaries"], numbers["transfer_characteristics"])
    if numbers and numbers["matrix_coefficients"] in UNDECODED:
        raise ValueError(f"{path}: is in {UNDECODED[numbers['matrix_coefficients']]}, which is not decoded")
    space = _stated_space(file.info.get("icc_profile"), points, _exif(file.info.get("exif")))
    straight = not getattr(file, "premultiplied_alpha", False)
    return _stored(pixels, space, straight=straight)


def _read_avif(path: Path) -> StoredPicture:
    """Read AVIF by Pillow, 8 bits a channel; the colours of an opaque one of more bits by FFmpeg."""
    try:
        with Image.open(path, formats=["AVIF"]) as file:
            profile, exif = file.info.get("icc_profile"), file.getexif()
            if getattr(file, "is_animated", False):
                pages.warn_of_frames(path)
            pages.check_size(*file.size, path.stat().st_size)
            pixels = np.asarray(file)
    except Exception as error:  # the decoder's own errors have classes below Exception alone
        raise ValueError(f"{path}: cannot be read as AVIF: {_line(error)}") from error
    with path.open("rb") as file:
        start = file.read(isobmff.HEADER)
    points = isobmff.read_code_points(start)
    shown = isobmff.read_clean_aperture(start, *pixels.shape[:2])
    deep, coded = _decoded_by_ffmpeg(path)
    opaque = pixels.ndim == 2 or pixels.shape[2] == 3
    if deep is not None and opaque and pixels.shape[:2] == deep.shape[:2]:
        pixels = deep
    pixels = pixels[shown]
    pixels = upright(
        pixels[..., None] if pixels.ndim == 2 else pixels, exif.get(ExifTags.Base.Orientation, 1)
    )
    return _stored(pixels, _stated_space(profile, points or coded, exif), straight=True)


def _decoded_by_ffmpeg(path: Path) -> tuple[np.ndarray | None, tuple[int, int] | None]:
    """Return the colours (H, W, 3) uint16 of an AVIF of more than 8 bits, and its stream's code points.

    None for what FFmpeg does not decode, or decodes in 8 bits.
    """
    import av

    from relight.media.video_frames import read_codes

    try:
        with av.open(str(path)) as file:
            frame = next(file.decode(video=0))
            points = (int(frame.color_primaries), int(frame.color_trc))
            bits = max(component.bits for component in frame.format.components)
            codes = read_codes(frame, "libdav1d")[..., :3] if bits > 8 else None
    except (av.error.FFmpegError, IndexError, StopIteration, ValueError):
        return None, None
    return codes, points


def _exif(data: bytes | None) -> Image.Exif:
    """Parse Exif data, none where it is damaged."""
    exif = Image.Exif()
    try:
        exif.load(data or b"")
    except Exception:  # of many classes, and a picture without Exif is one all the same
        return Image.Exif()
    return exif


def _stated_space(profile: bytes | None, points: tuple[int, int] | None, exif: Image.Exif) -> colour.Space:
    """Return the colour space that a file states: by a profile, by H.273's code points, or by Exif."""
    if profile:
        return Profile.parse(profile)
    if points is not None and points != (UNSPECIFIED, UNSPECIFIED):
        return Encoding.from_code_points(*points, unspecified=decode_srgb)
    try:
        return headers.encoding_of_exif(exif) or colour.SRGB
    except Exception:  # as above
        return colour.SRGB


def _read_raw(path: Path) -> StoredPicture:
    """Read camera raw by LibRaw: the camera's white balance, no brightening, linear Rec.709, upright."""
    try:
        import rawpy
    except ImportError as error:
        raise _missing(path, "rawpy") from error
    try:
        with rawpy.imread(str(path)) as file:
            pages.check_size(file.sizes.raw_width, file.sizes.raw_height, path.stat().st_size)
            developed = file.postprocess(
                gamma=(1, 1), no_auto_bright=True, use_camera_wb=True, output_bps=16,
                output_color=rawpy.ColorSpace.sRGB,
                adjust_maximum_thr=0,  # white is the sensor's, not the brightest pixel of this frame
            )  # fmt: skip
    except rawpy.LibRawError as error:
        words = error.args[0] if error.args else error
        text = words.decode(errors="replace") if isinstance(words, bytes) else words
        raise ValueError(f"{path}: cannot be read as camera raw: {text}") from error
    return _stored(developed.astype(np.float32) / 65535, colour.LINEAR, straight=False)


def _stored(pixels: np.ndarray, space: colour.Space, *, straight: bool) -> StoredPicture:
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    return StoredPicture(pixels, NAMES[pixels.shape[-1]], space, straight=straight)


def _line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0]


def _missing(path: Path, package: str) -> ImportError:
    return ImportError(f"{path}: needs {package}; install it with: {install_command('phone')}")
