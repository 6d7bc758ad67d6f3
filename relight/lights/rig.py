"""What functions take for lights: one, several, or the name of a preset."""

from collections.abc import Iterable
from typing import Any

from relight.lights import presets
from relight.lights.light import Light
from relight.lights.moving import MovingLight

Lights = Light | Iterable[Light] | str  # what functions accept


def as_rig(lights: Any, expected: str = "lights") -> list[Any]:
    """Return one light, several, or those of a preset's name, as a list; they may move.

    Raises ValueError for a name that no preset has, and TypeError for anything else; `expected` is what its
    message asks for.
    """
    if isinstance(lights, str):
        return presets.named(lights, "lights")
    alone = hasattr(lights, "rays") or hasattr(lights, "at")  # a light, of whatever class
    try:
        several: list[Any] = [lights] if alone else list(lights)
    except TypeError as error:
        raise TypeError(f"lights: expected {expected}, got {type(lights).__name__}") from error
    for light in several:
        if not hasattr(light, "rays") and not hasattr(light, "at"):
            raise TypeError(f"lights: expected lights, e.g. DirectionalLight, got {type(light).__name__}")
    return several


def as_lights(lights: Lights | Iterable[Light | MovingLight]) -> list[Light]:
    """Return lights as a list, see `as_rig`; raises TypeError for moving ones."""
    several = as_rig(lights)
    for light in several:
        if hasattr(light, "at"):
            raise TypeError(
                f"lights: {light.name or 'a light'} moves; give the light of one frame, light.at(frame)"
            )
    return several


def by_name(lights: Lights) -> dict[str, Light]:
    """Return {name: light}, unnamed ones as `light1`, `light2`...; raises ValueError if two have one name."""
    several = as_lights(lights)
    names = [light.name or f"light{number}" for number, light in enumerate(several, 1)]
    if len(set(names)) < len(names):
        raise ValueError(f"lights: expected different names, got {', '.join(names)}")
    return dict(zip(names, several, strict=True))
