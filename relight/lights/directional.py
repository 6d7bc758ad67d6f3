"""Lights, and what they come down to: directions (K, 3) with intensities (K, 3)."""

import inspect
import math
import reprlib
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from relight.media import colour as colours
from shadow.directions import from_spherical, to_spherical

SOFT_SAMPLES = 32  # directions over the disc of a soft light
VECTORS = ("direction", "colour")
TEXTS = ("locus", "name")
REQUIRED = inspect.Parameter.empty


def _numbers(name, value, count):
    """`value` as a tuple of `count` finite floats."""
    expected, got = ("numbers", value) if count > 1 else ("number", value[0])
    try:
        if isinstance(value, str) or any(isinstance(number, str | bool) for number in value):
            raise TypeError("text and truth are no numbers")
        numbers = tuple(float(number) for number in value)
    except (OverflowError, TypeError, ValueError) as error:
        raise TypeError(f"{name}: expected {count} {expected}, got {reprlib.repr(got)}") from error
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueError(f"{name}: expected {count} finite {expected}, got {reprlib.repr(got)}")
    return numbers


def checked_number(name, value, low=-math.inf, high=math.inf):
    """`value` as one finite float in [low, high]."""
    (number,) = _numbers(name, (value,), 1)
    if not low <= number <= high:
        raise ValueError(f"{name}: expected {low:g} to {high:g}, got {number:g}")
    return number


@dataclass(frozen=True, init=False)
class Light:
    """What every light has; `relight.DirectionalLight` says what the parameters mean."""

    intensity: float
    colour: tuple[float, float, float]
    exposure: float
    temperature: float | None
    locus: str
    name: str | None

    def _set(self, *, intensity, colour, exposure, temperature, locus, name, **own):
        """Check what every light has, and set it and the light's `own` fields as frozen dataclasses do."""
        colour = _numbers("colour", colour, 3)
        if min(colour) < 0:
            raise ValueError(f"colour: expected values >= 0, got {colour}")
        if locus not in colours.LOCI:
            raise ValueError(f"locus: expected {' or '.join(colours.LOCI)}, got {reprlib.repr(locus)}")
        if temperature is not None:
            temperature = checked_number("temperature", temperature, *colours.LOCI[locus])
        if name is not None and (not isinstance(name, str) or not name):
            raise TypeError(f"name: expected a non-empty string, got {reprlib.repr(name)}")
        values = {
            "intensity": checked_number("intensity", intensity, 0),
            "colour": colour,
            "exposure": checked_number("exposure", exposure, -64, 64),
            "temperature": temperature,
            "locus": locus,
            "name": name,
        }
        for field, value in (values | own).items():
            object.__setattr__(self, field, value)

    @property
    def power(self):
        """Linear RGB (3,): colour × temperature's tint × intensity × 2**exposure."""
        tint = 1 if self.temperature is None else np.array(colours.temperature(self.temperature, self.locus))
        return np.array(self.colour) * tint * self.intensity * 2.0**self.exposure

    def settings(self):
        """{parameter: value} of the constructor, as far as they are not its defaults."""
        optional = {
            key: default for key, default in parameters(type(self)).items() if default is not REQUIRED
        }
        given = {key: getattr(self, key) for key in optional}
        return {key: value for key, value in given.items() if value != optional[key]}


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
        direction=None,
        *,
        azimuth=None,
        elevation=None,
        intensity=1.0,
        colour=(1.0, 1.0, 1.0),
        exposure=0.0,
        temperature=None,
        locus="planckian",
        angle=0.0,
        name=None,
    ):
        if direction is None:
            azimuth = checked_number("azimuth", 0.0 if azimuth is None else azimuth)
            elevation = checked_number("elevation", 0.0 if elevation is None else elevation, -90, 90)
            direction = from_spherical(azimuth, elevation)
        elif azimuth is not None or elevation is not None:
            raise ValueError("direction: give either a direction or an azimuth and elevation, not both")
        direction = _numbers("direction", direction, 3)
        length = math.hypot(*direction)
        if length < 1e-6:
            raise ValueError("direction: has zero length")
        self._set(
            direction=tuple(component / length for component in direction),
            angle=checked_number("angle", angle, 0, 180),
            intensity=intensity,
            colour=colour,
            exposure=exposure,
            temperature=temperature,
            locus=locus,
            name=name,
        )

    @classmethod
    def parse(cls, text):
        """A light from text: `key:azimuth=-40,elevation=30,intensity=2,colour=1/0.9/0.8`.

        `name:` may be left out. Each `parameter=value` is one of the constructor's; vectors have slashes
        between their numbers. ValueError if the text does not read so.
        """
        name, colon, settings = text.rpartition(":")
        try:
            arguments = parse_settings(cls, filter(None, settings.split(",")))
            if colon and "name" in arguments:
                raise ValueError(f"name={arguments['name']!r} is twice")
            return cls(**arguments, **({"name": name} if colon else {}))
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

    def settings(self):
        """{parameter: value} of the constructor, as far as they are not its defaults.

        The direction as azimuth and elevation, rounded to 1e-4 degrees: exact for lights made from those.
        """
        settings = super().settings()
        del settings["direction"]
        return settings | {"azimuth": round(self.azimuth, 4), "elevation": round(self.elevation, 4)}

    def samples(self):
        """What the light comes down to: unit directions (K, 3) and linear RGB intensities (K, 3), float32.

        K is 1 for a hard light and 32 for a soft one. A soft light gives an unoccluded surface that faces
        it the same irradiance as the hard light, as UsdLux's `normalize` does.
        """
        axis = np.array(self.direction)
        directions = axis[None] if self.angle == 0 else _cap(axis, self.angle / 2)
        intensities = np.broadcast_to(self.power / (directions @ axis).sum(), directions.shape)
        return directions.astype(np.float32), intensities.astype(np.float32)


