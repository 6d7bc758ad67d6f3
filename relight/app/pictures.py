"""Pictures as the page shows them: reduced, and compressed."""

import numpy as np
import torch

from relight.media.images.encode import compressed

PIXELS = 100_000_000  # of a photograph, at most


def resized(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return an image (h, w, C), float32, in another size (H, W), by a triangle filter."""
    planes = torch.from_numpy(image).permute(2, 0, 1)[None]
    smaller = torch.nn.functional.interpolate(planes, size, mode="bilinear", antialias=True)
    return smaller[0].permute(1, 2, 0).contiguous().numpy()


def png(shown: np.ndarray) -> bytes:
    """Return an encoded picture as a PNG."""
    return compressed(shown, "PNG", compress_level=1)
