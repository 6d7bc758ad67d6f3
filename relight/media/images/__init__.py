"""Images in and out through OpenImageIO: alpha, colour, layers, and files that are whole or not there.

Inside, an image is (H, W, 3) or (H, W, 4) float32: linear Rec.709, premultiplied. A file of integers is
sRGB-encoded with straight alpha, a file of floats scene-linear and premultiplied, unless it says otherwise.
"""

from relight.media.images.arrays import coverage, person_mask, scene_linear, without_empty_alpha
from relight.media.images.codes import CODES_SUFFIX, read_codes, write_codes
from relight.media.images.containers.pages import limit_pixels
from relight.media.images.decode import holds_display_light, read_pixel_aspect
from relight.media.images.layers import split_layer
from relight.media.images.maps import check_matte, read_depth, read_mask, read_normals, write_mask
from relight.media.images.metadata import TIMECODE, TypedValue, read_frame_rate, read_metadata
from relight.media.images.read_image import read, read_camera, read_content_hash, read_layers, read_size
from relight.media.images.write_image import (
    DEPTHS,
    HALF_MAX,
    OPAQUE_SUFFIXES,
    Metadata,
    check_writable,
    composited,
    half,
    write,
)
