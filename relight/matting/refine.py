"""Work on mattes: select one of several people, solve the edge, bring it to the photograph's size."""

import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import ArrayLike
from scipy.ndimage import distance_transform_edt, gaussian_filter, label, uniform_filter

from relight.matting.numba_cache import ensure_numba_cache
from relight.media import colour
from relight.media.images import scene_linear
from relight.media.resampling import resize
from shadow.installing import install_command

ALL = "all"  # people, in place of one of them
OPAQUE, OPAQUE_SHARE = 0.99, 0.999  # alpha is no matte where this share of its pixels is at least so opaque
PERSON, BACKGROUND, UNKNOWN = 1.0, 0.0, 0.5  # values of a trimap
EDGE = 2.0  # pixels on either side of the edge that are solved a second time
SURE = 0.2  # farther from that edge, coverage up to this is none, and above 1 - SURE it is full
ALIKE = 0.03  # contrast, encoded, relative to the darker side; below, colours hardly find an edge
SMOOTH = 4.0  # standard deviation in pixels of the Gaussian that smooths the contour there
REGULARISATION = 1e-7  # of the matting Laplacian; linear light has small variances
EDGE_PRIOR = 0.005  # weight of the rough matte, which is blurred: more of it makes edges soft
EDGE_WINDOW = 9  # pixels, side of the box in which the colours on both sides of an edge are gathered
LEAST_CONTRAST = 1e-3  # sum of squared differences of linear colours from which these tell the coverage
MIN_PERSON_SHARE = 0.1  # of the largest connected region's area: a smaller one is no person of its own

_importing = threading.Lock()


def is_opaque(pixels: np.ndarray) -> bool:
    """Return whether a picture (H, W, 3|4), floats, has no matte in its alpha.

    Alpha that is opaque but for one pixel in a thousand is an exporter's rounding; a warning says so.
    """
    if pixels.shape[-1] == 3:
        return True
    share = float((pixels[..., 3] >= OPAQUE).mean())
    if share >= OPAQUE_SHARE and pixels[..., 3].min() < 1:
        warnings.warn(
            f"image: its alpha is opaque in {100 * share:.3g} % of the pixels, which is no matte",
            stacklevel=3,
        )
    return share >= OPAQUE_SHARE


def opaque_photograph(image: ArrayLike, name: str = "image") -> np.ndarray:
    """Return a photograph as (H, W, 3), linear Rec.709; raises ValueError if it is transparent."""
    pixels = scene_linear(name, image)
    if not is_opaque(pixels):
        raise ValueError(f"{name}: has transparency, which is a matte already; expected an opaque photograph")
    return pixels[..., :3]


def encoded_srgb(pixels: np.ndarray) -> np.ndarray:
    """Encode linear pixels (H, W, 3) as third-party networks expect them: sRGB, float32 in [0, 1]."""
    return colour.encode(pixels.clip(0, 1)).clip(0, 1).astype(np.float32)


# Which of several people: 1 for the largest, 2..., (x, y), (x, y, radius), or "all"; None is 1.
PersonChoice: TypeAlias = int | str | Sequence[float] | np.ndarray | None


def is_everybody(person: object) -> bool:
    """Return whether all people are meant, and not one of them, which may be an array."""
    return isinstance(person, str) and person == ALL


def select_person(found: np.ndarray, person: PersonChoice = None) -> np.ndarray:
    """Return the matte (H, W) of one of several people, see `relight.matte`.

    People are regions above 0.5 that do not touch. Each takes the soft edge and small parts nearest to it.
    """
    if is_everybody(person):
        return found
    regions, count = label(found > 0.5, np.ones((3, 3)))
    areas = np.bincount(regions.ravel(), minlength=count + 1)[1:]
    order = np.argsort(-areas, kind="stable") + 1
    people = [int(region) for region in order if areas[region - 1] >= MIN_PERSON_SHARE * areas.max()]
    if not people:
        return found
    owner = np.where(np.isin(regions, people), regions, 0)
    nearest = distance_transform_edt(owner == 0, return_distances=False, return_indices=True)
    owner = owner[tuple(nearest)]
    if isinstance(person, Sequence | np.ndarray) and not isinstance(person, str) and np.ndim(person) == 1:
        x, y, *_ = (int(value) for value in person)
        if not (0 <= x < found.shape[1] and 0 <= y < found.shape[0]):
            raise ValueError(f"person: expected a point in the picture, got {x}/{y}")
        return np.where(owner == owner[y, x], found, 0)
    number = 1 if person is None else person
    if not isinstance(number, int) or not 1 <= number <= len(people):
        raise ValueError(f"person: expected 1 to {len(people)}, as many as there are people, got {person!r}")
    return np.where(owner == people[number - 1], found, 0)


