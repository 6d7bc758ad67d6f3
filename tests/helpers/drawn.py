"""People of the light stage before photographs, and outlines as a hand draws them."""

import numpy as np
from PIL import Image
from scipy.ndimage import zoom

from shadow.data import photographs


def photographed(record, background, seed, height=640):
    """A person of the light stage before a photograph, sRGB codes (H, W, 3), and their matte (H, W)."""
    random = np.random.default_rng(seed)
    weights = random.gamma(0.3, size=(len(record.directions), 1)) * np.ones((1, 3))
    lit = record.image(photographs.light(record, weights.astype(np.float32))).permute(1, 2, 0).numpy()
    mask = np.asarray(record.mask)
    person = np.clip(lit * (0.25 / lit[mask].mean()), 0, 1)
    behind = (np.asarray(Image.fromarray(background).resize(mask.shape[::-1]), np.float32) / 255) ** 2.2
    light = np.where(mask[..., None], person, behind)
    times = height / mask.shape[0]
    # A lens mixes light, not codes.
    light, matte = zoom(light, (times, times, 1), order=1), zoom(mask.astype(np.float32), times, order=1)
    return np.round(light.clip(0, 1) ** (1 / 2.2) * 255).astype(np.uint8), matte


def polygon(matte, seed, corners=24, off=0.015):
    """About so many corners along a matte's outline, off by up to a share of its height: (N, 2), x and y."""
    from skimage.measure import approximate_polygon, find_contours

    inside = np.pad(matte > 0.5, 2)
    outline = max(find_contours(inside.astype(float), 0.5), key=len)[:, ::-1] - 1.5
    height = np.ptp(np.nonzero(inside)[0])
    low, high = 0.0, float(height)
    for _ in range(24):
        middle = (low + high) / 2
        if len(approximate_polygon(outline, middle)) - 1 > corners:
            low = middle
        else:
            high = middle
    found = approximate_polygon(outline, high)[:-1]
    random = np.random.default_rng(seed)
    turns, lengths = random.uniform(0, 2 * np.pi, len(found)), off * height * random.uniform(0, 1, len(found))
    return found + np.stack([np.cos(turns), np.sin(turns)], axis=-1) * lengths[:, None]


def overlap(found, truth):
    """Intersection over union of two mattes."""
    a, b = found > 0.5, truth > 0.5
    return (a & b).sum() / (a | b).sum()
