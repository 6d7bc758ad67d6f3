"""Paint the light: strokes on the person, brighter or darker, become lights."""

import warnings
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
import torch

from relight import quantities
from relight.analysis.gloss import checked_gloss
from relight.analysis.light_solver import LightSolver
from relight.arguments import checked, checked_number, checks_arguments, shown
from relight.lights.light import Light
from relight.lights.rig import FewLights, Lights
from relight.media import images
from relight.media.colour import encode, luminance
from relight.subject import Subject
from shadow import inputs
from shadow.files import AnyPath, is_path
from shadow.torch_settings import isolated

if TYPE_CHECKING:
    from typing_extensions import TypeIs

COUNT = 4  # lights at most
MOST_FACTOR = 1000.0
KEPT = 0.05  # weight of all that is not painted, beside 1 for the mean under each stroke
PATTERN = 0.05  # weight of the pattern of light under strokes
SHADOW_LIGHT = 0.05  # of the mean light: what a stroke multiplies where there is less
PAINTED = 0.5  # share of a cell from which on it counts as painted
OVERLAP = 0.5  # share of a stroke that another may ask the opposite of
NEAR = 0.15  # stops by which a stroke may be missed without a word
STOPS = 1.0  # of pure red, up, and of pure blue, down, in a picture of strokes
GREY = 128 / 255  # the code that leaves the light as it is, in a grey picture
UNCHANGED = 0.02  # share by which a picture of the wanted light differs where nothing was painted


Factor: TypeAlias = float | np.ndarray  # of the light: a number, or (H, W)
Stroke: TypeAlias = tuple[inputs.Array, Factor]  # its mask, and the factor that it asks for
Strokes: TypeAlias = Iterable[Stroke] | inputs.Array  # or a picture of the wanted light


class StrokeResult(NamedTuple):
    """What became of a stroke: the factor of light that it asked for, and the one that it got."""

    asked: float
    reached: float

    @property
    def stops_missed(self) -> float:
        """By how many stops the light under the stroke is too bright; negative if it is too dark."""
        return float(np.log2(max(self.reached, 1e-3) / max(self.asked, 1e-3)))


class Painted(NamedTuple):
    """Lights that strokes became, and what became of each stroke."""

    lights: list[Light]
    strokes: list[StrokeResult]


class _Stroke(NamedTuple):
    mask: torch.Tensor  # (H, W) in [0, 1]
    factor: Factor

    @property
    def varies(self) -> bool:
        """Whether the factor differs from place to place."""
        return isinstance(self.factor, np.ndarray)


@isolated
@checks_arguments
def paint_lights(
    subject: Subject,
    strokes: Strokes,
    lights: Lights | None = None,
    *,
    count: FewLights = COUNT,
    gloss: quantities.Gloss = 0.0,
) -> list[Light]:
    """Turn strokes of light on the person into lights.

    The powers of the lights that are there, and of 96 directions, are solved for by non-negative least
    squares, so that the light under each stroke is what it asks for and all else stays as it is; see
    `relight.analysis.light_solver`.

    Parameters
    ----------
    subject
        The person.
    strokes
        Pairs (mask, factor): (H, W) as `relight.Subject` takes a mask, and by how much the light is
        multiplied there: 2 is brighter by a stop, 0.5 darker by one, 1 as it is. A later stroke covers
        earlier ones. Or
        (H, W, 3|4), a picture of the person in the wanted light, linear floats or sRGB integers; what differs
        from the present picture was painted.
    lights
        The lights that are there, or the name of a preset. None: the light of the photograph, which the new
        lights then replace.
    count
        Number of lights at most, in [1, 32], of all kinds together.
    gloss
        See `Subject.relit`.

    Returns
    -------
    list[Light]
        At most `count` lights. Those that are there stay where they are if their intensity alone changes; the
        others are DirectionalLights with an angle, with the names of those that they replace, or `paint1`,
        `paint2`... They light the person alone: no share of the photograph (`amount`) remains.

    Raises
    ------
    TypeError, ValueError
        No strokes, a stroke that is empty, outside the person or contradicts another, factors below 0 or
        above 1000, a picture or mask of another size than the subject's, lights that move.

    Warns
    -----
    UserWarning
        A stroke that no lights fulfil, with how near they come.

    Examples
    --------
    >>> import numpy as np, relight
    >>> subject = relight.Subject(np.full((64, 48, 3), 0.3, np.float32), np.eye(64, 48, k=-8) < 0.5)
    >>> brighter = np.zeros((64, 48), np.float32)
    >>> brighter[:, :24] = 1
    >>> key = relight.DirectionalLight(azimuth=20, elevation=20, name="key")
    >>> lights = relight.paint_lights(subject, [(brighter, 1.2)], key, count=2)
    >>> len(lights) <= 2 and all(light.intensity > 0 for light in lights)
    True
    """
    painted = LightPainter(subject, lights, gloss=gloss).solve(strokes, count)
    for number, result in enumerate(painted.strokes, 1):
        if abs(result.stops_missed) > NEAR:
            warnings.warn(
                f"strokes: stroke {number} asks for {result.asked:.3g} times the light; the nearest that "
                f"few lights came is {result.reached:.3g}",
                stacklevel=3,
            )
    return painted.lights


