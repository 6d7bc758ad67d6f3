"""The surroundings of a plate as a latitude-longitude map: what its camera sees, continued all around.

A plate shows a few tenths of what surrounds the person, all of it behind them. The light on their front has
to be assumed. Left is like left, up like up, and the front like the back (Khan et al. 2006, who mirror the
picture). Highlights were brighter than the camera could record (Landis 2002). What is still missing comes
from above, as much as makes the ground as bright as it is.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from relight.media.colour import luminance
from relight.media.images import scene_linear
from relight.media.resampling import resize, sample

MIN_ALPHA = 0.999  # that filters may leave of 1
MAX_ROWS = 1024  # of a map
FEW_ROWS = 96  # of a background whose light is estimated quickly
GREY_REFLECTANCE = 0.18  # of a grey card, and of what a photograph shows on average
HIGHLIGHTS = 8.0  # brightness of clipped pixels, in units of white: three stops
CLIPPING_START = 0.8  # of white, above which pixels are expanded toward the highlights
BLUR_SHARE = 0.5  # of the plate's height: standard deviation, of what is continued far from it
FADE_DEGREES = 30.0  # from the plate to where only the blurred picture is left
MINKOWSKI_NORM = 6  # of "shades of grey", the estimate of the light's colour (Finlayson and Trezzi 2004)


def opaque(background: ArrayLike) -> np.ndarray:
    """Return a background as (H, W, 3), linear Rec.709; raises ValueError if it is transparent."""
    pixels = scene_linear("background", background)
    if pixels[..., 3:].min(initial=1) < MIN_ALPHA:
        raise ValueError("background: expected an opaque picture, got one with transparent pixels")
    return pixels[..., :3]


def whole_field_of_view(background: Sequence[int], size: Sequence[int], field_of_view: float) -> float:
    """Return the vertical field of view, in degrees, of a background that covers a picture.

    `background`, `size`: (H, W, ...) of both; `field_of_view`: the picture's. The cropped parts of a
    background, beside the picture or above and below, light the person too.
    """
    cut = max(1.0, size[1] / size[0] * background[0] / background[1])
    return min(float(np.degrees(2 * np.arctan(cut * np.tan(np.radians(field_of_view / 2))))), 170.0)


def few_rows(background: np.ndarray) -> np.ndarray:
    """Return a background (H, W, 3) with rows enough to estimate its light, where that must be quick."""
    return background if len(background) <= FEW_ROWS else _resized(background, FEW_ROWS)


def surroundings(plate: np.ndarray, field_of_view: float, highlights: float) -> np.ndarray:
    """Continue a plate (H, W, 3) to a map (rows, 2 rows, 3) of its surroundings, both linear Rec.709.

    `field_of_view`: vertical, degrees: `EnvironmentLight.view` shows the plate again with it. `highlights`:
    brightness, in units of white, of pixels that the camera clipped. It has no effect on a plate with values
    above 1.
    """
    half = np.tan(np.radians(field_of_view / 2))
    rows = int(np.clip(round(180 / field_of_view * len(plate)), 64, MAX_ROWS))
    plate = _resized(plate, max(1, min(len(plate), round(field_of_view / 180 * rows))))
    aspect = plate.shape[1] / plate.shape[0]

    # Where a direction lies in the plate: across and down in [-1, 1]; beyond its edges what is like it there.
    elevation = np.radians(90 - (np.arange(rows)[:, None] + 0.5) * 180 / rows)
    around = np.radians((np.arange(2 * rows) + 0.5) * 180 / rows)  # from straight behind toward image right
    around = np.where(around > np.pi, around - 2 * np.pi, around)
    edge = np.arctan(half * aspect)
    turn = abs(around)
    folded = np.where(turn > edge, edge * (np.pi - turn) / (np.pi - edge), turn) * np.sign(around)
    across = np.tan(folded) / (half * aspect)
    down = -np.tan(elevation) / np.cos(folded) / half
    beyond = np.maximum(abs(elevation) - np.arctan(half * np.cos(folded)), 0)  # its upper or lower edge
    outside = np.degrees(np.hypot(beyond, np.maximum(turn - edge, 0) * np.cos(elevation)))

    near, far = (sample(image, across, down.clip(-1, 1)) for image in (plate, _blurred(plate)))
    fade = _smooth(outside / FADE_DEGREES)[..., None]
    light = near + (far - near) * fade
    light = light + _missing(plate, light, fade * _smooth(np.sin(elevation) / 0.5)[..., None])
    if plate.max() <= 1:
        # Only where they are seen: their images in the mirror are no lamps.
        light = np.where(outside[..., None] > 0, light, _expanded(light, highlights))
    return light.astype(np.float32)


def _missing(plate: np.ndarray, light: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return the light (rows, 2 rows, 3) from beyond the plate that makes its ground as bright as it is.

    The ground is the lower half of the plate. A grey card that lies on it has its average brightness. The
    light is distributed as `light` is, times `share` (rows, 2 rows, 1), in the colour of the plate's light.
    """
    rows = len(light)
    elevation = np.radians(90 - (np.arange(rows)[:, None, None] + 0.5) * 180 / rows)
    cosine = np.sin(elevation).clip(0) * np.cos(elevation) * np.pi / rows**2  # over pi
    ground = np.median(luminance(plate[len(plate) // 2 :]))
    tint = (plate.clip(0).astype(np.float64) ** MINKOWSKI_NORM).mean(axis=(0, 1)) ** (1 / MINKOWSKI_NORM)
    wanted = ground / GREY_REFLECTANCE * tint / max(luminance(tint), 1e-9)
    there = (light * cosine).sum(axis=(0, 1))
    shape = share * (luminance(light)[..., None].clip(0) + 1e-6)
    return shape / (shape * cosine).sum() * (wanted - there).clip(0)


def _expanded(light: np.ndarray, highlights: float) -> np.ndarray:
    """Expand clipped light (H, W, 3), 1, to `highlights`, and nearby values less (Landis 2002)."""
    part = ((luminance(light) - CLIPPING_START) / (1 - CLIPPING_START)).clip(0, 1)[..., None] ** 2
    return light * (1 + part * (highlights - 1))


def _blurred(image: np.ndarray) -> np.ndarray:
    """Return the blurred, small image (h, w, 3) that continues an image (H, W, 3) far from it."""
    small = _resized(image, min(len(image), 32))
    width = BLUR_SHARE * len(small)
    from scipy.ndimage import gaussian_filter

    return gaussian_filter(small, (width, width, 0), mode="nearest")


def _resized(image: np.ndarray, height: int) -> np.ndarray:
    """Average an image (H, W, 3) to `height` pixels of height."""
    width = max(1, round(image.shape[1] * height / len(image)))
    return image if height == len(image) else resize(image, (height, width), "box")


def _smooth(step: np.ndarray) -> np.ndarray:
    """Return a step from 0 to 1 that is level at both ends (smoothstep)."""
    step = np.clip(step, 0, 1)
    return step * step * (3 - 2 * step)
