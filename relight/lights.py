"""Lights, and what they come down to: directions (K, 3) with intensities (K, 3)."""

import math
from dataclasses import dataclass

import numpy as np

from relight import colour as colours
from shadow.directions import from_spherical, to_spherical

SOFT_SAMPLES = 32  # directions over the disc of a soft light


def _numbers(name, value, count):
    """`value` as a tuple of `count` finite floats."""
    try:
        numbers = tuple(float(number) for number in value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name}: expected {count} numbers, got {value!r}") from error
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueError(f"{name}: expected {count} finite numbers, got {value!r}")
    return numbers


def _number(name, value, low=-math.inf, high=math.inf):
    """`value` as one finite float in [low, high]."""
    (number,) = _numbers(name, (value,), 1)
    if not low <= number <= high:
        raise ValueError(f"{name}: expected {low:g} to {high:g}, got {number:g}")
    return number


@dataclass(frozen=True, init=False)
class DirectionalLight:
    """A light so far away that its rays are parallel, as UsdLux's DistantLight.

    Parameters
    ----------
    direction: (x, y, z) from the subject *to* the light, camera frame, any length but zero; or
    azimuth, elevation: degrees. Azimuth turns from the camera (0) toward image right (90), so -40 is a light
        at image left; elevation rises from the horizon (0) to overhead (90). Each is 0 unless given.
    intensity: >= 0. At 1, a white surface that faces the light has the value 1.
    colour: linear Rec.709, each >= 0.
    exposure: stops; doubles the light for each.
    temperature: kelvin in [1000, 40000], or None for no tint: multiplies `colour` at luminance 1.
    angle: angular diameter in degrees, [0, 180]: 0 is a hard light; the sun has 0.53; softboxes, tens.
    name: names the light's layer.

    Raises
    ------
    TypeError, ValueError: not numbers, NaN or infinite, out of range, a zero-length direction, or both
    `direction` and `azimuth` or `elevation`.
    """

    direction: tuple[float, float, float]
    intensity: float
    colour: tuple[float, float, float]
    exposure: float
    temperature: float | None
    angle: float
    name: str | None

    def __init__(
        self,
        direction=None,
        *,
        azimuth=None,
        elevation=None,
        intensity=1.0,
        colour=(1.0, 1.0, 1.0),
        exposure=0.0,
        temperature=None,
        angle=0.0,
        name=None,
    ):
        if direction is None:
            azimuth = _number("azimuth", 0.0 if azimuth is None else azimuth)
            elevation = _number("elevation", 0.0 if elevation is None else elevation, -90, 90)
            direction = from_spherical(azimuth, elevation)
        elif azimuth is not None or elevation is not None:
            raise ValueError("direction: give either a direction or an azimuth and elevation, not both")
        direction = _numbers("direction", direction, 3)
        length = math.hypot(*direction)
        if length < 1e-6:
            raise ValueError("direction: has zero length")
        colour = _numbers("colour", colour, 3)
        if min(colour) < 0:
            raise ValueError(f"colour: expected values >= 0, got {colour}")
        if temperature is not None:
            temperature = _number("temperature", temperature, *colours.KELVIN)
        if name is not None and (not isinstance(name, str) or not name):
            raise TypeError(f"name: expected a non-empty string, got {name!r}")
        values = {
            "direction": tuple(component / length for component in direction),
            "intensity": _number("intensity", intensity, 0),
            "colour": colour,
            "exposure": _number("exposure", exposure, -64, 64),
            "temperature": temperature,
            "angle": _number("angle", angle, 0, 180),
            "name": name,
        }
        for field, value in values.items():
            object.__setattr__(self, field, value)  # as frozen dataclasses initialise themselves

    @classmethod
    def parse(cls, text):
        """A light from text: `key:azimuth=-40,elevation=30,intensity=2,colour=1/0.9/0.8`.

        `name:` may be left out. Each `parameter=value` is one of the constructor's; vectors have slashes
        between their numbers. ValueError if the text does not read so.
        """
        name, colon, settings = text.rpartition(":")
        arguments = {"name": name} if colon else {}
        for setting in filter(None, settings.split(",")):
            key, equals, value = (part.strip() for part in setting.partition("="))
            if key not in PARAMETERS or not equals or key in arguments:
                problem = "twice" if key in arguments else "not understood"
                expected = f"name:parameter=value,... with {', '.join(PARAMETERS)}"
                raise ValueError(f"light {text!r}: {setting!r} is {problem}; expected {expected}")
            try:
                numbers = tuple(map(float, value.split("/")))
            except ValueError as error:
                raise ValueError(f"light {text!r}: {key} expects a number, got {value!r}") from error
            arguments[key] = numbers if key in ("direction", "colour") else numbers[0]
            if key not in ("direction", "colour") and len(numbers) > 1:
                raise ValueError(f"light {text!r}: {key} expects one number, got {value!r}")
        try:
            return cls(**arguments)
        except (TypeError, ValueError) as error:
            raise ValueError(f"light {text!r}: {error}") from error

    @property
    def azimuth(self):
        """Degrees in [-180, 180], from the camera toward image right."""
        return float(to_spherical(self.direction)[0])

    @property
    def elevation(self):
        """Degrees in [-90, 90], up from the horizon."""
        return float(to_spherical(self.direction)[1])

    def samples(self):
        """What the light comes down to: unit directions (K, 3) and linear RGB intensities (K, 3), float32.

        K is 1 for a hard light and 32 for a soft one. A soft light gives an unoccluded surface that faces
        it the same irradiance as the hard light, as UsdLux's `normalize` does.
        """
        tint = np.ones(3) if self.temperature is None else np.array(colours.temperature(self.temperature))
        power = np.array(self.colour) * tint * self.intensity * 2.0**self.exposure
        axis = np.array(self.direction)
        directions = axis[None] if self.angle == 0 else _cap(axis, self.angle / 2)
        intensities = np.broadcast_to(power / (directions @ axis).sum(), directions.shape)
        return directions.astype(np.float32), intensities.astype(np.float32)


PARAMETERS = (
    "direction",
    "azimuth",
    "elevation",
    "intensity",
    "colour",
    "exposure",
    "temperature",
    "angle",
)


def _cap(axis, radius):
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