class LightPainter:
    """Solves for the lights of strokes on one person, again and again while one paints.

    The masks of strokes have `size` (H, W), the subject's, or a `reduced` one at which they are quicker to
    draw. Raises as `paint_lights` does.
    """

    def __init__(
        self, subject: Subject, lights: Lights | None = None, *, gloss: float = 0.0, reduced: bool = False
    ) -> None:
        if not isinstance(subject, Subject):
            raise TypeError(f"subject: expected a relight.Subject, got {type(subject).__name__}")
        if subject.is_empty:
            raise ValueError("subject: shows no person; expected one on whom light can be painted")
        current = [] if lights is None else subject.placed(lights)
        self._grid = subject.light_grid(checked_gloss(gloss))
        self.size = self._grid.drawing_size if reduced else subject.size
        self._solver = LightSolver(self._grid, current)
        self._before, present = self._solver.picture, subject.relit(current, gloss)
        if lights is None:
            present = subject.photographed()
            self._before = self._seen(present)
        self._present = present

    def solve(self, strokes: Strokes, count: int = COUNT) -> Painted:
        """Return the lights of strokes, and what became of each stroke; see `paint_lights`."""
        count = checked("count", count, FewLights)
        if is_picture := _is_picture(strokes):
            wanted, covered = self._of_picture(strokes)
            coverages, asked = [covered], [_change(self._before, wanted, covered)]
        else:
            given = [self._checked(number, stroke) for number, stroke in enumerate(_several(strokes), 1)]
            coverages = self._coverages(given)
            factors = self._factors(given, coverages)
            _check_agree(coverages, factors)
            wanted, covered = self._of_strokes(coverages, factors)
            asked = [_mean(each, cover) for each, cover in zip(factors, coverages, strict=True)]
        regions, share = None, covered / covered.sum()
        if not is_picture:
            regions, share = np.array(coverages), PATTERN * share
        weights = share + KEPT * (1 - covered) / max((1 - covered).sum(), 1)
        lights = self._solver.solve(wanted, weights * len(weights), count, regions)
        after = sum((self._grid.picture(each).double().numpy() for each in lights), np.zeros_like(wanted))
        reached = [_change(self._before, after, cover) for cover in coverages]
        return Painted(lights, [StrokeResult(*pair) for pair in zip(asked, reached, strict=True)])

    def _checked(self, number: int, stroke: Stroke) -> _Stroke:
        try:
            mask, factor = stroke
        except (TypeError, ValueError):
            raise TypeError(
                f"strokes: stroke {number}: expected a pair (mask, factor), got {shown(stroke)}"
            ) from None
        covered = self._mask(number, mask)
        if isinstance(factor, np.ndarray) and factor.shape == self.size:
            usable = np.isfinite(factor).all() and factor.min() >= 0 and factor.max() <= MOST_FACTOR
            if not usable:
                raise ValueError(f"strokes: stroke {number}: expected factors from 0 to {MOST_FACTOR:g}")
            return _Stroke(covered, factor)
        return _Stroke(
            covered, checked_number(f"strokes: the factor of stroke {number}", factor, 0, MOST_FACTOR)
        )

    def _mask(self, number: int, mask: inputs.Array) -> torch.Tensor:
        name = f"strokes: the mask of stroke {number}"
        covered = images.coverage(name, mask)
        if covered.shape != self.size:
            raise ValueError(f"{name}: expected the subject's size {self.size}, got {covered.shape}")
        return torch.from_numpy(np.float32(covered))

    def _coverages(self, strokes: Sequence[_Stroke]) -> list[np.ndarray]:
        """Return the share (N,) of each point's cell that each stroke covers."""
        covered = self._grid.coverage(torch.stack([each.mask for each in strokes])).double().numpy()
        for number, (stroke, cover) in enumerate(zip(strokes, covered, strict=True), 1):
            if not stroke.mask.any():
                raise ValueError(f"strokes: stroke {number} is empty; expected a mask with something painted")
            if cover.max() < 0.05:
                raise ValueError(f"strokes: stroke {number} is outside the person; expected strokes on them")
        return list(covered.clip(0, 1))

    def _factors(self, strokes: Sequence[_Stroke], coverages: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Return the factors (N,) that each stroke asks for at the points, where it covers them."""
        maps = [each.mask * torch.from_numpy(np.float32(each.factor)) for each in strokes if each.varies]
        weighted = iter(self._grid.coverage(torch.stack(maps)).double().numpy() if maps else [])
        return [
            np.where(cover > 1e-3, next(weighted) / cover.clip(1e-3), 1.0)
            if each.varies
            else np.full(len(self._grid), float(each.factor))
            for each, cover in zip(strokes, coverages, strict=True)
        ]

    def _of_strokes(
        self, coverages: Sequence[np.ndarray], factors: Sequence[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the wanted picture (3, N), and how far each point is painted (N,)."""
        stops, covered = np.zeros(len(self._grid)), np.zeros(len(self._grid))
        for cover, factor in zip(coverages, factors, strict=True):
            stops = stops * (1 - cover) + cover * np.log2(factor.clip(1e-3))
            covered = covered * (1 - cover) + cover
        factor = 2.0**stops
        albedo = self._grid.albedo.double().numpy()
        mean = self._before.sum(axis=1, keepdims=True) / albedo.sum(axis=1, keepdims=True).clip(1e-9)
        multiplied = np.maximum(self._before, SHADOW_LIGHT * mean * albedo)
        brighter = self._before + (factor - 1) * multiplied
        return np.where(factor > 1, brighter, self._before * factor), covered

    def _seen(self, picture: inputs.Array) -> np.ndarray:
        """Return what a picture of the person shows at the points (3, N)."""
        return self._grid.photographed(picture).double().numpy()

    def _of_picture(self, picture: inputs.Array) -> tuple[np.ndarray, np.ndarray]:
        """Return what a picture of the wanted light shows (3, N), and where it was painted (N,)."""
        wanted, present = self._seen(picture), self._seen(self._present)
        covered = (np.abs(wanted - present) / (present.mean() + present)).max(axis=0) > UNCHANGED
        if not covered.any():
            raise ValueError("strokes: the picture differs nowhere on the person from what it is painted on")
        return np.where(covered, wanted, self._before), covered.astype(float)


def _is_picture(strokes: object) -> "TypeIs[inputs.Array]":
    return getattr(strokes, "ndim", None) == 3


def _several(strokes: Iterable[Stroke]) -> list[Stroke]:
    try:
        several = list(strokes)
    except TypeError:
        raise TypeError(
            f"strokes: expected pairs (mask, factor), or a picture (H, W, 3|4), got {shown(strokes)}"
        ) from None
    if not several:
        raise ValueError("strokes: expected at least one pair (mask, factor), got none")
    return several


def _check_agree(coverages: Sequence[np.ndarray], factors: Sequence[np.ndarray]) -> None:
    """Raise ValueError where a stroke asks for more light and another, at the same place, for less."""
    for second in range(len(coverages)):
        for first in range(second):
            both = np.minimum(coverages[first], coverages[second])
            opposed = (np.log2(factors[first].clip(1e-3)) * np.log2(factors[second].clip(1e-3)) < 0) * both
            smaller = min(coverages[first].sum(), coverages[second].sum())
            if opposed.sum() > OVERLAP * smaller:
                raise ValueError(
                    f"strokes: strokes {first + 1} and {second + 1} contradict each other; expected one of "
                    "brighter and darker at a place"
                )


def _mean(values: np.ndarray, weights: np.ndarray) -> float:
    """Return the weighted mean of factors, in stops."""
    return float(2.0 ** np.average(np.log2(values.clip(1e-3)), weights=weights))


def _change(before: np.ndarray, after: np.ndarray, covered: np.ndarray) -> float:
    """Return the factor between two pictures (3, N) under a stroke."""
    there, then = (luminance(picture.T) @ covered for picture in (before, after))
    return float(then / max(there, 1e-9))


def read_strokes(picture: inputs.Array | AnyPath) -> list[tuple[np.ndarray, Factor]]:
    """Return the strokes of a picture (H, W, 3|4) or of a picture's file, as pairs for `paint_lights`.

    In a coloured picture red asks for up to twice the light, blue for as little as half, and green for the
    light as it is; white, grey, black and what is transparent are no strokes. In a grey picture of integers
    128 leaves the light as it is, 255 doubles it and 0 takes it away; in one of floats a value is the factor.

    Raises FileNotFoundError, and ValueError for a picture without strokes.
    """
    if not is_path(picture):
        return _strokes_of(picture, is_light=np.asarray(picture).dtype.kind == "f")
    try:
        return _strokes_of(images.read(picture), is_light=str(picture).lower().endswith((".exr", ".hdr")))
    except ValueError as error:
        raise ValueError(f"{picture}: {error}") from error


def _strokes_of(picture: inputs.Array, is_light: bool) -> list[tuple[np.ndarray, Factor]]:
    """See `read_strokes`. `is_light`: whether the values of a grey picture are factors."""
    pixels = images.scene_linear("strokes", picture)
    if pixels.ndim != 3 or pixels.shape[-1] not in (3, 4):
        raise ValueError("expected a picture of strokes")
    alpha = pixels[..., 3] if pixels.shape[-1] == 4 else np.ones(pixels.shape[:2], np.float32)
    colour = pixels[..., :3] / np.maximum(alpha, 1e-6)[..., None]
    if np.ptp(colour, axis=-1).max() < 1e-3:
        grey = colour[..., 1]
        factor = grey if is_light else encode(grey[..., None].repeat(3, 2), white=1.0)[..., 1] / GREY
        mask = (np.abs(factor - 1) > 0.02) * alpha
        found: list[tuple[np.ndarray, Factor]] = [(mask, factor)]
    else:
        red, green, blue = np.moveaxis(encode(np.ascontiguousarray(colour), white=1.0).clip(0, 1), -1, 0)
        up, down = np.clip(red - np.maximum(green, blue), 0, 1), np.clip(blue - np.maximum(red, green), 0, 1)
        kept = np.clip(green - np.maximum(red, blue), 0, 1)
        found = [
            ((up > 0.05) * alpha, 2.0 ** (STOPS * up)), ((down > 0.05) * alpha, 2.0 ** (-STOPS * down)),
            ((kept > 0.05) * alpha, 1.0),
        ]  # fmt: skip
    strokes = [(mask.astype(np.float32), factor) for mask, factor in found if mask.max() > 0]
    if not strokes:
        raise ValueError("holds no strokes; expected red (brighter), blue (darker) or green (as it is)")
    return strokes
