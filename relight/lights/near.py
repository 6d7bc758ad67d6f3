"""Near lights: each point of the person has its own direction to them, and distance.

Positions are metres in the camera's axes, from the subject's middle (see `relight.analysis.camera`). The
lights are those of UsdLux, SphereLight and RectLight. Their intensity is the irradiance of a surface that
faces them from one metre, and it falls off with the square of the distance.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F

from relight.lights.light import Light, checked_number, checked_numbers
from relight.lights.spherical_rectangle import SphericalRectangle

SAMPLE_COUNT = 16  # over a light that has a size
MAX_METRES = 1e6  # of a position or a size
MIN_METRES = 1e-4  # of a side, and of the distance to a light
FULL_CONE, HALF_CONE = 180.0, 90.0  # degrees from the axis to which a lamp, and a rectangle, shines
MIN_CONE = 1e-4  # degrees
GOLDEN = (math.sqrt(5) - 1) / 2

# Unit directions (3, ...) to the light, and the irradiance (...) from there, at intensity 1, of a
# surface that faces it.
Rays = tuple[torch.Tensor, torch.Tensor]


@dataclass(frozen=True, init=False)
class NearLight(Light):
    """What near lights have in common."""

    position: tuple[float, float, float]
    cone: float
    softness: float

    def settings(self) -> dict[str, Any]:
        """Return {parameter: value} of the constructor, without those that have their defaults."""
        return {"position": self.position} | super().settings()

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Raise TypeError: the directions to a near light differ from pixel to pixel."""
        raise TypeError(
            f"lights: {self.name or 'a light'} is a near light, which has no single direction; see `rays`"
        )

    @property
    def extent(self) -> float:
        """Metres around each of `points` that the light fills."""
        return 0.0

    @property
    def points(self) -> np.ndarray:
        """(K, 3) metres: points that shine, or the centre of a sphere."""
        return np.array([self.position])

    @property
    def axis(self) -> np.ndarray:
        """The unit vector (3,) along which it shines."""
        raise NotImplementedError

    @property
    def has_cone(self) -> bool:
        """Whether a cone blocks some of its light."""
        return False

    def rays(self, positions: torch.Tensor) -> Iterator[Rays]:
        """Yield the rays from surface points (3, ...), metres, to one sample of the light after the other."""
        raise NotImplementedError

    def cone_transmission(self, cosines: torch.Tensor) -> torch.Tensor:
        """Return the share of the light that leaves the cone at an angle from its axis, in [0, 1].

        `cosines` (...) are those of the angle. The cone's edge is UsdLux's: a smooth step from
        `cone * (1 - softness)` to `cone`.
        """
        angles = torch.rad2deg(torch.acos(cosines.clamp(-1, 1)))
        if self.softness == 0:
            return (angles <= self.cone).float()
        step = ((self.cone - angles) / (self.cone * self.softness)).clamp(0, 1)
        return step * step * (3 - 2 * step)


