"""Pictures as the page shows them: checked before they are read, reduced, encoded."""

import warnings
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import torch
from PIL import Image

from relight.media.colour import encode
from relight.media.images.saving import compressed

PIXELS = 100_000_000  # of a photograph, at most


def reduced_size(height: int, width: int, side: int) -> tuple[int, int]:
    """Return the size (H, W) of a picture whose longer side is reduced to `side` pixels, if it is longer."""
    shrink = min(1.0, side / max(height, width))
    return max(1, round(height * shrink)), max(1, round(width * shrink))


def resized(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return an image (h, w, C), float32, in another size (H, W), by a triangle filter."""
    planes = torch.from_numpy(image).permute(2, 0, 1)[None]
    smaller = torch.nn.functional.interpolate(planes, size, mode="bilinear", antialias=True)
    return smaller[0].permute(1, 2, 0).contiguous().numpy()


def check_size(path: Path) -> None:
    """Raise ValueError for a picture of more pixels than may be decoded, as far as its header says."""
    size = None
    file = oiio.ImageInput.open(str(path))
    if file is not None:
        spec = file.spec()
        size = (max(spec.width, spec.full_width), max(spec.height, spec.full_height))
        file.close()
    oiio.geterror()
    if size is None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                with Image.open(path) as picture:
                    size = picture.size
            except (OSError, ValueError, Image.DecompressionBombError):
                return  # `relight.read` says what is wrong
    if size[0] * size[1] > PIXELS:
        raise ValueError(
            f"{path}: has {size[0]} x {size[1]} pixels; expected {PIXELS // 1_000_000} million at most"
        )


def encoded(pixels: np.ndarray, exposure: float = 0.0) -> np.ndarray:
    """Encode linear, premultiplied (H, W, 3|4) for a display, with straight alpha."""
    if pixels.shape[-1] == 3:
        return encode(pixels.clip(0), exposure=exposure)
    alpha = pixels[..., 3:].clip(0, 1)
    colour = encode((pixels[..., :3] / np.maximum(alpha, 1e-4)).clip(0), exposure=exposure)
    return np.concatenate([colour, alpha], axis=-1)


def png(shown: np.ndarray) -> bytes:
    """Return an encoded picture as a PNG."""
    return compressed(shown, "PNG", compress_level=1)
