"""The matte of a person before a green or blue screen: key, despill, and the foreground's own colour."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import torch
from numpy.typing import ArrayLike
from scipy.ndimage import minimum_filter, uniform_filter

from relight.media.buffers import to_array, to_buffer
from relight.media.images import scene_linear
from shadow import inputs

SCREENS = {"green": 1, "blue": 2}  # the channel that gives the screen away
SATURATED = 0.3  # least difference of a screen's channel to the others, as a share of it
BARE = 0.85  # of the screen's difference: above it no one is there
SOLID = 0.8  # coverage above which, away from any edge, it is complete: spill and folds make no holes
GRAIN = 3.0  # medians of the screen's grain, 2 standard deviations, that count as nobody; twice it is kept
COMPILING = "Compiling PyMatting, once on this machine: one to two minutes"
EDGE = 1 / 40  # widest soft edge, as a share of the side of a square of the person's area


def key(image: ArrayLike, screen: str = "green", *, mask: ArrayLike | None = None) -> np.ndarray:
    """Cut a person out of a green or blue screen.

    Parameters
    ----------
    image: (H, W, 3|4), opaque. Integers are sRGB-encoded; floats linear Rec.709.
    screen: "green" or "blue". It may be unevenly lit.
    mask: (H, W) in [0, 1], a garbage matte: what lies outside, such as the studio beyond the screen, goes.

    Returns
    -------
    (H, W, 4) float32, linear Rec.709, premultiplied: soft where hair and motion blur are, without the
    screen's colour and its spill; ready for `relight.Subject`.

    A pixel is a mixture of the person and the screen. How much of each there is follows from the screen's
    channel less the larger of the others (the colour difference key, Vlahos 1971), of the pixel, of the
    screen, continued behind the person, and of the person, continued outward from where they are solid.
    The person's own colour there is estimated by PyMatting (Germer et al. 2020), which compiles itself the
    first time on a machine, for one to two minutes, and keeps the result in Numba's cache. No part of the
    person may be of the screen's colour: it would be cut out too.

    Raises
    ------
    ImportError: PyMatting is missing (the extra `key`). TypeError, ValueError: as `relight.Subject`; an image
    with transparency, without such a screen, or with nobody before it.
    """
    if screen not in SCREENS:
        raise ValueError(f"screen: expected {' or '.join(SCREENS)}, got {screen!r}")
    pixels = scene_linear("image", image)
    if pixels.shape[-1] == 4 and pixels[..., 3].min() < 1:
        raise ValueError("image: has transparency; expected the opaque photograph of a person and a screen")
    pixels = pixels[..., :3]
    inside = None if mask is None else inputs.mask("mask", mask, pixels.shape[:2]).numpy()
    try:
        from pymatting.foreground.estimate_foreground_ml import estimate_foreground_ml
    except ImportError as error:
        raise ImportError("key: needs PyMatting; install it with: pip install 'relight[key]'") from error

    channel = SCREENS[screen]
    observed = _difference(pixels, channel)
    calm = uniform_filter(observed, 3)  # grain makes no holes in the regions where all is clear
    evenly = _even_screen(pixels[..., channel], calm, screen)
    rough = (1 - calm / evenly).clip(0, 1)
    edge = max(1, round(EDGE * float((rough if inside is None else rough * inside).sum()) ** 0.5))
    bare = _shrink(calm > BARE * evenly, edge)
    behind = np.maximum(_difference(_continued(pixels, bare), channel), 1e-6)

    solid = _shrink(1 - calm / behind > SOLID, edge)
    if inside is not None:
        solid &= inside > 0
    if not solid.any():
        raise ValueError(f"image: shows nobody before the {screen} screen")
    person = _continued(pixels, solid)
    alpha = ((behind - observed) / (behind - np.minimum(_difference(person, channel), behind / 2))).clip(0, 1)
    if bare.any():  # what is not above the screen's grain is screen
        grain = GRAIN * np.median(np.abs(observed - calm)[bare] / behind[bare])
        alpha *= (alpha / max(grain, 1e-6) - 1).clip(0, 1)
    alpha[bare] = 0
    alpha[solid] = 1
    if inside is not None:
        alpha *= inside
    threads = torch.get_num_threads()
    foreground = estimate_foreground_ml(pixels, alpha)
    torch.set_num_threads(threads)  # numba has set the process' to the number of processors
    colour = _despill(foreground.clip(0), channel, person)
    return np.concatenate([colour * alpha[..., None], alpha[..., None]], axis=-1, dtype=np.float32)


def is_compiled() -> bool:
    """Whether PyMatting has compiled itself on this machine before, as far as its own cache tells."""
    found = find_spec("pymatting")
    folders = [] if found is None else found.submodule_search_locations or []
    return any(any(Path(folder).glob("foreground/__pycache__/*.nbi")) for folder in folders)


def _difference(pixels: np.ndarray, channel: int) -> np.ndarray:
    """The screen's channel less the larger of the others (H, W): large on the screen, small on a person."""
    first, second = (pixels[..., other] for other in range(3) if other != channel)
    return pixels[..., channel] - np.maximum(first, second)


def _even_screen(values: np.ndarray, difference: np.ndarray, screen: str) -> np.ndarray:
    """The screen's difference (H, W) as far as it varies slowly: a quadric fitted to most of its pixels."""
    rows, columns = difference.shape
    step = max(1, int((rows * columns / 40000) ** 0.5))
    y, x = (axis.ravel() for axis in np.mgrid[:rows:step, :columns:step])
    sample, value = difference[y, x], values[y, x]
    candidate = (sample > SATURATED * value) & (sample > 0)
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


def _shrink(region: np.ndarray, pixels: int) -> np.ndarray:
    """A region (H, W) bool without what is nearer than so many pixels to its edge."""
    return minimum_filter(region.view(np.uint8), 2 * pixels + 1) > 0


def _continued(pixels: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Colour (H, W, 3) where it is known, continued everywhere by push-pull (Gortler et al. 1996)."""
    trusted = np.concatenate([pixels * known[..., None], known[..., None]], axis=-1, dtype=np.float32)
    filled = oiio.ImageBufAlgo.fillholes_pushpull(to_buffer(trusted))
    return to_array(filled)[..., :3]


def _despill(pixels: np.ndarray, channel: int, person: np.ndarray) -> np.ndarray:
    """The screen's channel held to the larger of the others, and to no less of it than the solid person has.

    More of it is light of the screen that the person reflects; less, noise that leaves hair magenta.
    """
    larger, theirs = ((p[..., channel] - _difference(p, channel)) for p in (pixels, person))
    least = (person[..., channel] / np.maximum(theirs, 1e-6)).clip(0, 1)
    pixels[..., channel] = pixels[..., channel].clip(larger * least, larger)
    return pixels
