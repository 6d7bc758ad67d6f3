"""Pictures over backgrounds and in frames of another size: pixels only."""

import operator
from collections.abc import Iterable
from typing import SupportsIndex

import numpy as np
import OpenImageIO as oiio
from numpy.typing import ArrayLike

from relight.lights.environment import EnvironmentLight
from relight.media.buffers import to_array, to_buffer
from relight.media.images import coverage, scene_linear

Background = ArrayLike | EnvironmentLight  # an image, a linear (r, g, b), or what a camera sees of a map
FARTHEST = 65536  # pixels: beyond any plate, within what an image can be


def over(foreground: ArrayLike, background: Background, shadow: np.ndarray | None = None) -> np.ndarray:
    """The foreground over a background: F + (1 - alpha) B (Porter and Duff 1984), in linear light.

    Parameters
    ----------
    foreground: (H, W, 4), integers sRGB with straight alpha, floats linear premultiplied.
    background: (h, w, 3|4) alike, of any size: scaled to cover the frame and cropped about its centre; its
        own alpha, if any, is over black. Or a linear (r, g, b). Or a relight.EnvironmentLight: what of it a
        camera sees behind the person (`EnvironmentLight.view`).
    shadow: (H, W, 3) by which the background is multiplied, such as `Subject.shadows` gives.

    Returns
    -------
    (H, W, 3) float32, linear Rec.709, unbounded.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, a foreground without alpha.
    """
    front = scene_linear("foreground", foreground)
    if front.shape[-1] != 4:
        raise ValueError(f"foreground: expected shape (H, W, 4), got {front.shape}")
    with np.errstate(over="ignore"):
        picture = front[..., :3] + behind(front, background, shadow)
    if not np.isfinite(picture).all():
        raise ValueError("background: is so bright that the picture is beyond float32")
    return picture


def behind(front: np.ndarray, background: Background, shadow: np.ndarray | None = None) -> np.ndarray:
    """What is seen of a background (H, W, 3) behind a premultiplied picture (H, W, 4); see `over`."""
    if isinstance(background, EnvironmentLight):
        back = background.view(front.shape[:2])
    elif np.ndim(background) == 1:
        colour = np.asarray(background)
        if colour.shape != (3,) or colour.dtype.kind not in "iuf":
            raise ValueError(f"background: expected an image or three finite numbers, got {background!r}")
        with np.errstate(over="ignore"):
            back = colour.astype(np.float32)
        if not np.isfinite(back).all():
            raise ValueError(f"background: expected an image or three finite numbers, got {background!r}")
    else:
        back = cover(scene_linear("background", background)[..., :3], front.shape[:2])
    seen = (1 - front[..., 3:]) * back
    return seen if shadow is None else seen * shadow


def place(
    image: ArrayLike,
    size: tuple[int, int],
    *,
    mode: str = "fit",
    scale: float = 1.0,
    offset: tuple[int, int] = (0, 0),
) -> np.ndarray:
    """An image in a frame of another size, such as a background's: before analysis, or after relighting.

    Parameters
    ----------
    image: (h, w, 3|4), integers sRGB with straight alpha, floats linear premultiplied; or a mask (h, w).
    size: (H, W) of the frame in pixels.
    mode: "fit", as large as the frame shows all of it; "fill", as large as leaves none of the frame empty;
        "centre", at its own size. Always about the centre of the frame.
    scale: > 0, on top of that.
    offset: (right, up) in whole pixels of the frame.

    Returns
    -------
    (H, W, 3|4) or (H, W) float32: zero where the image is not, cropped where it does not fit. At its own size
    its pixels are kept as they are.

    Raises
    ------
    TypeError, ValueError: as of `over`, an empty frame, an unknown mode, a scale or offset out of range.
    """
    flat = np.ndim(image) == 2
    pixels = coverage("image", image)[..., None] if flat else scene_linear("image", image)
    (rows, columns), (height, width) = pixels.shape[:2], _whole("size", size, 1)
    right, up = _whole("offset", offset, -FARTHEST)
    ratios = (height / rows, width / columns)
    if mode not in ("fit", "fill", "centre"):
        raise ValueError(f"mode: expected fit, fill or centre, got {mode!r}")
    if not 0 < scale < np.inf:
        raise ValueError(f"scale: expected a finite number > 0, got {scale!r}")
    scale *= {"fit": min(ratios), "fill": max(ratios), "centre": 1.0}[mode]
    shown = max(1, round(rows * scale)), max(1, round(columns * scale))
    if max(shown) > FARTHEST:
        raise ValueError(f"scale: makes the image {shown[1]} x {shown[0]} pixels; expected up to {FARTHEST}")
    pixels = _resized(pixels, shown)
    if flat or pixels.shape[-1] == 4:
        np.clip(pixels[..., -1], 0, 1, out=pixels[..., -1])  # the filter's rounding
    frame = np.zeros((height, width, pixels.shape[-1]), np.float32)
    top, left = (height - shown[0]) // 2 - up, (width - shown[1]) // 2 + right
    inside = frame[max(top, 0) : max(top + shown[0], 0), max(left, 0) : max(left + shown[1], 0)]
    inside[:] = pixels[max(-top, 0) :, max(-left, 0) :][: inside.shape[0], : inside.shape[1]]
    return frame[..., 0] if flat else frame


def _whole(name: str, values: Iterable[SupportsIndex], low: int) -> tuple[int, int]:
    """Two whole numbers from `low` to FARTHEST."""
    try:
        first, second = (operator.index(value) for value in values)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name}: expected two whole numbers, got {values!r}") from error
    if min(first, second) < low or max(first, second) > FARTHEST:
        raise ValueError(f"{name}: expected {low} to {FARTHEST} pixels, got {values!r}")
    return first, second


def cover(image: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """`image` (h, w, C) float32, scaled to cover `size` (H, W) and cropped about its centre: (H, W, C)."""
    (height, width), (rows, columns) = size, image.shape[:2]
    scale = max(height / rows, width / columns)
    shown = max(1, round(height / scale)), max(1, round(width / scale))
    top, left = (rows - shown[0]) // 2, (columns - shown[1]) // 2
    crop = np.ascontiguousarray(image[top : top + shown[0], left : left + shown[1]])
    return _resized(crop, size)


def _resized(image: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """`image` (h, w, C) float32 at `size` (H, W): itself if that is its size."""
    if image.shape[:2] == tuple(size):
        return image
    # Blackman-Harris has no negative lobes: a lamp in the background gets no dark ring.
    region = oiio.ROI(0, size[1], 0, size[0], 0, 1, 0, image.shape[2])
    resized = oiio.ImageBufAlgo.resize(to_buffer(image), "blackman-harris", roi=region)
    return to_array(resized).reshape(*size, image.shape[2])
