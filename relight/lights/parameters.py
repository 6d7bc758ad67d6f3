"""The parameters of lights: one declaration each, which checks, converts, and reads text.

A light is a dataclass whose fields are of these types ("Descriptor-typed fields" in the documentation of
`dataclasses`): what is assigned to a field is checked and converted, whoever assigns it. Constructors, lights
files, the command line, the nodes and the viewer's page all use the same declarations.
"""

import itertools
import math
import reprlib
import unicodedata
from typing import Any, Generic, Self, TypeAlias, TypeVar, overload

from relight.media import colour as colours

MAX_NAME_BYTES = 240  # with "visibility_" before and ".R" behind, within the 255 of OpenEXR
REQUIRED: Any = object()  # the default of a parameter without one

Given = TypeVar("Given", contravariant=True)  # what a constructor takes
Held = TypeVar("Held", covariant=True)  # what the light has


class Parameter(Generic[Given, Held]):
    """A parameter of a light. `default` is REQUIRED where there is none."""

    def __init__(self, default: Any = REQUIRED) -> None:
        self.default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, light: None, kind: type) -> Self: ...
    @overload
    def __get__(self, light: object, kind: type) -> Held: ...
    def __get__(self, light: Any, kind: type) -> Any:
        """Return a light's value; of the class the default, as dataclasses ask for it."""
        if light is not None:
            return vars(light)[self.name]
        if self.default is REQUIRED:
            raise AttributeError(self.name)
        return self.default

    def __set__(self, light: Any, value: Given) -> None:
        vars(light)[self.name] = self.checked(value)

    def checked(self, value: Any) -> Any:
        """Return `value` as the light has it; TypeError or ValueError with the parameter's name otherwise."""
        return value

    def read(self, text: str) -> Any:
        """Return what the constructor takes of the value in `parameter=value`; raises ValueError."""
        return text


class Number(Parameter[float, float]):
    """A finite number in [low, high]."""

    def __init__(self, default: Any = REQUIRED, low: float = -math.inf, high: float = math.inf) -> None:
        super().__init__(default)
        self.low, self.high = low, high

    def checked(self, value: Any) -> float:
        return checked_number(self.name, value, self.low, self.high)

    def read(self, text: str) -> float:
        values = _numbers(self.name, text)
        if len(values) > 1:
            raise ValueError(f"{self.name} expects one number, got {text!r}")
        return values[0]


Numbers: TypeAlias = Any  # Iterable[float], which mypy would take for what an inherited field has


class Vector(Parameter[Numbers, tuple[float, float, float]]):
    """Three finite numbers of a magnitude of at most `largest`, in `unit`."""

    def __init__(self, default: Any = REQUIRED, largest: float = math.inf, unit: str = "") -> None:
        super().__init__(default)
        self.largest, self.unit = largest, unit

    def checked(self, value: Any) -> tuple[float, ...]:
        numbers = checked_numbers(self.name, value, 3)
        if max(map(abs, numbers)) > self.largest:
            raise ValueError(f"{self.name}: expected at most {self.largest:g} {self.unit}, got {numbers}")
        return numbers

    def read(self, text: str) -> tuple[float, ...]:
        return _numbers(self.name, text)


class OptionalVector(Parameter[Numbers, tuple[float, float, float] | None]):
    """A vector or None."""

    def __init__(self, default: Any, largest: float, unit: str) -> None:
        super().__init__(default)
        self.vector = Vector(REQUIRED, largest, unit)

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = self.vector.name = name

    def checked(self, value: Any) -> tuple[float, ...] | None:
        return None if value is None else self.vector.checked(value)

    def read(self, text: str) -> tuple[float, ...]:
        return _numbers(self.name, text)


class Colour(Vector):
    """Linear Rec.709, each >= 0."""

    def checked(self, value: Any) -> tuple[float, ...]:
        rgb = super().checked(value)
        if min(rgb) < 0:
            raise ValueError(f"{self.name}: expected values >= 0, got {rgb}")
        return rgb


class Kelvin(Parameter[float | None, float | None]):
    """A colour temperature, in the range of the light's locus, or None."""

    read = Number.read

    def checked(self, value: Any) -> float | None:
        return None if value is None else checked_number(self.name, value)


class Locus(Parameter[str, str]):
    """The curve of the colours of temperatures."""

    def checked(self, value: Any) -> str:
        if not isinstance(value, str) or value not in colours.LOCI:
            raise ValueError(f"{self.name}: expected {' or '.join(colours.LOCI)}, got {reprlib.repr(value)}")
        return value


class Name(Parameter[str | None, str | None]):
    """What can name a light, and layers of an OpenEXR file; or None."""

    def checked(self, value: Any) -> str | None:
        if value is None:
            return None
        if not isinstance(value, str) or not value:
            raise TypeError(f"name: expected a non-empty string, got {reprlib.repr(value)}")
        if any(unicodedata.category(character) in ("Cc", "Cs") for character in value):
            raise ValueError(f"name: expected no control characters, got {reprlib.repr(value)}")
        size = len(value.encode())
        if size > MAX_NAME_BYTES:
            raise ValueError(f"name: expected at most {MAX_NAME_BYTES} bytes of UTF-8, got {size}")
        return value


def parameters(light: type) -> dict[str, Parameter]:
    """Return the parameters of a class of lights by name, required ones first, common ones last."""
    kinds = light.__mro__
    declared = [[each for each in vars(kind).values() if isinstance(each, Parameter)] for kind in kinds]
    required = {each.name: each for own in reversed(declared) for each in own if each.default is REQUIRED}
    optional: dict[str, Parameter] = {}
    for each in itertools.chain(*declared):
        optional.setdefault(each.name, each)  # a class may have another default or range than its base
    return required | {name: each for name, each in optional.items() if name not in required}


def _numbers(name: str, text: str) -> tuple[float, ...]:
    """Return numbers that slashes separate."""
    try:
        return tuple(map(float, text.split("/")))
    except ValueError as error:
        raise ValueError(f"{name} expects a number, got {text!r}") from error


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
        expected = f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
        raise ValueError(f"{name}: expected {expected}, got {number:g}")
    return number
