"""Turn a photograph of the app by quarter turns, as a new file beside it."""

import warnings
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps

from relight.media import images
from shadow.files import replacing

CODES = ("L", "RGB", "RGBA")  # modes of Pillow's that a PNG holds as they are
ROTATIONS = {1: Image.Transpose.ROTATE_270, 2: Image.Transpose.ROTATE_180, 3: Image.Transpose.ROTATE_90}
EXACT = 0.004  # of linear light, up to which a PNG of the same codes means the same


def turned(name: str, turns: int) -> str:
    """Write a photograph turned clockwise by `turns` quarters, 1 to 3; return the file's name.

    It is a PNG of the same codes with the same profile and Exif data where that means the same light, and
    an EXR otherwise.
    """
    pixels = np.rot90(images.read(name), -turns)
    png = f"{Path(name).stem}-turned.png"
    if _copy_codes(name, turns, png) and np.allclose(images.read(png), pixels, atol=EXACT):
        return png
    Path(png).unlink(missing_ok=True)
    exr = f"{Path(name).stem}-turned.exr"
    images.write(exr, np.ascontiguousarray(pixels), depth="float")
    return exr


def _copy_codes(name: str, turns: int, png: str) -> bool:
    """Write the codes of a photograph, turned, as a PNG; return whether Pillow could read them."""
    try:
        with warnings.catch_warnings(), Image.open(name) as picture:
            warnings.simplefilter("ignore")
            if picture.mode not in CODES:
                return False
            upright = ImageOps.exif_transpose(picture)
            about = {"icc_profile": picture.info.get("icc_profile"), "exif": upright.getexif()}
            with replacing(png) as beside, beside.open("wb") as file:
                upright.transpose(ROTATIONS[turns]).save(file, "PNG", compress_level=1, **about)
    except (OSError, SyntaxError, ValueError):
        return False
    return True
