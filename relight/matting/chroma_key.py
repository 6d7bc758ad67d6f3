"""Cut a person out of a green or blue screen: key, despill, and the foreground's own colour."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import minimum_filter, uniform_filter

from relight.arguments import checks_arguments
from relight.errors import EmptyMatteError
from relight.matting.refine import pymatting
from relight.media.images import person_mask, scene_linear
from relight.media.resampling import fill_unknown
from shadow.torch_settings import isolated

SCREENS = {"green": 1, "blue": 2}  # index of the screen's channel
MIN_SATURATION = 0.3  # least difference of a screen's channel to the others, as a share of it
SCREEN_SHARE = 0.85  # of the screen's difference: above it a pixel shows the screen alone
SOLID_COVERAGE = 0.8  # above it, away from edges, coverage is complete: spill and folds make no holes
GRAIN_MEDIANS = 3.0  # of the screen's grain, 2 standard deviations, that count as screen; twice that is kept
MAX_EDGE_SHARE = 1 / 40  # widest soft edge, as a share of the side of a square of the person's area


@isolated
@checks_arguments
def key(image: ArrayLike, screen: str = "green", *, mask: ArrayLike | None = None) -> np.ndarray:
    """Cut a person out of a green or blue screen.

    A pixel is a mixture of the person and the screen. Their shares follow from colour differences, the
    screen's channel minus the larger of the others (Vlahos 1971): that of the pixel, that of the screen,
    interpolated behind the person, and that of the person, extrapolated from opaque pixels. PyMatting
    estimates the person's own colour (Germer et al. 2020). It is compiled at its first use on a machine,
    which takes some seconds, and stored in Numba's cache. Parts of the person in the screen's colour become
    transparent too.

    Parameters
    ----------
    image
        (H, W, 3|4), opaque. Integers are sRGB-encoded; floats linear Rec.709.
    screen
        "green" or "blue". It may be unevenly lit.
    mask
        (H, W) in [0, 1], or uint8 or uint16 over the full range, a garbage matte: everything outside it, such
        as the studio beside the screen, is removed.

    Returns
    -------
    np.ndarray
        (H, W, 4) float32, linear Rec.709, premultiplied, for `relight.Subject`. Hair and motion blur are
        soft, without the screen's colour and its spill.

    Raises
    ------
    ImportError
        PyMatting is missing (the extra `key`).
    TypeError, ValueError
        What `relight.Subject` refuses; an image with transparency, or without such a screen.
    relight.errors.EmptyMatteError
        No person is in front of the screen.

    Examples
    --------
    >>> import numpy as np, relight
    >>> relight.key(np.zeros((64, 48, 3), np.float32), "pink")
    Traceback (most recent call last):
        ...
    ValueError: screen: expected green or blue, got 'pink'
    """
    if screen not in SCREENS:
        raise ValueError(f"screen: expected {' or '.join(SCREENS)}, got {screen!r}")
    pixels = scene_linear("image", image)
    if pixels.shape[-1] == 4 and pixels[..., 3].min() < 1:
        raise ValueError("image: has transparency; expected the opaque photograph of a person and a screen")
    pixels = pixels[..., :3]
    inside = None
    if mask is not None:
        inside = person_mask("mask", mask, pixels.shape[:2]).numpy()
    estimate_foreground = pymatting("foreground.estimate_foreground_ml", "key")
    channel = SCREENS[screen]
    observed = _difference(pixels, channel)
    smoothed = uniform_filter(observed, 3)  # grain makes no holes in the regions where all is clear
    even_screen = _even_screen(pixels[..., channel], smoothed, screen)
    rough = (1 - smoothed / even_screen).clip(0, 1)
    edge = max(1, round(MAX_EDGE_SHARE * float((rough if inside is None else rough * inside).sum()) ** 0.5))
    screen_only = _eroded(smoothed > SCREEN_SHARE * even_screen, edge)
    behind = np.maximum(_difference(fill_unknown(pixels, screen_only), channel), 1e-6)

    solid = _eroded(1 - smoothed / behind > SOLID_COVERAGE, edge)
    if inside is not None:
        solid &= inside > 0
    if not solid.any():
        raise EmptyMatteError(f"image: shows no person in front of the {screen} screen")
    person = fill_unknown(pixels, solid)
    alpha = ((behind - observed) / (behind - np.minimum(_difference(person, channel), behind / 2))).clip(0, 1)
    if screen_only.any():  # what is not above the screen's grain is screen
        grain = GRAIN_MEDIANS * np.median(np.abs(observed - smoothed)[screen_only] / behind[screen_only])
        alpha *= (alpha / max(grain, 1e-6) - 1).clip(0, 1)
    alpha[screen_only] = 0
    alpha[solid] = 1
    if inside is not None:
        alpha *= inside
    colour = _despill(estimate_foreground(pixels, alpha).clip(0), channel, person)
    return np.concatenate([colour * alpha[..., None], alpha[..., None]], axis=-1, dtype=np.float32)


def _difference(pixels: np.ndarray, channel: int) -> np.ndarray:
    """Return the colour difference (H, W), the screen's channel less the larger of the others."""
    first, second = (pixels[..., other] for other in range(3) if other != channel)
    return pixels[..., channel] - np.maximum(first, second)


def _even_screen(values: np.ndarray, difference: np.ndarray, screen: str) -> np.ndarray:
    """Return the slowly varying part of the screen's difference (H, W): a quadric fitted to its pixels."""
    rows, columns = difference.shape
    step = max(1, int((rows * columns / 40000) ** 0.5))
    y, x = (axis.ravel() for axis in np.mgrid[:rows:step, :columns:step])
    sample, value = difference[y, x], values[y, x]
    candidate = (sample > MIN_SATURATION * value) & (sample > 0)
    if candidate.mean() < 0.02:
        raise ValueError(f"image: shows no {screen} screen")
    candidate &= sample > np.percentile(sample[candidate], 99) / 2

    def terms(y: np.ndarray, x: np.ndarray) -> np.ndarray:
        y, x = y / rows - 0.5, x / columns - 0.5
        return np.stack(np.broadcast_arrays(1.0, x, y, x * x, x * y, y * y), axis=-1)

    for _ in range(5):  # robustly: hair and shadows are darker than the screen around them
        fit = np.linalg.lstsq(terms(y, x)[candidate], sample[candidate], rcond=None)[0]
        error = sample - terms(y, x) @ fit
        candidate = error > -max(4 * np.median(np.abs(error[candidate])), 0.01 * sample[candidate].mean())
    even = terms(np.arange(rows)[:, None], np.arange(columns)) @ fit
    return np.maximum(even, sample[candidate].mean() / 4).astype(np.float32)


def _eroded(region: np.ndarray, pixels: int) -> np.ndarray:
    """Erode a region (H, W) bool by a square of this radius in pixels."""
    return minimum_filter(region.view(np.uint8), 2 * pixels + 1) > 0


def _despill(pixels: np.ndarray, channel: int, person: np.ndarray) -> np.ndarray:
    """Limit the screen's channel to the larger of the others, but to no less than the opaque person has.

    More is the screen's light that the person reflects; less is noise, which leaves hair magenta.
    """
    larger, theirs = ((p[..., channel] - _difference(p, channel)) for p in (pixels, person))
    least = (person[..., channel] / np.maximum(theirs, 1e-6)).clip(0, 1)
    pixels[..., channel] = pixels[..., channel].clip(larger * least, larger)
    return pixels
