"""The surroundings of a plate: what its camera sees, continued to where it doesn't look.

A plate shows a few tenths of what surrounds the person in it, all of that behind them. What lights their
front has to be guessed. The guess here is that left is like left, up like up, and the front like the back
(Khan et al. 2006, who mirror the picture); that highlights were brighter than the camera could record (Landis
2002); and that what is still missing comes from above, as much as makes the ground as bright as it is.
"""

import numpy as np
import OpenImageIO as oiio
import torch
import torch.nn.functional as F
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter

from relight.media.buffers import to_array, to_buffer
from relight.media.colour import luminance
from relight.media.images import scene_linear

OPAQUE = 0.999  # alpha that filters may leave of 1
ROWS = 1024  # of a map at most
GREY = 0.18  # reflectance of a grey card, and of what a photograph shows on average
HIGHLIGHTS = 8.0  # three stops
CLIPPING = 0.8  # of white, from where on a pixel is the brighter the closer it is to clipping
BLUR = 0.5  # of the plate's height: standard deviation, of what is continued far from it
FADE = 30.0  # degrees from the plate to where only the blurred is left
MINKOWSKI = 6  # norm of "shades of grey", the estimate of the light's colour (Finlayson and Trezzi 2004)


def opaque(background: ArrayLike) -> np.ndarray:
    """A background (H, W, 3|4) as its colours (H, W, 3), linear; ValueError where it is transparent."""
    pixels = scene_linear("background", background)
    if pixels[..., 3:].min(initial=1) < OPAQUE:
        raise ValueError("background: expected an opaque picture, got one with transparent pixels")
    return pixels[..., :3]


def surroundings(plate: np.ndarray, field_of_view: float, highlights: float) -> np.ndarray:
    """A latitude-longitude map (rows, 2 rows, 3) of which the plate (H, W, 3), linear, is what
    `EnvironmentLight.view` shows with the same vertical field of view in degrees.

    In the plate its light is as it is, but for highlights: `highlights` is how many times as bright as white
    those are that the camera clipped. Of a plate with values above 1 nothing is taken to be clipped.
    """
    half = np.tan(np.radians(field_of_view / 2))
    rows = int(np.clip(round(180 / field_of_view * len(plate)), 64, ROWS))
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

    near, far = (_at(image, across, down.clip(-1, 1)) for image in (plate, _blurred(plate)))
    fade = _smooth(outside / FADE)[..., None]
    light = near + (far - near) * fade
    light = light + _missing(plate, light, fade * _smooth(np.sin(elevation) / 0.5)[..., None])
    if plate.max() <= 1:
        # Only where they are seen: their images in the mirror are no lamps.
        light = np.where(outside[..., None] > 0, light, _expanded(light, highlights))
    return light.astype(np.float32)


def _missing(plate: np.ndarray, light: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Light (rows, 2 rows, 3) that comes from where the plate does not show, for what it shows of the ground
    to be as bright as it is.

    The ground is the lower half of the plate. A grey card that lies on it is as bright as it is on average.
    The light is spread as `light` is, times `share` (rows, 2 rows, 1), in the colour of the plate's light.
    """
    rows = len(light)
    elevation = np.radians(90 - (np.arange(rows)[:, None, None] + 0.5) * 180 / rows)
    cosine = np.sin(elevation).clip(0) * np.cos(elevation) * np.pi / rows**2  # over pi
    ground = np.median(luminance(plate[len(plate) // 2 :]))
    tint = (plate.clip(0).astype(np.float64) ** MINKOWSKI).mean(axis=(0, 1)) ** (1 / MINKOWSKI)
    wanted = ground / GREY * tint / max(luminance(tint), 1e-9)
    there = (light * cosine).sum(axis=(0, 1))
    shape = share * (luminance(light)[..., None].clip(0) + 1e-6)
    return shape / (shape * cosine).sum() * (wanted - there).clip(0)


def _expanded(light: np.ndarray, highlights: float) -> np.ndarray:
    """Light (H, W, 3) in which what a camera clipped, 1, is `highlights`, and what is nearly so less (Landis
    2002)."""
    part = ((luminance(light) - CLIPPING) / (1 - CLIPPING)).clip(0, 1)[..., None] ** 2
    return light * (1 + part * (highlights - 1))


def _at(image: np.ndarray, across: np.ndarray, down: np.ndarray) -> np.ndarray:
    """An image (rows, columns, 3) at positions in [-1, 1], across (columns,) and down (rows, columns)."""
    grid = np.float32(np.stack([np.broadcast_to(across, down.shape), down], axis=-1))
    source = torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))[None]
    found = F.grid_sample(source, torch.from_numpy(grid)[None], padding_mode="border", align_corners=False)
    return found[0].permute(1, 2, 0).numpy()


def _blurred(image: np.ndarray) -> np.ndarray:
    """What is left of an image (H, W, 3) far from it: (h, w, 3)."""
    small = _resized(image, min(len(image), 32))
    width = BLUR * len(small)
    return gaussian_filter(small, (width, width, 0), mode="nearest")


def _resized(image: np.ndarray, height: int) -> np.ndarray:
    """An image (H, W, 3), `height` pixels high, averaged."""
    if height == len(image):
        return image
    width = max(1, round(image.shape[1] * height / len(image)))
    region = oiio.ROI(0, width, 0, height, 0, 1, 0, 3)
    return to_array(oiio.ImageBufAlgo.resize(to_buffer(image), "box", roi=region)).reshape(height, width, 3)


def _smooth(step: np.ndarray) -> np.ndarray:
    """From 0 to 1 and level at both ends (smoothstep)."""
    step = np.clip(step, 0, 1)
    return step * step * (3 - 2 * step)
