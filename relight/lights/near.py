"""Lights that stand in the room: each point of the person has its own direction to them, and distance.

Positions are metres in the camera's axes, from the subject's middle (see `relight.depth`). The lights are
those of UsdLux, SphereLight and RectLight. Their intensity is the irradiance on a surface that faces them
from one metre; it falls off with the square of the distance.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F

from relight.lights.light import Light, checked_number, checked_numbers

SAMPLES = 16  # points over a light that has a size
LARGEST = 1e6  # metres, of a position
SMALLEST = 1e-4  # metres, of a side
GOLDEN = (math.sqrt(5) - 1) / 2

# Unit directions (3, ...) to the light, and the irradiance (...) that comes from there at intensity 1 on a
# surface that faces it.
Rays = tuple[torch.Tensor, torch.Tensor]


@dataclass(frozen=True, init=False)
class NearLight(Light):
    """What lights in the room have in common."""

    position: tuple[float, float, float]

    def settings(self) -> dict[str, Any]:
        """{parameter: value} of the constructor, as far as they are not its defaults."""
        return {"position": self.position} | super().settings()

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """TypeError: the directions to the light differ from pixel to pixel."""
        raise TypeError(
            f"lights: {self.name or 'a light'} stands in the room and has no direction of its own"
        )

    @property
    def reach(self) -> float:
        """Metres around its points that the light fills."""
        return 0.0

    @property
    def points(self) -> np.ndarray:
        """(K, 3) metres: where it shines from, or the middle of that."""
        return np.array([self.position])

    def rays(self, positions: torch.Tensor) -> Iterator[Rays]:
        """From surface points (3, ...), metres, to parts of the light, one after the other."""
        raise NotImplementedError


@dataclass(frozen=True, init=False)
class PointLight(NearLight):
    """A lamp in the room: a point, or a sphere, as UsdLux's SphereLight.

    Parameters
    ----------
    position: (x, y, z) metres, camera axes, from the subject's middle.
    radius: metres, of a sphere that shines evenly: larger is softer, and no brighter.
    intensity: >= 0. At 1, a white surface that faces the lamp from one metre has the value 1; from two, 1/4.
    colour, exposure, temperature, locus, name: as of `relight.DirectionalLight`.

    Raises
    ------
    TypeError, ValueError: not numbers, NaN or infinite, out of range.
    """

    radius: float

    def __init__(
        self,
        position: Iterable[float],
        *,
        radius: float = 0.0,
        intensity: float = 1.0,
        colour: Iterable[float] = (1.0, 1.0, 1.0),
        exposure: float = 0.0,
        temperature: float | None = None,
        locus: str = "planckian",
        name: str | None = None,
    ) -> None:
        self._set(
            position=_position("position", position),
            radius=checked_number("radius", radius, 0, LARGEST),
            intensity=intensity,
            colour=colour,
            exposure=exposure,
            temperature=temperature,
            locus=locus,
            name=name,
        )

    @property
    def reach(self) -> float:
        return self.radius

    def rays(self, positions: torch.Tensor) -> Iterator[Rays]:
        """One ray to a point. Of a sphere as many as SAMPLES, over the cap that a surface point sees of it,
        in equal steps along its axis, which are equal solid angles (Archimedes)."""
        axis, squared = _toward(self.position, positions)
        if self.radius == 0:
            yield axis, 1 / squared
            return
        aside = F.normalize(torch.cross(axis, _across(self.position, axis), dim=0), dim=0)
        other = torch.cross(axis, aside, dim=0)
        depth = 1 - (1 - self.radius**2 / squared).clamp_min(0).sqrt()  # of the cap, on the unit sphere
        steps = [(step + 0.5) / SAMPLES for step in range(SAMPLES)]
        irradiance = 1 / (squared * sum(1 - depth * step for step in steps))
        for number, step in enumerate(steps):
            along, angle = 1 - depth * step, 2 * math.pi * GOLDEN * number
            around = aside * math.cos(angle) + other * math.sin(angle)
            yield axis * along + around * (1 - along**2).clamp_min(0).sqrt(), irradiance


@dataclass(frozen=True, init=False)
class RectLight(NearLight):
    """A softbox or window in the room, as UsdLux's RectLight: it shines to one side, evenly.

    Parameters
    ----------
    position: (x, y, z) of its middle, metres, camera axes, from the subject's middle.
    toward: (x, y, z) of a point that it faces, metres.
    width, height: metres, above zero. The width runs level (to image right, if it faces straight up or down).
    intensity: >= 0. At 1, a white surface one metre before its middle, and facing it, has the value 1, were
        the light small; larger ones give as much from far away.
    colour, exposure, temperature, locus, name: as of `relight.DirectionalLight`.

    Raises
    ------
    TypeError, ValueError: not numbers, NaN or infinite, out of range, no size, `toward` where it stands.
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
        intensity: float = 1.0,
        colour: Iterable[float] = (1.0, 1.0, 1.0),
        exposure: float = 0.0,
        temperature: float | None = None,
        locus: str = "planckian",
        name: str | None = None,
    ) -> None:
        place, target = _position("position", position), _position("toward", toward)
        if math.dist(place, target) < SMALLEST:
            raise ValueError("toward: is where the light stands; expected a point that it faces")
        self._set(
            position=place,
            toward=target,
            width=checked_number("width", width, SMALLEST, LARGEST),
            height=checked_number("height", height, SMALLEST, LARGEST),
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
        """(3,) the unit vector along which it shines."""
        along = np.subtract(self.toward, self.position)
        return along / np.linalg.norm(along)

    @property
    def points(self) -> np.ndarray:
        """(SAMPLES, 3) over the rectangle: a golden-ratio lattice, evenly spread on both of its sides."""
        right = np.cross(self.axis, (0.0, 1.0, 0.0))
        length = np.linalg.norm(right)
        right = right / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
        up = np.cross(right, self.axis)
        number = np.arange(SAMPLES)
        across = self.width * ((number + 0.5) / SAMPLES - 0.5)
        along = self.height * ((number + 0.5) * GOLDEN % 1 - 0.5)
        return np.array(self.position) + across[:, None] * right + along[:, None] * up

    def rays(self, positions: torch.Tensor) -> Iterator[Rays]:
        """A ray to each of `points`, which shine by the cosine to `axis`."""
        axis = torch.from_numpy(self.axis).to(positions)
        for point in self.points:
            directions, squared = _toward(point, positions)
            facing = -torch.einsum("c,c...->...", axis, directions)
            yield directions, facing.clamp_min(0) / (squared * SAMPLES)


def _position(name: str, value: Iterable[float]) -> tuple[float, ...]:
    """Three finite metres."""
    numbers = checked_numbers(name, value, 3)
    if max(map(abs, numbers)) > LARGEST:
        raise ValueError(f"{name}: expected at most {LARGEST:g} metres, got {numbers}")
    return numbers


def _toward(point: Any, positions: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Unit directions (3, ...) from positions (3, ...) to a point (3,), and the squares of the distances."""
    ways = torch.tensor(np.asarray(point, np.float32)).view(3, *[1] * (positions.ndim - 1)) - positions
    squared = (ways**2).sum(dim=0).clamp_min(SMALLEST**2)
    return ways / squared.sqrt(), squared


def _across(position: tuple[float, ...], like: torch.Tensor) -> torch.Tensor:
    """The axis (3, ...) that the way to a light turns from most, the same for all pixels."""
    axis = torch.zeros(3, *[1] * (like.ndim - 1))
    axis[int(np.argmin(np.abs(position)))] = 1
    return axis.expand_as(like)