def parse_settings(light, settings):
    """Arguments of a light's constructor from texts `parameter=value`; vectors as `1/0.9/0.8`."""
    known = parameters(light)
    arguments = {}
    for setting in settings:
        key, equals, value = (part.strip() for part in setting.partition("="))
        if key not in known or not equals or key in arguments:
            problem = "twice" if key in arguments else "not understood"
            raise ValueError(
                f"{setting!r} is {problem}; expected parameter=value,... with {', '.join(known)}"
            )
        if key in TEXTS:
            arguments[key] = value
            continue
        try:
            numbers = tuple(map(float, value.split("/")))
        except ValueError as error:
            raise ValueError(f"{key} expects a number, got {value!r}") from error
        if key not in VECTORS and len(numbers) > 1:
            raise ValueError(f"{key} expects one number, got {value!r}")
        arguments[key] = numbers if key in VECTORS else numbers[0]
    return arguments


def parameters(light):
    """What a class of lights is made from, in order: {parameter: its default, or REQUIRED}."""
    return {key: parameter.default for key, parameter in inspect.signature(light).parameters.items()}


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


def as_lights(lights: Light | Iterable[Light]) -> list[Light]:
    """One light or an iterable of lights as a list."""
    lights = [lights] if hasattr(lights, "samples") or hasattr(lights, "at") else lights
    try:
        lights = list(lights)
    except TypeError as error:
        raise TypeError(f"lights: expected lights, got {type(lights).__name__}") from error
    for light in lights:
        if hasattr(light, "at"):
            raise TypeError(
                f"lights: {light.name or 'a light'} moves; give the light of one frame, light.at(frame)"
            )
        if not hasattr(light, "samples"):
            raise TypeError(f"lights: expected lights, e.g. DirectionalLight, got {type(light).__name__}")
    return lights


def by_name(lights: Light | Iterable[Light]) -> dict[str, Light]:
    """{name: light}, those without a name as `light1`, `light2`...; ValueError if two have one name."""
    lights = as_lights(lights)
    names = [light.name or f"light{number}" for number, light in enumerate(lights, 1)]
    if len(set(names)) < len(names):
        raise ValueError(f"lights: expected different names, got {', '.join(names)}")
    return dict(zip(names, lights, strict=True))
