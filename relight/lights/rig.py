"""What functions take for lights: one, several, or the name of a preset."""

import itertools
from collections.abc import Iterable, Sequence
from typing import Annotated, TypeVar, cast

from annotated_types import Interval

from relight.arguments import About, checked_number
from relight.lights import presets
from relight.lights.light import Light
from relight.lights.moving import MovingLight

AnyLight = TypeVar("AnyLight", bound=Light | MovingLight)
Lights = Light | Iterable[Light] | str  # what functions accept
MOST_SOLVED = 32  # lights that are solved for together
FewLights = Annotated[
    int, Interval(ge=1, le=MOST_SOLVED), About("Number of lights at most that are solved for.")
]


def as_rig(lights: object, expected: str = "lights") -> list[Light | MovingLight]:
    """Return one light, several, or those of a preset's name, as a list; they may move.

    Raises ValueError for a name that no preset has, and TypeError for anything else; `expected` is what its
    message asks for.
    """
    if isinstance(lights, str):
        return [*presets.named(lights, "lights")]
    alone = hasattr(lights, "rays") or hasattr(lights, "at")  # a light, of whatever class
    try:
        several = [lights] if alone else list(cast(Iterable[object], lights))
    except TypeError as error:
        raise TypeError(f"lights: expected {expected}, got {type(lights).__name__}") from error
    for light in several:
        if not hasattr(light, "rays") and not hasattr(light, "at"):
            raise TypeError(f"lights: expected lights, e.g. DirectionalLight, got {type(light).__name__}")
    return cast(list[Light | MovingLight], several)


def scaled(lights: Iterable[AnyLight], factor: float) -> list[AnyLight]:
    """Return lights of `factor` times their intensity; they may move.

    >>> import relight
    >>> [light.intensity for light in scaled([relight.DirectionalLight(intensity=3)], 0.5)]
    [1.5]
    """
    if factor == 1:
        return list(lights)
    return [cast(AnyLight, light.scaled(factor)) for light in lights]


def checked_amount(amount: object, name: str = "amount") -> float:
    """Return a share of new light; raises TypeError or ValueError unless it is a number in [0, 1].

    >>> checked_amount(0.5)
    0.5
    """
    return checked_number(name, amount, 0, 1)


def as_lights(lights: Lights | Iterable[Light | MovingLight]) -> list[Light]:
    """Return lights as a list, see `as_rig`; raises TypeError for moving ones."""
    still: list[Light] = []
    for light in as_rig(lights):
        if isinstance(light, MovingLight):
            raise TypeError(
                f"lights: {light.name or 'a light'} moves; give the light of one frame, light.at(frame)"
            )
        still.append(light)
    return still


def by_name(lights: Sequence[Light], reserved: Iterable[str] = ()) -> dict[str, Light]:
    """Return {name: light}; raises ValueError if two were given one name.

    Lights without a name are `light1`, `light2`... by their place, or the next number that no name has.
    `reserved`: names of the picture's other layers, which no light may have.
    """
    given = [light.name for light in lights if light.name]
    if len(set(given)) < len(given):
        raise ValueError(f"lights: expected different names, got {', '.join(given)}")
    named: dict[str, Light] = {}
    for number, light in enumerate(lights, 1):
        numbers = itertools.count(number)
        free = (name for each in numbers if (name := f"light{each}") not in {*given, *named})
        named[light.name or next(free)] = light
    for layer in reserved:
        if layer in named:
            owner = layer.replace("_", " ")
            raise ValueError(f"lights: {layer!r} names the {owner}'s layer; give the light another name")
    return named
