"""How light a person's albedo is in all, which their pixels alone do not say.

The network sees the person at a fixed mean brightness, so that a white shirt that fills the picture comes out
grey, and somebody dark in dark clothes too light. What a photograph says of it beside that is its own
exposure. Cameras expose so that a white surface in the brightest light is white: the light on the person, the
photograph over the albedo, is then about one. Bounds are what no surface exceeds, and the range of human
skin where a face is known, never its mean.
"""

import math

import numpy as np
import torch

from relight.media.colour import luminance

BRIGHT_QUANTILE = 0.8  # of the light on the person: that of the key
TRUST = 0.7  # exponent of that light: it may well be brighter or darker than white is
LIMITS = (0.5, 2.0)  # of the factor
WHITE = 0.7  # linear: a photograph that shows this is not too dark
CLIPPED = 1.02  # linear: a picture with brighter values has an exposure of its own
LIGHTEST = 0.9  # of the albedo of any surface
STEP = 4  # of a canvas, one pixel in so many is looked at, each way
ROWS = 200  # of a plate that are looked at
SKIN = (0.04, 0.45)  # of the green albedo of faces


def exposure_of(plate: np.ndarray) -> tuple[float, float]:
    """Return the largest value of a plate (H, W, 3|4), linear, and the luminance that 5 % of it exceed.

    One that is cut out shows no surroundings, and has the exposure that it was given: its largest value is
    infinite.
    """
    few = plate[:: max(1, len(plate) // ROWS), :: max(1, plate.shape[1] // ROWS)]
    if few.shape[-1] == 4 and few[..., 3].min() < 1:
        return math.inf, 0.0
    return float(few[..., :3].max()), float(np.quantile(luminance(few[..., :3]), 0.95))


def factor(
    light: torch.Tensor,
    albedo: torch.Tensor,
    known: torch.Tensor,
    brightest: float,
    white: float,
    face: torch.Tensor | None = None,
) -> float:
    """Return the factor of an albedo (3, h, w) that makes it as light as the surfaces are.

    `light` (3, h, w): the photograph over the albedo, linear, where white is 1. `known` (h, w): where they
    show the person, `face` (h, w) their face. `brightest`, `white`: the largest value of the photograph, and
    one that few of its pixels exceed.
    """
    few = np.s_[..., ::STEP, ::STEP]
    if known[few].any():
        light, albedo, known, face = light[few], albedo[few], known[few], None if face is None else face[few]
    wanted = 1.0
    if brightest <= CLIPPED:
        key = float(light.mean(dim=0)[known].quantile(BRIGHT_QUANTILE))
        wanted = max(key, 1e-3) ** TRUST
        if white < WHITE:
            wanted = max(wanted, 1.0)
    if face is not None and face.any():
        skin = max(float(albedo[1][face].median()), 1e-3)
        wanted = min(max(wanted, SKIN[0] / skin), SKIN[1] / skin)
    lightest = float(albedo.amax(dim=0)[known].quantile(0.99))
    wanted = min(wanted, max(1.0, LIGHTEST / max(lightest, 1e-3)))
    return min(max(wanted, LIMITS[0]), LIMITS[1])