def solve_edge(seen: np.ndarray, rough: np.ndarray, band: float) -> np.ndarray:
    """Solve the edge of a rough matte by closed-form matting, in a band and then close to the edge found.

    The first solution finds the edge, but spreads coverage over the band where the colours of person and
    background are alike. The second keeps only what is clearly partly covered, such as hair, away from it.

    `seen`: (H, W, 3) in [0, 1], linear, since in encoded values the edge of dark cloth on a bright wall is
    too thin. `rough`: (H, W) in [0, 1]. `band`: pixels on either side of the rough edge.
    """
    weight = np.full(rough.shape, EDGE_PRIOR)
    known = trimap(rough, band)
    alpha = closed_form(seen, known, rough, weight, REGULARISATION)
    narrow = trimap(alpha, EDGE)
    partly = (known == UNKNOWN) & (np.abs(alpha - narrow) > SURE)
    return closed_form(seen, np.where(partly, UNKNOWN, narrow), alpha, weight, REGULARISATION)


def smooth_where_alike(seen: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Smooth the contour of a matte (H, W) where person and background have nearly one colour.

    There, the solution follows noise and the blocks of JPEG. Contrast, in `seen` (H, W, 3) in [0, 1], linear,
    is relative, since dark cloth keeps its edge at small differences.
    """
    size = round(3 * SMOOTH) + 1  # a box about as wide as the Gaussian
    codes = encoded_srgb(seen)
    inner, outer = _colours_beside(alpha, codes, size)
    contrast = np.sqrt(np.square(inner - outer).mean(axis=-1))
    darker = np.minimum(inner.mean(axis=-1), outer.mean(axis=-1)).clip(0)
    alike = np.exp(-np.square(contrast / (darker + 0.05) / ALIKE))
    # A straight edge has this slope when blurred; the smooth contour's edge is two pixels wide.
    slope = 1 / (SMOOTH * np.sqrt(2 * np.pi))
    smooth = (0.5 + (gaussian_filter(alpha, SMOOTH) - 0.5) / (2 * slope)).clip(0, 1)
    return np.asarray(alpha + alike * (smooth - alpha), np.float32)


def _colours_beside(alpha: np.ndarray, codes: np.ndarray, window: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean colours (h, w, 3) of the person and of the background in a window around each pixel."""
    share, every, person = (
        uniform_filter(values, (window, window, 0))
        for values in (alpha[..., None], codes, codes * alpha[..., None])
    )
    return person / np.maximum(share, 1e-3), (every - person) / np.maximum(1 - share, 1e-3)


def linear_coverage(alpha: np.ndarray, encoded: np.ndarray) -> np.ndarray:
    """Return the coverage (h, w) for mixing in linear light, of a matte that suits encoded colours.

    Light mixes in the lens, before it is encoded: what covers half of a pixel before a dark wall is brighter
    than the mean of both codes, and a network takes it for more. `encoded`: the photograph (h, w, 3), sRGB in
    [0, 1]. The colours of both sides are means near by; where they are alike, the matte stays.
    """
    inner, outer = (each.clip(0, 1) for each in _colours_beside(alpha, encoded, EDGE_WINDOW))
    person, wall, mixed = (
        colour.decode(codes, "sRGB") for codes in (inner, outer, outer + (inner - outer) * alpha[..., None])
    )
    contrast = np.square(person - wall).sum(axis=-1)
    linear = ((mixed - wall) * (person - wall)).sum(axis=-1) / np.maximum(contrast, 1e-6)
    weight = contrast / (contrast + LEAST_CONTRAST)
    return np.asarray(alpha + weight * (linear.clip(0, 1) - alpha), np.float32)


def trimap(matte: np.ndarray, band: float) -> np.ndarray:
    """Return a matte's (H, W) person, background, and what is at most `band` pixels from its edge."""
    distance = distance_inside(matte > 0.5)
    # A margin narrower than the band is still known where it is deepest.
    inner, outer = min(band, distance.max() / 2), max(-band, distance.min() / 2)
    inner, outer = inner if inner > 0 else band, outer if outer < 0 else -band
    return np.where(distance > inner, PERSON, np.where(distance < outer, BACKGROUND, UNKNOWN))


def closed_form(
    seen: np.ndarray, known: np.ndarray, prior: np.ndarray, weight: np.ndarray, epsilon: float = 1e-5
) -> np.ndarray:
    """Solve (L + W) alpha = W prior in the unknown pixels, with L the matting Laplacian; (h, w) in [0, 1]."""
    if not (known == UNKNOWN).any():
        return known.astype(np.float32)
    laplacian_of = pymatting("laplacian.cf_laplacian")
    precondition, solve = pymatting("preconditioner.ichol"), pymatting("solver.cg")
    import scipy.sparse

    unknown = (known == UNKNOWN).ravel()
    laplacian = laplacian_of(seen.astype(float), epsilon=epsilon, is_known=~unknown.reshape(known.shape))
    rows = laplacian[unknown]
    own = scipy.sparse.csr_matrix(rows[:, unknown] + scipy.sparse.diags(weight.ravel()[unknown] + 1e-6))
    target = weight.ravel()[unknown] * prior.ravel()[unknown] - rows[:, ~unknown] @ known.ravel()[~unknown]
    alpha = known.ravel().copy()
    start = prior.ravel()[unknown].astype(float)
    within = precondition(own, discard_threshold=1e-3)
    alpha[unknown] = solve(own, target, x0=start, M=within, atol=1e-8, rtol=1e-4, maxiter=1000)
    return alpha.reshape(known.shape).clip(0, 1).astype(np.float32)


def upsampled(seen: np.ndarray, alpha: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Upsample the matte `alpha` of a copy `seen` to the photograph `fine` by a guided filter.

    Within small windows, the matte is linear in the colour (He and Sun, "Fast Guided Filter", 2015). The
    pictures are (h, w, 3) and (H, W, 3) in [0, 1].
    """
    window, epsilon = 5, 1e-4

    def mean(values: np.ndarray) -> np.ndarray:
        return uniform_filter(values, (window, window, *[0] * (values.ndim - 2)))

    centre, level = mean(seen), mean(alpha)
    spread = mean(seen[..., :, None] * seen[..., None, :]) - centre[..., :, None] * centre[..., None, :]
    along = mean(seen * alpha[..., None]) - centre * level[..., None]
    slope = np.linalg.solve(spread + epsilon * np.eye(3, dtype=np.float32), along[..., None])[..., 0]
    model = np.concatenate([mean(slope), mean(level - (slope * centre).sum(-1))[..., None]], axis=-1)
    model = resize(model.astype(np.float32), fine.shape[:2], "triangle")
    return (np.einsum("hwc,hwc->hw", model[..., :3], fine) + model[..., 3]).clip(0, 1)


def distance_inside(region: np.ndarray) -> np.ndarray:
    """Return the distance (h, w) to the edge of a region, in pixels, positive inside.

    The border of the picture is not an edge.
    """
    if region.all() or not region.any():
        return np.full(region.shape, np.inf if region.any() else -np.inf)
    inner, outer = distance_transform_edt(region), distance_transform_edt(~region)
    return np.where(region, inner - 0.5, 0.5 - outer)


def pymatting(name: str, extra: str = "matte") -> Callable[..., np.ndarray]:
    """Return the function of a module of PyMatting that has its name; an extra of this name installs it."""
    ensure_numba_cache()
    try:
        function = getattr(_module_of_pymatting(name), name.split(".")[-1])
    except ImportError as error:
        raise ImportError(f"{extra}: needs PyMatting; install it with: {install_command(extra)}") from error

    def called(*values: object, **options: object) -> np.ndarray:
        threads = torch.get_num_threads()
        result = function(*values, **options)
        torch.set_num_threads(threads)  # numba has set the process' to the number of processors
        return result

    return called


def _module_of_pymatting(name: str) -> ModuleType:
    """Import a module of PyMatting alone: the package imports, and so compiles, all, for half a minute."""
    whole = f"pymatting.{name}"
    with _importing:
        package = find_spec("pymatting")
        if whole in sys.modules or package is None:
            return import_module(whole)
        folders = package.submodule_search_locations
        assert folders
        spec = spec_from_file_location(whole, Path(folders[0], *name.split(".")).with_suffix(".py"))
        assert spec is not None
        assert spec.loader is not None
        module = sys.modules[whole] = module_from_spec(spec)
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[whole]
            raise
        return module
