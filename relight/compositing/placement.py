"""Scale, crop and shift an image into a frame of another size."""

import operator
from collections.abc import Iterable
from typing import Annotated, SupportsIndex

import numpy as np
from annotated_types import Gt
from numpy.typing import ArrayLike

from relight.arguments import checks_arguments, shown
from relight.media.images import coverage, scene_linear
from relight.media.images.arrays import as_array
from relight.media.resampling import resize
from shadow.torch_settings import isolated

MAX_PIXELS = 65536  # along a side: beyond any plate, within what an image file can hold


@isolated
@checks_arguments
def place(
    image: ArrayLike,
    size: tuple[int, int],
    *,
    mode: str = "fit",
    scale: Annotated[float, Gt(0)] = 1.0,
    offset: tuple[int, int] = (0, 0),
) -> np.ndarray:
    """Place an image in a frame of another size, such as a background's: before analysis, or after
    relighting.

    Parameters
    ----------
    image
        (h, w, 3|4). Integers are sRGB-encoded with straight alpha; floats linear Rec.709, premultiplied. Or a
        mask (h, w).
    size
        (H, W) of the frame, pixels.
    mode
        "fit" shows the whole image as large as the frame allows; "fill" leaves no part of the frame empty;
        "centre" keeps the size of the image. The image is always centred in the frame.
    scale
        A further factor, above 0.
    offset
        (right, up), whole pixels of the frame.

    Returns
    -------
    np.ndarray
        (H, W, 3|4) or (H, W) float32, linear Rec.709, premultiplied: zero beside the image, cropped where it
        does not fit. At its own size its pixels are unchanged.

    Raises
    ------
    TypeError, ValueError
        What `relight.over` refuses, an empty frame, an unknown mode, a scale or offset out of range.

    Examples
    --------
    >>> import numpy as np, relight
    >>> relight.place(np.ones((4, 2), np.float32), (4, 6)).sum(axis=0).tolist()
    [0.0, 0.0, 4.0, 4.0, 0.0, 0.0]
    """
    flat = as_array("image", image).ndim == 2
    pixels = coverage("image", image)[..., None] if flat else scene_linear("image", image)
    (rows, columns), (height, width) = pixels.shape[:2], _whole_numbers("size", size, 1)
    right, up = _whole_numbers("offset", offset, -MAX_PIXELS)
    ratios = (height / rows, width / columns)
    if mode not in ("fit", "fill", "centre"):
        raise ValueError(f"mode: expected fit, fill or centre, got {mode!r}")
    if not 0 < scale < np.inf:
        raise ValueError(f"scale: expected a finite number > 0, got {scale!r}")
    scale *= {"fit": min(ratios), "fill": max(ratios), "centre": 1.0}[mode]
    placed = max(1, round(rows * scale)), max(1, round(columns * scale))
    if max(placed) > MAX_PIXELS:
        raise ValueError(
            f"scale: makes the image {placed[1]} x {placed[0]} pixels; expected up to {MAX_PIXELS}"
        )
    pixels = resize(pixels, placed)
    if flat or pixels.shape[-1] == 4:
        alpha = pixels[..., -1:].clip(0, 1)  # the filter's rounding
        pixels = np.concatenate([pixels[..., :-1], alpha], axis=-1)
    frame = np.zeros((height, width, pixels.shape[-1]), np.float32)
    top, left = (height - placed[0]) // 2 - up, (width - placed[1]) // 2 + right
    inside = frame[max(top, 0) : max(top + placed[0], 0), max(left, 0) : max(left + placed[1], 0)]
    inside[:] = pixels[max(-top, 0) :, max(-left, 0) :][: inside.shape[0], : inside.shape[1]]
    return frame[..., 0] if flat else frame


def _whole_numbers(name: str, values: Iterable[SupportsIndex], low: int) -> tuple[int, int]:
    """Return two whole numbers in [low, MAX_PIXELS]."""
    try:
        first, second = (operator.index(value) for value in values)
    except (RuntimeError, TypeError, ValueError) as error:
        raise TypeError(f"{name}: expected two whole numbers, got {shown(values)}") from error
    if min(first, second) < low or max(first, second) > MAX_PIXELS:
        raise ValueError(f"{name}: expected {low} to {MAX_PIXELS} pixels, got {values!r}")
    return first, second


def cover(image: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """Scale an image (h, w, C) float32 to cover `size` (H, W), and crop it about its centre: (H, W, C)."""
    (height, width), (rows, columns) = size, image.shape[:2]
    scale = max(height / rows, width / columns)
    shown = max(1, round(height / scale)), max(1, round(width / scale))
    top, left = (rows - shown[0]) // 2, (columns - shown[1]) // 2
    crop = np.ascontiguousarray(image[top : top + shown[0], left : left + shown[1]])
    return resize(crop, size)
