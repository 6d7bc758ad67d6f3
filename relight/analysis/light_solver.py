"""Few lights in which a person looks as wanted: non-negative least squares, merging, and a search nearby.

A picture is a sum of lights, so the powers of given lights follow from least squares (Lawson and Hanson
1974). Candidates are the lights that are there and 96 hard lights from all around. A penalty on the sum of
the powers (Tibshirani 1996) keeps few of these; neighbours are merged. Their directions and angles are
refined by Gauss and Newton's method, in which the powers follow at each step (Golub and Pereyra 1973).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from relight.analysis.light_field import ANCHORS
from relight.analysis.light_grid import LightGrid
from relight.lights.directional import DirectionalLight
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

    def pictures(self, grid: LightGrid) -> np.ndarray:
        """Return the picture (3, N) of a power of 1, or of the light as it is."""
        if self.light is not None:
            return grid.picture(self.light).double().numpy()
        return grid.picture(_directional(self.direction, self.angle)).double().numpy()


def _directional(direction: np.ndarray, angle: float) -> DirectionalLight:
    return DirectionalLight(direction.tolist(), angle=angle)


class LightSolver:
    """Solves for lights of one person, starting from those that are there.

    What does not depend on the wanted picture is computed once.
    """

    def __init__(self, grid: LightGrid, current: Sequence[Light]) -> None:
        self._grid, self._current = grid, list(current)
        self._anchors = grid.pictures(ANCHORS).double().numpy()
        own = [grid.picture(light).double().numpy() for light in self._current]
        self._own = np.stack(own) if own else np.zeros((0, *self._anchors.shape[1:]))

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
        problem = _Problem(self._grid, wanted * scale, scale, regions)
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


@dataclass(frozen=True)
class _Problem:
    """Least squares of pictures at the points of a grid."""

    grid: LightGrid
    wanted: np.ndarray  # (3, N + R) times `scale`
    scale: np.ndarray  # (3, N + R)
    regions: np.ndarray  # (R, N), each of sum 1
    _seen: dict[Key, np.ndarray] = field(default_factory=dict)
    _products: dict[tuple[Key, Key], np.ndarray] = field(default_factory=dict)
    _worths: dict[Key, np.ndarray] = field(default_factory=dict)

    def with_means(self, pictures: np.ndarray) -> np.ndarray:
        """Return values (..., N) at the points, and their means in the regions behind them (..., N + R)."""
        return np.concatenate([pictures, pictures @ self.regions.T], axis=-1)

    def sparse_powers(self, pictures: np.ndarray, prices: np.ndarray) -> np.ndarray:
        """Return powers (D, 3) >= 0 of lights with pictures (D, 3, N), each colour for itself.

        `prices` (D,): penalty of a light's power, relative to the most that any light is worth.
        """
        from scipy.linalg import solve_triangular
        from scipy.optimize import nnls  # the import takes a tenth of a second, and few calls need it

        powers = []
        for colour in range(3):
            columns = self.with_means(pictures[:, colour]) * self.scale[colour]
            gram, worth = columns @ columns.T, columns @ self.wanted[colour]
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

    def _picture(self, source: _Source) -> np.ndarray:
        """Return what a power of 1 of a source adds to the picture (3, N + R) times `scale`."""
        key = source.key
        if key not in self._seen:
            self._seen[key] = self.with_means(source.pictures(self.grid)) * self.scale
        return self._seen[key]

    def _product(self, one: _Source, other: _Source) -> np.ndarray:
        """Return the sums (3,) of the products of two sources' pictures, of each colour."""
        key = (one.key, other.key)
        if key not in self._products:
            product = (self._picture(one) * self._picture(other)).sum(axis=1)
            self._products[key] = self._products[key[::-1]] = product
        return self._products[key]

    def _worth(self, source: _Source) -> np.ndarray:
        """Return the sums (3,) of the products of a source's picture and the wanted one."""
        if source.key not in self._worths:
            self._worths[source.key] = (self._picture(source) * self.wanted).sum(axis=1)
        return self._worths[source.key]

    def _solved(self, sources: Sequence[_Source]) -> tuple[np.ndarray, float]:
        """Return the factors and powers (K + 3 M,), and the sum of squares that is left."""
        from scipy.linalg import solve_triangular
        from scipy.optimize import nnls

        squared = float((self.wanted**2).sum())
        if not sources:
            return np.zeros(0), squared
        owners, colours = _unknowns(sources)
        products = np.array([[self._product(a, b) for b in sources] for a in sources])[owners][:, owners]
        gram = np.einsum("uc,vc,uvc->uv", colours, colours, products)
        worth = (colours * np.array([self._worth(each) for each in sources])[owners]).sum(axis=1)
        damped = gram + 1e-9 * max(np.trace(gram), 1e-30) * np.eye(len(gram))
        root = np.linalg.cholesky(damped)
        found = nnls(root.T, solve_triangular(root, worth, lower=True))[0]
        return found, squared - float(found @ (2 * worth - gram @ found))

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
                    tried = [
                        [*sources[:number], replace(source, angle=angle), *sources[number + 1 :]]
                        for angle in sorted({*ANGLES, source.angle})
                    ]
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
        kept = sum(each.light is not None for each in sources)
        (powers, _), step = self._solved(sources), np.radians(STEP)
        columns: list[np.ndarray] = []
        owners: list[int] = []
        for number, source in enumerate(sources):
            if source.light is not None:
                continue
            power = powers[kept + 3 * len(owners) : kept + 3 * len(owners) + 3]
            for along in np.eye(2) * step:
                change = self._picture(_turned(source, along)) - self._picture(source)
                columns.append((power[:, None] * change).ravel() / step)
            owners.append(number)
        places, colours = _unknowns(sources)
        pictures = np.array([self._picture(each) for each in sources])[places]
        own = (colours[:, :, None] * pictures).reshape(len(places), -1)
        every = np.concatenate([np.array(columns), own])
        gram = every @ every.T
        gram += DAMPED * np.trace(gram) / len(gram) * np.eye(len(gram))
        solved = np.linalg.solve(gram, every @ (self.wanted.ravel() - powers @ own))
        shifts = [np.zeros(2) for _ in sources]
        for place, number in enumerate(owners):
            turn = solved[2 * place : 2 * place + 2]
            shifts[number] = turn * min(1.0, np.radians(LONGEST) / max(float(np.hypot(*turn)), 1e-12))
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
    axis = source.direction
    aside = _unit(np.cross(axis, np.eye(3)[np.abs(axis).argmin()]))
    return replace(source, direction=_unit(axis + shift[0] * aside + shift[1] * np.cross(axis, aside)))


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


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    """Return the angle between unit vectors in degrees."""
    return float(np.degrees(np.arccos(np.clip(one @ other, -1, 1))))


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)
