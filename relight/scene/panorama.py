"""Latitude-longitude maps turned about any axis."""

import numpy as np
import torch
import torch.nn.functional as F

from relight.media.cubemap import latlong_directions


def turned(pixels: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Turn a latitude-longitude map (H, 2 H, 3) float32 in OpenEXR's convention, with bilinear samples.

    `axes`: (3, 3) orthogonal: where the map's x, y and z point afterwards, one a column. A reflection is
    allowed.
    """
    height, width = pixels.shape[:2]
    # The transpose takes directions back to the map.
    x, y, z = np.moveaxis(latlong_directions(height) @ axes, -1, 0)
    column = (np.pi - np.arctan2(x, z)) / (2 * np.pi) * width
    row = (np.pi / 2 - np.arcsin(y.clip(-1, 1))) / np.pi * height
    padded = np.concatenate([pixels[:, -1:], pixels, pixels[:, :1]], axis=1)
    grid = np.stack([(column + 1) / (width + 2), row / height], axis=-1) * 2 - 1
    source = torch.from_numpy(np.ascontiguousarray(padded, np.float32)).permute(2, 0, 1)
    seen = F.grid_sample(
        source[None], torch.from_numpy(np.float32(grid))[None], padding_mode="border", align_corners=False
    )
    return seen[0].permute(1, 2, 0).numpy()
