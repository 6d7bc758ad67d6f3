"""A light so far away that its rays are parallel."""

import math
from dataclasses import dataclass

import numpy as np

from relight import quantities
from relight.arguments import checked, required
from relight.lights.light import DistantLight
from shadow.directions import from_spherical, to_spherical

SOFT_SAMPLE_COUNT = 32  # directions over the disc of a soft light


@dataclass(frozen=True, init=False)
class DirectionalLight(DistantLight):
    """A light so far away that its rays are parallel, like UsdLux's DistantLight.

    Parameters
    ----------
    direction
        (x, y, z) from the subject *to* the light, in the camera frame, of any length but zero. It replaces
        azimuth and elevation.
    azimuth
        Degrees from the camera (0) toward image right (90), so -40 is a light at image left; 0 by default.
    elevation
        Degrees from the horizon (0) to overhead (90); 0 by default.
    intensity
        At least 0. At 1, a white surface that faces the light has the value 1.
    colour
        Linear Rec.709, each >= 0.
    exposure
        Stops, in [-64, 64]; each doubles the light.
    temperature
        Kelvin, or None for no tint: multiplies `colour` at luminance 1.
    locus
        The colours of temperatures: "planckian", a black body, in [1000, 40000] K (lamps, candles, the sun);
        or "daylight", CIE daylight, in [4000, 25000] K, where 6504 K is white (D65).
    tint
        Distance of the colour from a black body's in CIE 1960 (Duv), in [-0.05, 0.05]: positive is greener,
        negative more magenta. It needs a temperature or a source.
    source
        A lamp by name, in place of a temperature: "tungsten", "hmi", "led"..., see
        `relight.media.lamp_colours.LAMPS`.
    gel
        Gels before the lamp, by LEE's or Rosco's numbers: "L201", or "L201+L216". They take light away.
        Extra `gels`.
    angle
        Angular diameter in degrees, in [0, 180]: 0 is a hard light, the sun has 0.53, softboxes have tens.
    name
        Name of the light's layer.

    Raises
    ------
    TypeError, ValueError
        Not numbers, NaN or infinite, out of range, a zero-length direction, or both `direction` and `azimuth`
        or `elevation`.

    Examples
    --------
    >>> import relight
    >>> sun = relight.DirectionalLight(azimuth=-40, elevation=30, angle=0.53, temperature=5600)
    >>> round(sun.azimuth), round(sun.elevation)
    (-40, 30)
    """

    direction: quantities.Direction = required()
    angle: quantities.Diameter = 0.0

    def __init__(
        self,
        direction: quantities.GivenDirection | None = None,
        *,
        azimuth: quantities.Azimuth | None = None,
        elevation: quantities.Elevation | None = None,
        angle: quantities.Diameter = 0.0,
        intensity: quantities.Intensity = 1.0,
        colour: quantities.GivenColour = quantities.WHITE,
        exposure: quantities.Exposure = 0.0,
        temperature: quantities.Temperature = None,
        locus: quantities.Locus = "planckian",
        tint: quantities.Tint = 0.0,
        source: quantities.LampName = None,
        gel: quantities.Gels = None,
        name: quantities.Name = None,
    ) -> None:
        if direction is None:
            azimuth = checked("azimuth", 0.0 if azimuth is None else azimuth, quantities.Azimuth)
            elevation = checked("elevation", 0.0 if elevation is None else elevation, quantities.Elevation)
            direction = from_spherical(azimuth, elevation)
        elif azimuth is not None or elevation is not None:
            raise ValueError("direction: give either a direction or an azimuth and elevation, not both")
        object.__setattr__(self, "direction", direction)  # as frozen dataclasses initialise themselves
        object.__setattr__(self, "angle", angle)
        super().__init__(
            intensity=intensity,
            colour=colour,
            exposure=exposure,
            temperature=temperature,
            locus=locus,
            tint=tint,
            source=source,
            gel=gel,
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

    def settings(self) -> dict[str, object]:
        """Return {parameter: value} of the constructor, without those that have their defaults.

        The direction is given as azimuth and elevation, rounded to 1e-4 degrees.
        """
        settings = super().settings()
        del settings["direction"]
        return settings | {"azimuth": round(self.azimuth, 4), "elevation": round(self.elevation, 4)}

    def unit_samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Return unit directions (K, 3), float32, and linear RGB intensities (K, 3) for a power of 1.

        K is 1 for a hard light and 32 for a soft one. An unblocked surface that faces a soft light gets the
        same irradiance as from the hard light, as with UsdLux's `normalize`.
        """
        return disc_samples(np.array(self.direction), self.angle)

    def sample_radii(self, count: int) -> np.ndarray:
        return np.full(count, math.radians(self.angle / 2) / math.sqrt(count))


def disc_samples(axis: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples of a light along a unit axis, of an angular diameter in degrees: `unit_samples`."""
    directions = axis[None] if angle == 0 else _cap(axis, angle / 2)
    return directions.astype(np.float32), np.full(directions.shape, 1 / (directions @ axis).sum())


def _cap(axis: np.ndarray, radius: float) -> np.ndarray:
    """Return directions (SOFT_SAMPLE_COUNT, 3) over the spherical cap within `radius` degrees of `axis`.

    They form a golden-angle spiral in equal steps along the axis, which are equal areas of the sphere
    (Archimedes).
    """
    step = np.arange(SOFT_SAMPLE_COUNT)
    along = 1 - (1 - math.cos(math.radians(radius))) * (step + 0.5) / SOFT_SAMPLE_COUNT
    angle = math.pi * (3 - math.sqrt(5)) * step
    across = np.sqrt(1 - along**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), along], axis=-1) @ frame_of(axis)


def frame_of(axis: np.ndarray) -> np.ndarray:
    """Return three unit vectors at right angles, as rows (3, 3): two tangents, and the unit axis (3,)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])  # times a vector: the axis' cross product with it
    aside = cross[:, np.abs(axis).argmin()]
    aside = aside / np.linalg.norm(aside)
    return np.stack([aside, cross @ aside, axis])
