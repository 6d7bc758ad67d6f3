"""Photo spheres that are parts of a sphere, as phones and stitchers write them.

Google's Photo Sphere XMP Metadata, `GPano`, state the size of the whole sphere, and where in it a picture
lies.
"""

import mmap
import re
import warnings
from pathlib import Path

import numpy as np

from relight.media.images.containers.pages import check_size

FIELDS = (
    "FullPanoWidthPixels", "FullPanoHeightPixels", "CroppedAreaImageWidthPixels",
    "CroppedAreaImageHeightPixels", "CroppedAreaLeftPixels", "CroppedAreaTopPixels",
)  # fmt: skip
# Of XMP an attribute or an element: Name="1" or <Name>1</Name>.
STATED = re.compile(rb"GPano:(\w+)\s*(?:=\s*[\"']|>)\s*([\w.+-]{1,40})")
EQUIRECTANGULAR = "equirectangular"


def statements(path: Path) -> dict[str, str]:
    """Return what a picture's file states of its sphere: {name: value} of `GPano`, empty without it."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if content.find(b"GPano:") < 0:
            return {}
        return {name.decode(): value.decode() for name, value in STATED.findall(content)}


def whole_sphere(path: Path, pixels: np.ndarray) -> np.ndarray:
    """Return the map of a whole sphere (H, 2 H, C): a picture where its file says, and dark around it.

    `pixels`, (H, W, C), perhaps of another size than the file states of itself, are returned themselves where
    the file states no part of a sphere. Raises ValueError, which names the file, for a part that does not lie
    in its sphere, a sphere that is not twice as wide as high or has another projection, or one too large.
    Warns that the rest of the sphere is dark.
    """
    stated = statements(path)
    projection = stated.get("ProjectionType", EQUIRECTANGULAR)
    if projection.lower() != EQUIRECTANGULAR:
        raise ValueError(f"{path}: has the projection {projection}; expected an equirectangular one")
    if not all(name in stated for name in FIELDS):
        return pixels
    try:
        full_width, full_height, width, height, left, top = (int(float(stated[name])) for name in FIELDS)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{path}: says of its sphere what is no number of pixels: {error}") from error
    if (left, top, width, height) == (0, 0, full_width, full_height):
        return pixels
    inside = 0 <= left <= left + width <= full_width and 0 <= top <= top + height <= full_height
    if min(width, height) < 1 or not inside or full_width != 2 * full_height:
        raise ValueError(
            f"{path}: is said to be a part of {width} x {height} pixels at {left}, {top} of a sphere of "
            f"{full_width} x {full_height}; expected one inside, of a sphere twice as wide as high"
        )
    rows, columns = pixels.shape[:2]
    scale = rows / height, columns / width  # it may have been reduced after it was stitched
    whole = round(full_height * scale[0])
    try:
        check_size(2 * whole, whole, path.stat().st_size)
    except ValueError as error:
        raise ValueError(f"{path}: its sphere {error}") from error
    if abs(scale[1] / scale[0] - 1) > 2 / min(rows, columns):
        raise ValueError(
            f"{path}: has {columns} x {rows} pixels, which is another shape than the {width} x {height} that "
            "it is said to have in its sphere"
        )
    first, begin = min(round(top * scale[0]), whole - 1), min(round(left * scale[1]), 2 * whole - 1)
    sphere = np.zeros((whole, 2 * whole, pixels.shape[2]), pixels.dtype)
    part = pixels[: whole - first, : 2 * whole - begin]
    sphere[first : first + part.shape[0], begin : begin + part.shape[1]] = part
    share = height * width / (full_height * full_width)
    warnings.warn(f"{path}: is {share:.0%} of its sphere; the rest is dark", stacklevel=2)
    return sphere