@dataclass(frozen=True, init=False)
class PointLight(NearLight):
    """A lamp near the person: a point or a sphere, like UsdLux's SphereLight; a spotlight if it has a cone.

    Parameters
    ----------
    position
        (x, y, z) in metres from the subject's middle, along the axes of the camera.
    radius
        Radius in metres, in [0, 1e6], of a uniformly bright sphere. A larger sphere is softer, not brighter.
    toward
        (x, y, z) in metres of a point that a spotlight faces.
    cone
        Angle in degrees from a spotlight's axis, in (0, 180], beyond which there is no light; 180 is no cone.
    softness
        Share of the cone, in [0, 1], over which the light fades to its edge.
    intensity
        At least 0. At 1, a white surface that faces the lamp has the value 1 at one metre, 1/4 at two.
    colour, exposure, temperature, locus, name
        See `relight.DirectionalLight`.

    Raises
    ------
    TypeError, ValueError
        Not numbers, NaN or infinite, out of range; a cone without a point that it faces.

    Examples
    --------
    >>> import relight
    >>> lamp = relight.PointLight((-0.6, 0.4, 0.8), radius=0.1, temperature=3200)
    >>> lamp.position
    (-0.6, 0.4, 0.8)
    """

    radius: float
    toward: tuple[float, float, float] | None

    def __init__(
        self,
        position: Iterable[float],
        *,
        radius: float = 0.0,
        toward: Iterable[float] | None = None,
        cone: float = FULL_CONE,
        softness: float = 0.0,
        intensity: float = 1.0,
        colour: Iterable[float] = (1.0, 1.0, 1.0),
        exposure: float = 0.0,
        temperature: float | None = None,
        locus: str = "planckian",
        name: str | None = None,
    ) -> None:
        place = _position("position", position)
        if toward is None and cone != FULL_CONE:
            raise ValueError("toward: is missing; expected a point that the cone faces")
        self._set(
            position=place,
            radius=checked_number("radius", radius, 0, MAX_METRES),
            toward=None if toward is None else _target(place, toward),
            cone=checked_number("cone", cone, MIN_CONE, FULL_CONE),
            softness=checked_number("softness", softness, 0, 1),
            intensity=intensity,
            colour=colour,
            exposure=exposure,
            temperature=temperature,
            locus=locus,
            name=name,
        )

    @property
    def extent(self) -> float:
        return self.radius

    @property
    def axis(self) -> np.ndarray:
        """The unit vector (3,) along which a spotlight shines."""
        if self.toward is None:
            return np.array([0.0, 0.0, -1.0])
        return _unit(np.subtract(self.toward, self.position))

    @property
    def has_cone(self) -> bool:
        return self.cone < FULL_CONE

    def rays(self, positions: torch.Tensor) -> Iterator[Rays]:
        """Yield one ray to a point, or SAMPLE_COUNT rays to a sphere, within the cone."""
        for directions, irradiance in self._rays(positions):
            if self.has_cone:
                irradiance = irradiance * self.cone_transmission(-_dot(self.axis, directions))
            yield directions, irradiance

    def _rays(self, positions: torch.Tensor) -> Iterator[Rays]:
        """Yield one ray to a point, or SAMPLE_COUNT rays to a sphere.

        A surface point sees a sphere as a cap of directions. The samples are in equal steps along the cap's
        axis, which are equal solid angles (Archimedes).
        """
        axis, squared = _toward(self.position, positions)
        if self.radius == 0:
            yield axis, 1 / squared
            return
        aside = F.normalize(torch.cross(axis, _aside(self.position, axis), dim=0), dim=0)
        other = torch.cross(axis, aside, dim=0)
        depth = 1 - (1 - self.radius**2 / squared).clamp_min(0).sqrt()  # of the cap, on the unit sphere
        steps = [(step + 0.5) / SAMPLE_COUNT for step in range(SAMPLE_COUNT)]
        irradiance = 1 / (squared * sum(1 - depth * step for step in steps))
        for number, step in enumerate(steps):
            along, angle = 1 - depth * step, 2 * math.pi * GOLDEN * number
            around = aside * math.cos(angle) + other * math.sin(angle)
            yield axis * along + around * (1 - along**2).clamp_min(0).sqrt(), irradiance


