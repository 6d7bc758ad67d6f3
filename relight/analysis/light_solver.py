"""Few lights in which a person looks as wanted: non-negative least squares, merging, and a search nearby.

A picture is a sum of lights, so the powers of given lights follow from least squares (Lawson and Hanson
1974). Candidates are the lights that are there and 96 hard lights from all around. A penalty on the sum of
the powers (Tibshirani 1996) keeps few of these; neighbours are merged. Their directions and angles are
refined by Gauss and Newton's method, in which the powers follow at each step (Golub and Pereyra 1973).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch

from relight.analysis.light_field import ANCHORS
from relight.analysis.light_grid import LightGrid
from relight.lights.directional import DirectionalLight, frame_of
from relight.lights.light import Light

DARK = 0.1  # of the mean, added to a value before the square root that its error is relative to
RIDGE = 1e-3  # relative to the mean squared column
SPARSITY = 0.02  # price of a new light's power, as a share of the most that any is worth
FAINT = 0.02  # share of all light below which a candidate is left out
MERGED = 25.0  # degrees within which lights are one
SPARE = 2  # lights more than wanted that are refined, of which the least useful go
NEGLIGIBLE = 1e-5  # share of the picture that a light must be worth
USELESS = 0.002  # share of the wanted change that a light must be worth
STEP = 2.0  # degrees, of the derivatives
LONGEST = 12.0  # degrees of one step of the search
STEPS = 4  # of the search
ROUNDS = 4  # of searching directions and angles in turn
WORTHWHILE = 0.9  # of the error, which a round must bring it below for another to follow
DAMPINGS = (1.0, 0.3)  # shares of a step that are tried
ENOUGH = 0.999  # of the error, which a step must bring it below
DAMPED = 1e-4  # added to the normal equations of a step, as a share of their mean
ANGLES = (0.0, 20.0, 40.0, 70.0)  # degrees: angular diameters that are tried


Key = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class _Source:
    """A light whose power is solved for: one that is there, or a direction with an angle in three colours."""

    direction: np.ndarray
    angle: float = 0.0
    light: Light | None = None  # that is there; only its intensity is changed

    @cached_property
    def key(self) -> Key:
        """What tells its picture from others."""
        return (*self.direction.tolist(), self.angle, id(self.light) if self.light else 0)

    @cached_property
    def tangents(self) -> np.ndarray:
        """Two unit vectors (2, 3) at right angles to the direction."""
        return frame_of(self.direction)[:2]


class LightSolver:
    """Solves for lights of one person, starting from those that are there.

    What does not depend on the wanted picture is computed once.
    """

    def __init__(self, grid: LightGrid, current: Sequence[Light]) -> None:
        self._grid, self._current = grid, list(current)
        self._anchors = grid.pictures(ANCHORS).double().numpy()
        own = [grid.picture(light).double().numpy() for light in self._current]
        self._own = np.stack(own) if own else np.zeros((0, *self._anchors.shape[1:]))

    def _pictures(self, sources: Sequence[_Source]) -> np.ndarray:
        """Return the pictures (S, 3, N) of a power of 1 of sources, or of the lights as they are."""
        there = [self._current.index(each.light) for each in sources if each.light is not None]
        free = [each for each in sources if each.light is None]
        pictures = np.empty((len(sources), *self._anchors.shape[1:]))
        is_free = np.array([each.light is None for each in sources])
        pictures[~is_free] = self._own[there]
        if free:
            discs = [each.direction for each in free], [each.angle for each in free]
            pictures[is_free] = self._grid.pictures_of_discs(*discs).double().numpy()
        return pictures

    @property
    def picture(self) -> np.ndarray:
        """The picture (3, N) in the lights that are there."""
        return self._own.sum(axis=0)

    def solve(
        self, wanted: np.ndarray, weights: np.ndarray, count: int, regions: np.ndarray | None = None
    ) -> list[Light]:
        """Return at most `count` lights in which the person looks most like `wanted` (3, N), linear.

        `weights` (N,) say how much the points count. `regions` (R, N), weights of the points in each: the
        mean of a region counts as much as all points together. Lights that are there keep their places
        if their intensity alone changes; new ones are DirectionalLights with an angle, and take the names of
        those that they replace.
        """
        regions = np.zeros((0, len(weights))) if regions is None else regions
        regions = regions / regions.sum(axis=1, keepdims=True)
        weights = np.r_[weights, np.full(len(regions), len(weights))]
        present, wanted = (np.concatenate([p, p @ regions.T], axis=1) for p in (self.picture, wanted))
        scale = np.maximum(present, wanted)
        scale = np.sqrt(weights / (scale + DARK * scale.mean() + 1e-12))
        problem = _Problem(self._pictures, wanted * scale, scale, regions)
        unchanged = ((present - wanted) * scale) ** 2
        useless = USELESS * float(unchanged.sum()) + NEGLIGIBLE * float((problem.wanted**2).sum())
        sources = problem.pruned(problem.refined(self._candidates(problem, count)), count, useless)
        freed = [_freed(each) for each in sources]
        if any(one is not other for one, other in zip(freed, sources, strict=True)):
            freed = problem.pruned(problem.refined(freed), count, useless)
            if problem.error(freed) < problem.error(sources) - useless:
                sources = freed
        return self._lights(sources, *problem.powers(sources))

    def _candidates(self, problem: "_Problem", count: int) -> list[_Source]:
        """Return the lights that are there and still shine, and clusters of the directions that join them."""
        every = np.concatenate([self._own, self._anchors])
        prices = np.r_[np.zeros(len(self._own)), np.full(len(self._anchors), SPARSITY)]
        powers = problem.sparse_powers(every, prices)  # (K + 96, 3)
        light = (powers * every.mean(axis=2)).sum(axis=1)
        kept = light > FAINT * light.sum()
        directions, energy = ANCHORS.numpy()[kept[len(self._own) :]], light[len(self._own) :]
        clusters = _clusters(directions, energy[kept[len(self._own) :]], count + SPARE)
        sources = []
        for number, there in enumerate(self._current):
            if not kept[number]:
                continue
            near = None
            if isinstance(there, DirectionalLight):
                own = np.array(there.direction)
                near = next((at for at, (axis, _) in enumerate(clusters) if _apart(axis, own) < MERGED), None)
            if near is None:
                sources.append(_Source(np.zeros(3), light=there))
            else:  # it moves
                axis, strength = clusters.pop(near)
                moved = _unit(axis * strength + own * light[number])
                sources.append(_Source(moved, there.angle))  # type: ignore[attr-defined]
        return sources + [_Source(axis) for axis, _ in clusters]

    def _lights(self, sources: Sequence[_Source], own: np.ndarray, powers: np.ndarray) -> list[Light]:
        """Return the lights of sources: factors (K,) of those that are there, powers (M, 3) of the others."""
        kept = [each for each in sources if each.light is not None]
        free = [each for each in sources if each.light is None]
        lights: list[Light] = [
            replace(each.light, intensity=each.light.intensity * float(factor))
            for each, factor in zip(kept, own, strict=True)
            if each.light is not None
        ]
        gone = [each for each in self._current if not any(each is source.light for source in kept)]
        names = _names(free, gone, {each.name for each in self._current})
        for each, power, name in zip(free, powers, names, strict=True):
            most = float(power.max())
            if most <= 0:
                continue
            lights.append(
                DirectionalLight(
                    each.direction.tolist(), angle=each.angle, intensity=most,
                    colour=(power / most).tolist(), name=name,
                )
            )  # fmt: skip
        return [each for each in lights if each.intensity > 0]


class _Problem:
    """Least squares of pictures at the points of a grid.

    `wanted` (3, N + R): the picture times `scale` (3, N + R). `regions` (R, N), each of sum 1. `pictures`
    makes those of sources; each is made once.
    """

    def __init__(
        self,
        pictures: Callable[[Sequence[_Source]], np.ndarray],
        wanted: np.ndarray,
        scale: np.ndarray,
        regions: np.ndarray,
    ) -> None:
        self.wanted, self._scale, self._regions, self._make = wanted, scale, regions, pictures
        self._numbers: dict[Key, int] = {}
        self._seen: list[np.ndarray] = []  # pictures (3, N + R) times the scale
        self._solutions: dict[tuple[int, ...], tuple[np.ndarray, float]] = {}

    def sparse_powers(self, pictures: np.ndarray, prices: np.ndarray) -> np.ndarray:
        """Return powers (D, 3) >= 0 of lights with pictures (D, 3, N), each colour for itself.

        `prices` (D,): penalty of a light's power, relative to the most that any light is worth.
        """
        from scipy.linalg import solve_triangular
        from scipy.optimize import nnls  # the import takes a tenth of a second, and few calls need it

        powers, columns = [], self._scaled(pictures)
        worths = np.einsum("cdn,cn->cd", columns, self.wanted)
        for gram, worth in zip(_products(columns), worths, strict=True):
            gram += RIDGE * max(np.trace(gram) / len(gram), 1e-30) * np.eye(len(gram))
            root = np.linalg.cholesky(gram)
            priced = worth - prices * worth.max()
            powers.append(nnls(root.T, solve_triangular(root, priced, lower=True))[0])
        return np.stack(powers, axis=1)

    def powers(self, sources: Sequence[_Source]) -> tuple[np.ndarray, np.ndarray]:
        """Return factors (K,) of the sources that are there, and the powers (M, 3) of the others."""
        found, _ = self._solved(sources)
        kept = sum(each.light is not None for each in sources)
        return found[:kept], found[kept:].reshape(-1, 3)

    def _scaled(self, pictures: np.ndarray) -> np.ndarray:
        """Return pictures (D, 3, N) with their means in the regions, times the scale: (3, D, N + R)."""
        points = len(self._scale[0]) - len(self._regions)
        scaled = np.empty((3, len(pictures), self._scale.shape[1]))
        np.multiply(pictures.transpose(1, 0, 2), self._scale[:, None, :points], out=scaled[..., :points])
        means = np.einsum("dcn,rn->cdr", pictures, self._regions)
        np.multiply(means, self._scale[:, None, points:], out=scaled[..., points:])
        return scaled

    def _numbered(self, sources: Sequence[_Source]) -> list[int]:
        """Return the numbers of sources' pictures; those that are new are made together."""
        new = {each.key: each for each in sources if each.key not in self._numbers}
        if new:
            self._numbers |= {key: len(self._numbers) + place for place, key in enumerate(new)}
            self._seen += list(self._scaled(self._make(list(new.values()))).transpose(1, 0, 2))
        return [self._numbers[each.key] for each in sources]

    def _solved(self, sources: Sequence[_Source]) -> tuple[np.ndarray, float]:
        """Return the factors and powers (K + 3 M,), and the sum of squares that is left."""
        numbers = tuple(self._numbered(sources))
        if numbers not in self._solutions:
            self._solutions[numbers] = self._solve(sources, numbers)
        return self._solutions[numbers]

    def _solve(self, sources: Sequence[_Source], numbers: Sequence[int]) -> tuple[np.ndarray, float]:
        from scipy.linalg import solve_triangular
        from scipy.optimize import nnls

        squared = float((self.wanted**2).sum())
        if not sources:
            return np.zeros(0), squared
        places, colours = _unknowns(sources)
        gram, worth = self._normal_equations(numbers, places, colours)
        damped = gram + 1e-9 * max(np.trace(gram), 1e-30) * np.eye(len(gram))
        root = np.linalg.cholesky(damped)
        found = nnls(root.T, solve_triangular(root, worth, lower=True))[0]
        return found, squared - float(found @ (2 * worth - gram @ found))

    def _normal_equations(
        self, numbers: Sequence[int], places: np.ndarray, colours: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the matrix (U, U) and the right side (U,) of least squares.

        An unknown is a factor of one of the pictures, at `places` (U,) of `numbers`, in `colours` (U, 3).
        """
        pictures = np.stack([self._seen[number] for number in numbers], axis=1)
        products = _products(pictures)[:, places[:, None], places]
        worths = np.einsum("csn,cn->cs", pictures, self.wanted)[:, places]
        return np.einsum("uc,vc,cuv->uv", colours, colours, products), np.einsum("uc,cu->u", colours, worths)

    def error(self, sources: Sequence[_Source]) -> float:
        """Return the sum of squares that is left."""
        return self._solved(sources)[1]

    def pruned(self, sources: list[_Source], count: int, useless: float) -> list[_Source]:
        """Leave out the lights that are worth least, down to `count`, and all that are worth no more than
        `useless`."""
        while sources:
            without = [[each for each in sources if each is not gone] for gone in sources]
            errors = [self.error(rest) for rest in without]
            least = int(np.argmin(errors))
            if len(sources) <= count and errors[least] - self.error(sources) > useless:
                break
            sources = without[least]
        return sources

    def refined(self, sources: list[_Source]) -> list[_Source]:
        """Move the new lights to where they explain most, and give them angles."""
        if all(each.light for each in sources):
            return sources
        error = np.inf
        for _ in range(ROUNDS):
            sources = self._moved(sources)
            for number, source in enumerate(sources):
                if source.light is None:
                    discs = [replace(source, angle=angle) for angle in sorted({*ANGLES, source.angle})]
                    self._numbered(discs)
                    tried = [[*sources[:number], disc, *sources[number + 1 :]] for disc in discs]
                    sources = min(tried, key=self.error)
            before, error = error, self.error(sources)
            if error > WORTHWHILE * before:
                break
        return self._moved(sources)

    def _moved(self, sources: list[_Source]) -> list[_Source]:
        """Search directions by damped steps of Gauss and Newton."""
        error = self.error(sources)
        for _ in range(STEPS):
            shifts = self._shifts(sources)
            for damping in DAMPINGS:
                tried = [_turned(s, damping * d) for s, d in zip(sources, shifts, strict=True)]
                found = self.error(tried)
                if found < ENOUGH * error:
                    sources, error = tried, found
                    break
            else:
                break
        return sources

    def _shifts(self, sources: Sequence[_Source]) -> list[np.ndarray]:
        """Return how far each light moves along its two tangents, radians (2,)."""
        from scipy.linalg import block_diag

        free = [place for place, each in enumerate(sources) if each.light is None]
        steps = [_turned(sources[place], along) for place in free for along in np.eye(2) * np.radians(STEP)]
        (powers, _), numbers = self._solved(sources), self._numbered([*sources, *steps])
        places, colours = _unknowns(sources)
        power = powers[len(powers) - 3 * len(free) :].reshape(-1, 3) / np.radians(STEP)
        # A derivative is a difference of pictures, so its products follow from theirs.
        rows = np.r_[len(sources) + np.arange(len(steps)), np.repeat(free, 2), places]
        slopes = np.repeat(power, 2, axis=0)
        gram, worth = self._normal_equations(numbers, rows, np.concatenate([slopes, -slopes, colours]))
        turns = np.tile(np.eye(len(slopes)), 2)
        joined = block_diag(turns, np.eye(len(places)))
        gram, worth = joined @ gram @ joined.T, joined @ worth
        left = worth - gram[:, len(slopes) :] @ powers
        gram += DAMPED * np.trace(gram) / len(gram) * np.eye(len(gram))
        solved = np.linalg.solve(gram, left)
        shifts = [np.zeros(2) for _ in sources]
        for place, turn in zip(free, solved[: len(slopes)].reshape(-1, 2), strict=True):
            shifts[place] = turn * min(1.0, np.radians(LONGEST) / max(float(np.hypot(*turn)), 1e-12))
        return shifts


def _unknowns(sources: Sequence[_Source]) -> tuple[np.ndarray, np.ndarray]:
    """Return whose each unknown is (K + 3 M,), and of which colours (K + 3 M, 3).

    First come the factors of lights that are there, then the powers of the others, colour by colour.
    """
    kept = [number for number, each in enumerate(sources) if each.light is not None]
    free = [number for number, each in enumerate(sources) if each.light is None]
    colours = np.concatenate([np.ones((len(kept), 3)), np.tile(np.eye(3), (len(free), 1))])
    return np.array([*kept, *np.repeat(free, 3)], dtype=int), colours


def _freed(source: _Source) -> _Source:
    """Return a directional light that is there as one that may move and change its colour."""
    if not isinstance(source.light, DirectionalLight):
        return source
    return _Source(np.array(source.light.direction), source.light.angle)


def _turned(source: _Source, shift: np.ndarray) -> _Source:
    """Return a source turned along its two tangents, radians (2,)."""
    if source.light is not None or not shift.any():
        return source
    return replace(source, direction=_unit(source.direction + shift @ source.tangents))


def _clusters(directions: np.ndarray, energy: np.ndarray, count: int) -> list[tuple[np.ndarray, float]]:
    """Merge directions (D, 3) to axes with their energies, the strongest first.

    Neighbours within MERGED degrees are merged, then those pairs that lose least, down to `count`.
    """
    found = [(axis.astype(float), float(part)) for axis, part in zip(directions, energy, strict=True)]

    def loss(one: int, other: int) -> tuple[bool, float]:
        (a, p), (b, q) = found[one], found[other]
        return _apart(a, b) >= MERGED, p * q / (p + q) * (1 - float(a @ b))

    while len(found) > 1:
        pairs = [(*loss(i, j), i, j) for i in range(len(found)) for j in range(i)]
        far, _, i, j = min(pairs)
        if far and len(found) <= count:
            break
        (a, p), (b, q) = found[i], found[j]
        found[j] = (_unit(p * a + q * b), p + q)
        found.pop(i)
    return sorted(found, key=lambda each: -each[1])


def _names(free: Sequence[_Source], gone: Sequence[Light], taken: set[str | None]) -> list[str]:
    """Return a name for each new light: that of the nearest light that it replaces, or paint1, paint2..."""
    from scipy.optimize import linear_sum_assignment

    named = [each for each in gone if isinstance(each, DirectionalLight) and each.name]
    apart = np.array([[_apart(s.direction, np.array(g.direction)) for g in named] for s in free])
    names: dict[int, str] = {}
    if apart.size:
        for place, light in zip(*linear_sum_assignment(apart), strict=True):
            names[int(place)] = named[light].name or ""
    fresh = (name for k in range(1, len(free) + len(taken) + 2) if (name := f"paint{k}") not in taken)
    return [names.get(place) or next(fresh) for place in range(len(free))]


def _products(pictures: np.ndarray) -> np.ndarray:
    """Return the products (3, A, A) of pictures (3, A, N) with each other, of each colour."""
    columns = torch.from_numpy(pictures)
    return (columns @ columns.mT).numpy()


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    """Return the angle between unit vectors in degrees."""
    return float(np.degrees(np.arccos(np.clip(one @ other, -1, 1))))


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)
