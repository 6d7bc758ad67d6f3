"""A light so far away that its rays are parallel."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from relight.lights.light import Light, checked_number, checked_numbers
from shadow.directions import from_spherical, to_spherical

SOFT_SAMPLES = 32  # directions over the disc of a soft light


@dataclass(frozen=True, init=False)
class DirectionalLight(Light):
    """A light so far away that its rays are parallel, as UsdLux's DistantLight.

    Parameters
    ----------
    direction: (x, y, z) from the subject *to* the light, camera frame, any length but zero; or
    azimuth, elevation: degrees. Azimuth turns from the camera (0) toward image right (90), so -40 is a light
        at image left; elevation rises from the horizon (0) to overhead (90). Each is 0 unless given.
    intensity: >= 0. At 1, a white surface that faces the light has the value 1.
    colour: linear Rec.709, each >= 0.
    exposure: stops; doubles the light for each.
    temperature: kelvin, or None for no tint: multiplies `colour` at luminance 1.
    locus: what is that hot: "planckian", a black body, [1000, 40000] K (lamps, candles, the sun); or
        "daylight", CIE daylight, [4000, 25000] K, where 6504 K is white (D65).
    angle: angular diameter in degrees, [0, 180]: 0 is a hard light; the sun has 0.53; softboxes, tens.
    name: names the light's layer.

    Raises
    ------
    TypeError, ValueError: not numbers, NaN or infinite, out of range, a zero-length direction, or both
    `direction` and `azimuth` or `elevation`.
    """

    direction: tuple[float, float, float]
    angle: float

    def __init__(
        self,
        direction: Iterable[float] | None = None,
        *,
        azimuth: float | None = None,
        elevation: float | None = None,
        intensity: float = 1.0,
        colour: Iterable[float] = (1.0, 1.0, 1.0),
        exposure: float = 0.0,
        temperature: float | None = None,
        locus: str = "planckian",
        angle: float = 0.0,
        name: str | None = None,
    ) -> None:
        if direction is None:
            azimuth = checked_number("azimuth", 0.0 if azimuth is None else azimuth)
            elevation = checked_number("elevation", 0.0 if elevation is None else elevation, -90, 90)
            direction = from_spherical(azimuth, elevation)
        elif azimuth is not None or elevation is not None:
            raise ValueError("direction: give either a direction or an azimuth and elevation, not both")
        vector = checked_numbers("direction", direction, 3)
        largest = max(map(abs, vector))
        if largest < 1e-6:
            raise ValueError("direction: has zero length")
        vector = tuple(component / largest for component in vector)  # its square may be beyond any float
        length = math.hypot(*vector)
        self._set(
            direction=tuple(component / length for component in vector),
            angle=checked_number("angle", angle, 0, 180),
            intensity=intensity,
            colour=colour,
            exposure=exposure,
            temperature=temperature,
            locus=locus,
            name=name,
        )

    @property
    def azimuth(self) -> float:
        """Degrees in [-180, 180], from the camera toward image right."""
        return float(to_spherical(self.direction)[0])

    @property
    def elevation(self) -> float:
        """Degrees in [-90, 90], up from the horizon."""
        return float(to_spherical(self.direction)[1])

    def settings(self) -> dict[str, Any]:
        """{parameter: value} of the constructor, as far as they are not its defaults.

        The direction as azimuth and elevation, rounded to 1e-4 degrees: exact for lights made from those.
        """
        settings = super().settings()
        del settings["direction"]
        return settings | {"azimuth": round(self.azimuth, 4), "elevation": round(self.elevation, 4)}

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """What the light comes down to: unit directions (K, 3) and linear RGB intensities (K, 3), float32.

        K is 1 for a hard light and 32 for a soft one. A soft light gives an unoccluded surface that faces
        it the same irradiance as the hard light, as UsdLux's `normalize` does.
        """
        axis = np.array(self.direction)
        directions = axis[None] if self.angle == 0 else _cap(axis, self.angle / 2)
        intensities = np.broadcast_to(self.power / (directions @ axis).sum(), directions.shape)
        with np.errstate(over="ignore"):  # what becomes infinite is refused where the light is used
            return directions.astype(np.float32), intensities.astype(np.float32)


def _cap(axis: np.ndarray, radius: float) -> np.ndarray:
    """Directions (SOFT_SAMPLES, 3) over the spherical cap within `radius` degrees of `axis`.

    A golden-angle spiral in equal steps along the axis, which are equal areas of the sphere (Archimedes):
    stratified, and the same each time.
    """
    step = np.arange(SOFT_SAMPLES)
    along = 1 - (1 - math.cos(math.radians(radius))) * (step + 0.5) / SOFT_SAMPLES
    angle = math.pi * (3 - math.sqrt(5)) * step
    across = np.sqrt(1 - along**2)
    aside = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    aside /= np.linalg.norm(aside)
    frame = np.stack([aside, np.cross(axis, aside), axis])
    return np.stack([across * np.cos(angle), across * np.sin(angle), along], axis=-1) @ frame
