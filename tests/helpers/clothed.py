"""An analysed person without networks."""

import numpy as np


def clothed(size=(200, 160), seed=0):
    """A linear plate (H, W, 3) of a textured figure, and its soft matte."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[: size[0], : size[1]]
    body = np.maximum(np.abs(x - 80) / 28, np.abs(y - 110) / 78)
    head = np.hypot(x - 80, y - 30) / 22
    matte = np.clip((1.05 - np.minimum(body, head)) * 12, 0, 1).astype(np.float32)
    shade = 0.2 + 0.5 * np.clip(1 - np.abs(x - 65) / 60, 0, 1)
    plate = shade[..., None] * (0.6, 0.4, 0.3) * random.uniform(0.8, 1.2, (*size, 1))
    return plate.astype(np.float32), matte
