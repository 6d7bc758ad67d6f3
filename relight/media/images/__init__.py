"""Images in and out through OpenImageIO: alpha, colour, layers, and files that are whole or not there.

Inside, an image is (H, W, 3) or (H, W, 4) float32: linear Rec.709, premultiplied. A file of integers is
sRGB-encoded with straight alpha, a file of floats scene-linear and premultiplied, unless it says otherwise.
"""

from relight.media.images.edge import coverage, scene_linear
from relight.media.images.maps import read_depth, read_mask, read_normals, write_mask
from relight.media.images.reading import read, read_identity, read_layers
from relight.media.images.writing import DEPTHS, HALF_MAX, Metadata, check_writable, half, write

__all__ = [
    "DEPTHS",
    "HALF_MAX",
    "Metadata",
    "check_writable",
    "coverage",
    "half",
    "read",
    "read_depth",
    "read_identity",
    "read_layers",
    "read_mask",
    "read_normals",
    "scene_linear",
    "write",
    "write_mask",
]
