"""The base class of lights: strength and colour, samples, parsing from text."""

import inspect
import math
import reprlib
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from relight.media import colour as colours

VECTOR_PARAMETERS = ("direction", "colour", "position", "toward")
TEXT_PARAMETERS = ("colour_space", "locus", "name")
MAX_NAME_BYTES = 240  # with "visibility_" before and ".R" behind, within the 255 of OpenEXR
REQUIRED = inspect.Parameter.empty


@dataclass(frozen=True, init=False)
class Light:
    """What all lights have in common; see `relight.DirectionalLight` for the parameters."""

    intensity: float
    colour: tuple[float, float, float]
    exposure: float
    temperature: float | None
    locus: str
    name: str | None

    def _set(
        self,
        *,
        intensity: float,
        colour: Iterable[float],
        exposure: float,
        temperature: float | None,
        locus: str,
        name: str | None,
        **own: Any,
    ) -> None:
        """Check and set the common fields and the light's `own` ones, as frozen dataclasses do."""
        rgb = checked_numbers("colour", colour, 3)
        if min(rgb) < 0:
            raise ValueError(f"colour: expected values >= 0, got {rgb}")
        if not isinstance(locus, str) or locus not in colours.LOCI:
            raise ValueError(f"locus: expected {' or '.join(colours.LOCI)}, got {reprlib.repr(locus)}")
        if temperature is not None:
            temperature = checked_number("temperature", temperature, *colours.LOCI[locus])
        if name is not None:
            check_name(name)
        values = {
            "intensity": checked_number("intensity", intensity, 0),
            "colour": rgb,
            "exposure": checked_number("exposure", exposure, -64, 64),
            "temperature": temperature,
            "locus": locus,
            "name": name,
        }
        for field, value in (values | own).items():
            object.__setattr__(self, field, value)

    @property
    def power(self) -> np.ndarray:
        """Linear RGB (3,): colour × temperature's tint × intensity × 2**exposure."""
        tint = (1.0,) * 3
        if self.temperature is not None:
            tint = colours.temperature(self.temperature, self.locus)
        return np.array(self.colour) * tint * self.intensity * 2.0**self.exposure

    def settings(self) -> dict[str, Any]:
        """Return {parameter: value} of the constructor, without those that have their defaults."""
        optional = {
            key: default for key, default in parameters(type(self)).items() if default is not REQUIRED
        }
        given = {key: getattr(self, key) for key in optional}
        return {key: value for key, value in given.items() if value != optional[key]}

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a light from text: `key:azimuth=-40,elevation=30,intensity=2,colour=1/0.9/0.8`.

        `name:` is optional. Each `parameter=value` is one of the constructor's; the numbers of a vector are
        separated by slashes.

        Raises
        ------
        ValueError
            The text does not have this form, or the light refuses a value.

        Examples
        --------
        >>> import relight
        >>> relight.DirectionalLight.parse("key:azimuth=-40,intensity=2").intensity
        2.0
        """
        name, colon, settings = text.rpartition(":")
        try:
            arguments = parse_settings(cls, filter(None, settings.split(",")))
            if any(word.partition("=")[0] in parameters(cls) for word in name.split(",") if "=" in word):
                raise ValueError(f"{name!r} is no name; settings are separated by commas")
            if colon and "name" in arguments:
                raise ValueError(f"name={arguments['name']!r} is twice")
            for key, default in parameters(cls).items():
                if default is REQUIRED and key not in arguments:
                    raise ValueError(f"{key} is missing")
            return cls(**arguments | ({"name": name} if colon else {}))
        except (TypeError, ValueError) as error:
            raise ValueError(f"light {text!r}: {error}") from error

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the light as unit directions (K, 3) and linear RGB intensities (K, 3), float32."""
        raise NotImplementedError


def check_name(name: Any) -> None:
    """Raise TypeError or ValueError unless `name` can name a light, and layers of an OpenEXR file."""
    if not isinstance(name, str) or not name:
        raise TypeError(f"name: expected a non-empty string, got {reprlib.repr(name)}")
    if any(unicodedata.category(character) in ("Cc", "Cs") for character in name):
        raise ValueError(f"name: expected no control characters, got {reprlib.repr(name)}")
    if len(name.encode()) > MAX_NAME_BYTES:
        raise ValueError(f"name: expected at most {MAX_NAME_BYTES} bytes of UTF-8, got {len(name.encode())}")


def checked_numbers(name: str, value: Any, count: int) -> tuple[float, ...]:
    """Return `value` as a tuple of `count` finite floats; TypeError or ValueError otherwise."""
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


def checked_number(name: str, value: Any, low: float = -math.inf, high: float = math.inf) -> float:
    """Return `value` as one finite float in [low, high]; TypeError or ValueError otherwise."""
    (number,) = checked_numbers(name, (value,), 1)
    if not low <= number <= high:
        raise ValueError(f"{name}: expected {low:g} to {high:g}, got {number:g}")
    return number


def parse_settings(light: type[Light], settings: Iterable[str]) -> dict[str, Any]:
    """Return the arguments of a light's constructor from texts `parameter=value`; vectors as `1/0.9/0.8`."""
    known = parameters(light)
    arguments: dict[str, Any] = {}
    for setting in settings:
        key, equals, value = (part.strip() for part in setting.partition("="))
        if key not in known or not equals or key in arguments:
            problem = "twice" if key in arguments else "not understood"
            raise ValueError(
                f"{setting!r} is {problem}; expected parameter=value,... with {', '.join(known)}"
            )
        if key in TEXT_PARAMETERS:
            arguments[key] = value
            continue
        try:
            numbers = tuple(map(float, value.split("/")))
        except ValueError as error:
            raise ValueError(f"{key} expects a number, got {value!r}") from error
        if key not in VECTOR_PARAMETERS and len(numbers) > 1:
            raise ValueError(f"{key} expects one number, got {value!r}")
        arguments[key] = numbers if key in VECTOR_PARAMETERS else numbers[0]
    return arguments


def parameters(light: type[Light]) -> dict[str, Any]:
    """Return the parameters of a class of lights, in order: {parameter: its default, or REQUIRED}."""
    return {key: parameter.default for key, parameter in inspect.signature(light).parameters.items()}
