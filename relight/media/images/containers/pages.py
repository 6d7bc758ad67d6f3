"""Files of several pictures: animations, pages, reduced copies, and the picture of a camera raw."""

import contextlib
import os
import warnings
from collections.abc import Iterator
from pathlib import Path

import OpenImageIO as oiio
from PIL import Image, TiffImagePlugin

from relight.media.buffers import problem
from relight.media.images.containers.headers import png_chunks

DNG_VERSION, SUB_DIRECTORIES, PHOTOMETRIC = 50706, 330, 262  # tags of TIFF
MOSAICS = (32803, 34892)  # photometric interpretations of camera raw: a colour filter array, linear raw
TIFF_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
REDUCED = 1  # bit of NewSubfileType: a copy of another page, with fewer pixels
SUBFILE_TYPE, OLD_REDUCED = 255, 2  # TIFF 5.0's tag of the same, and its value of such a copy
MOST_DIRECTORIES = 32  # beyond which a file is not searched
ANY_SIZE = "RELIGHT_ANY_SIZE"  # environment variable: its value 1 lifts the limits below
LARGEST = 2**29  # pixels of a picture
FREE_PIXELS = 2**25  # of a picture of any file: 8K
PIXELS_PER_BYTE = 1000  # of the file, beyond FREE_PIXELS
_most: int | None = None  # pixels that this process reads


def limit_pixels(most: int | None) -> None:
    """Let this process refuse pictures of more pixels, whatever RELIGHT_ANY_SIZE says; None lifts it."""
    global _most
    _most = most


def check_size(width: int, height: int, file_bytes: int) -> None:
    """Raise ValueError for a picture that is larger than its file can mean, or than memory should hold.

    A file of a few kilobytes may claim any size. The environment variable RELIGHT_ANY_SIZE=1 lifts the limit,
    but not that of `limit_pixels`.
    """
    pixels = width * height
    if _most is not None and pixels > _most:
        raise ValueError(
            f"has {width} x {height} pixels; expected {_most // 1_000_000} million at most, in pictures that "
            "are made of it too"
        )
    if pixels <= FREE_PIXELS or os.environ.get(ANY_SIZE) == "1":
        return
    if pixels > min(LARGEST, PIXELS_PER_BYTE * file_bytes):
        raise ValueError(
            f"is too large: {file_bytes} bytes claim {width} x {height} pixels; set the environment variable "
            f"{ANY_SIZE}=1 to read it all the same"
        )


def whole_page(file: oiio.ImageInput, path: Path) -> int:
    """Return the number of a TIFF's first page that is no reduced copy, of an ICO's largest; else 0.

    Warns of further pages of a TIFF, which are not read. ValueError where all pages are reduced copies.
    """
    if file.format_name() not in ("tiff", "ico"):
        return 0
    specs: list[oiio.ImageSpec] = []
    while len(specs) < MOST_DIRECTORIES and file.seek_subimage(len(specs), 0):
        specs.append(file.spec(len(specs), 0))
    problem(file)  # clears the error, which the next file would report
    if file.format_name() == "ico":
        return max(range(len(specs)), key=lambda page: specs[page].width)
    reduced = _reduced_in_old_files(path) if len(specs) > 1 else set()
    whole = [
        page
        for page, spec in enumerate(specs)
        if not spec.get_int_attribute("tiff:subfiletype") & REDUCED and page not in reduced
    ]
    if not whole:
        raise ValueError("holds nothing but a reduced copy of its picture; export the picture itself")
    if len(whole) > 1:
        warn(path, f"holds {len(whole)} pages; the first is read")
    return whole[0]


def _reduced_in_old_files(path: Path) -> set[int]:
    """Return the pages that TIFF 5.0's tag calls reduced, which OpenImageIO does not pass on."""
    pages = enumerate(_directories(path, with_sub_directories=False))
    return {number for number, page in pages if page.get(SUBFILE_TYPE) == OLD_REDUCED}


def warn_of_animation(path: Path, kind: str) -> None:
    """Warn if a PNG, WebP or GIF is animated: its first frame is read. `kind` is OpenImageIO's format."""
    if kind in ("gif", "png", "webp") and _is_animated(path, kind):
        warn_of_frames(path)


def warn_of_frames(path: Path) -> None:
    """Warn that the first frame of an animation is read."""
    warn(path, "is animated; its first frame is read, convert it to a movie for all of them")


def warn(path: Path, problem: str) -> None:
    """Warn of what is not read of a file."""
    warnings.warn(f"{path}: {problem}", stacklevel=2)


def _is_animated(path: Path, kind: str) -> bool:
    """Return whether a picture's header says that it is animated."""
    if kind == "png":
        return "acTL" in png_chunks(path)
    if kind == "webp":  # RIFF, size, WEBP, VP8X, size, flags
        with path.open("rb") as file:
            start = file.read(64)
        return start[12:16] == b"VP8X" and bool(start[20] & 2)
    try:
        with Image.open(path, formats=["GIF"]) as gif:
            return bool(getattr(gif, "is_animated", False))
    except Exception:  # of many classes: a damaged GIF is reported where it is read
        return False


def holds_raw(path: Path) -> bool:
    """Return whether a TIFF is a camera's raw file, whatever its name: DNG, or a page with a mosaic."""
    return any(DNG_VERSION in page or page.get(PHOTOMETRIC) in MOSAICS for page in _directories(path))


def _directories(
    path: Path, with_sub_directories: bool = True
) -> Iterator[TiffImagePlugin.ImageFileDirectory_v2]:
    """Yield the directories of a TIFF, and those below them; none in another file.

    The first damaged one is the end. Pillow's errors of many classes, and its warnings, are not passed on,
    for the damage is reported where the file is read.
    """
    with contextlib.suppress(Exception), path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        head = file.read(16)
        if head[:4] not in TIFF_MAGIC:
            return
        head = head if 43 in head[2:4] else head[:8]  # BigTIFF's is longer
        first = TiffImagePlugin.ImageFileDirectory_v2(head)
        waiting, done = [first.next], 0
        while waiting and done < MOST_DIRECTORIES:
            directory = TiffImagePlugin.ImageFileDirectory_v2(head)
            file.seek(waiting.pop(0))
            directory.load(file)
            done += 1
            yield directory
            below = directory.get(SUB_DIRECTORIES, ()) if with_sub_directories else ()
            waiting += [*(below if isinstance(below, tuple) else (below,)), *filter(None, [directory.next])]