@dataclass(frozen=True, init=False)
class RectLight(NearLight):
    """A softbox or window near the person, like UsdLux's RectLight: one side is uniformly bright.

    Parameters
    ----------
    position
        (x, y, z) of its centre, in metres from the subject's middle, along the axes of the camera.
    toward
        (x, y, z) in metres of a point that it faces.
    width, height
        Metres, in [0.0001, 1e6]. The width is horizontal (to image right, if it faces straight up or down).
    cone, softness
        See `relight.PointLight`; a flat light shines up to 90 degrees from its axis.
    intensity
        At least 0. At 1, a small light gives the value 1 to a white surface that faces it at one metre. From
        far away, a large light is as bright as a small one.
    colour, exposure, temperature, locus, name
        See `relight.DirectionalLight`.

    Raises
    ------
    TypeError, ValueError
        Not numbers, NaN or infinite, out of range, no size, `toward` at `position`.

    Examples
    --------
    >>> import relight
    >>> softbox = relight.RectLight((-1.5, 0.5, 2), toward=(0, 0, 0), width=0.6, height=1.2, intensity=4)
    >>> softbox.axis.round(2).tolist()  # the direction in which it shines
    [0.59, -0.2, -0.78]
    """

    toward: tuple[float, float, float]
    width: float
    height: float

    def __init__(
        self,
        position: Iterable[float],
        toward: Iterable[float],
        width: float,
        height: float,
        *,
        cone: float = HALF_CONE,
        softness: float = 0.0,
        intensity: float = 1.0,
        colour: Iterable[float] = (1.0, 1.0, 1.0),
        exposure: float = 0.0,
        temperature: float | None = None,
        locus: str = "planckian",
        name: str | None = None,
    ) -> None:
        place = _position("position", position)
        self._set(
            position=place,
            toward=_target(place, toward),
            cone=checked_number("cone", cone, MIN_CONE, HALF_CONE),
            softness=checked_number("softness", softness, 0, 1),
            width=checked_number("width", width, MIN_METRES, MAX_METRES),
            height=checked_number("height", height, MIN_METRES, MAX_METRES),
            intensity=intensity,
            colour=colour,
            exposure=exposure,
            temperature=temperature,
            locus=locus,
            name=name,
        )

    def settings(self) -> dict[str, Any]:
        shape = {"toward": self.toward, "width": self.width, "height": self.height}
        return {"position": self.position} | shape | super().settings()

    @property
    def axis(self) -> np.ndarray:
        """The unit vector (3,) along which it shines."""
        return _unit(np.subtract(self.toward, self.position))

    @property
    def has_cone(self) -> bool:
        return self.cone < HALF_CONE or self.softness > 0

    @property
    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors (3,) along its width and along its height."""
        right = np.cross(self.axis, (0.0, 1.0, 0.0))
        length = np.linalg.norm(right)
        right = right / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
        return right, np.cross(right, self.axis)

    @property
    def points(self) -> np.ndarray:
        """Points (SAMPLE_COUNT, 3) of a golden-ratio lattice, uniform along both sides of the rectangle."""
        right, up = self.sides
        u, v = _lattice().T - 0.5
        return np.array(self.position) + self.width * u[:, None] * right + self.height * v[:, None] * up

    def rays(self, positions: torch.Tensor) -> Iterator[Rays]:
        """Yield SAMPLE_COUNT rays of equal solid angle, seen from a surface point.

        The irradiance is then correct at any distance. Samples of equal area would be too sparse close to the
        light.
        """
        axes = torch.from_numpy(np.stack([*self.sides, self.axis]))
        centre = torch.tensor(self.position, dtype=torch.float64).view(3, *[1] * (positions.ndim - 1))
        x, y, z = torch.einsum("lc,c...->l...", axes, centre - positions.double())
        rectangle = SphericalRectangle(x, y, self.width, self.height, -z.abs().clamp_min(MIN_METRES))
        share = rectangle.solid_angle / (self.width * self.height * SAMPLE_COUNT)
        irradiance = share.masked_fill(z >= 0, 0).to(positions)  # nothing shines behind the light's plane
        for u, v in _lattice().tolist():
            directions = torch.einsum("lc,l...->c...", axes, rectangle.sample(u, v))
            directions = F.normalize(directions, dim=0).to(positions)
            if self.has_cone:
                transmission = self.cone_transmission(-_dot(self.axis, directions))
                yield directions, irradiance * transmission
            else:
                yield directions, irradiance


def _lattice() -> np.ndarray:
    """Return (SAMPLE_COUNT, 2) points, evenly spread over the unit square: a golden-ratio lattice."""
    number = np.arange(SAMPLE_COUNT)
    return np.stack([(number + 0.5) / SAMPLE_COUNT, (number + 0.5) * GOLDEN % 1], axis=1)


def _position(name: str, value: Iterable[float]) -> tuple[float, ...]:
    """Return three finite numbers, metres."""
    numbers = checked_numbers(name, value, 3)
    if max(map(abs, numbers)) > MAX_METRES:
        raise ValueError(f"{name}: expected at most {MAX_METRES:g} metres, got {numbers}")
    return numbers


def _target(place: tuple[float, ...], value: Iterable[float]) -> tuple[float, ...]:
    """Return the point, metres, that a light at `place` faces."""
    target = _position("toward", value)
    if math.dist(place, target) < MIN_METRES:
        raise ValueError("toward: is where the light stands; expected a point that it faces")
    return target


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _dot(axis: np.ndarray, directions: torch.Tensor) -> torch.Tensor:
    """Return the dot products (...) of an axis (3,) with directions (3, ...)."""
    return torch.einsum("c,c...->...", torch.from_numpy(axis).to(directions), directions)


def _toward(point: Any, positions: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return unit directions (3, ...) from positions (3, ...) to a point (3,), and the squared distances."""
    vectors = torch.tensor(np.asarray(point, np.float32)).view(3, *[1] * (positions.ndim - 1)) - positions
    squared = (vectors**2).sum(dim=0).clamp_min(MIN_METRES**2)
    return vectors / squared.sqrt(), squared


def _aside(position: tuple[float, ...], like: torch.Tensor) -> torch.Tensor:
    """Return the axis (3, ...) farthest from the direction to a light, the same for all pixels."""
    axis = torch.zeros(3, *[1] * (like.ndim - 1))
    axis[int(np.argmin(np.abs(position)))] = 1
    return axis.expand_as(like)
