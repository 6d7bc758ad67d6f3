"""Code values on disk, as they are: the frames of a movie until it is complete."""

from pathlib import Path

import numpy as np

from relight.media.images.decode import load
from relight.media.images.encode import save
from relight.media.images.write_image import Metadata, new_spec

CODES_SUFFIX = ".tif"


def write_codes(path: Path, codes: np.ndarray, metadata: Metadata | None = None) -> None:
    """Write code values (H, W, 3|4) uint16 to a TIFF, with nothing made of them, alpha straight.

    LZW compresses it in a fifth of the time of the usual kind. Raises OSError as `write` does.
    """
    spec = new_spec(codes.shape[:2], "uint16", list("RGBA"[: codes.shape[2]]), metadata)
    spec.attribute("compression", "lzw")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    save(path, codes, spec)


def read_codes(path: Path) -> np.ndarray:
    """Read what `write_codes` has written: (H, W, 3|4) uint16; raises as `read` does."""
    return load(path, space="sRGB").pixels
