"""What the viewer begins with: the lights, what is behind the person, and how colours are named."""

import base64
import functools
import io
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from PIL import Image

from relight.composite import cover
from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light, by_name
from relight.lights.near import PointLight
from relight.media.colour import LOCI, encode, temperature
from relight.media.images import scene_linear
from relight.rendering import Background

LIGHTS = 8  # directional lights and lamps at most, and one environment
KEY = DirectionalLight(azimuth=-40, elevation=30, angle=10, name="key")  # where no lights are given
TINTS = 100  # colours of each locus, in equal steps of mired
HeldLight = DirectionalLight | PointLight  # that have a handle on the page
SHARED = ("intensity", "colour", "exposure", "temperature", "locus")
COMMAND = ("relight", "apply", "photo.png")  # where nobody says what the photograph's file is


def scene_of(
    size: tuple[int, int],
    lights: Light | Iterable[Light] | None = None,
    background: Background | None = None,
    *,
    title: str = "relight",
    command: Sequence[str] = COMMAND,
) -> dict[str, Any]:
    """A scene as the page's program reads it, ready for JSON.

    Parameters
    ----------
    size: (H, W) of the picture.
    lights: up to eight directional lights and lamps, and one environment; a soft key light unless given.
    background: as of `relight.over`.
    title: what the page is called. command: the words that relight the photograph, without its lights.

    Raises
    ------
    ValueError: too many lights, two of one name. TypeError: lights of another kind, or that move.
    """
    named = checked_lights(KEY if lights is None else lights)
    skies = {name: light for name, light in named.items() if isinstance(light, EnvironmentLight)}
    lamps = {name: light for name, light in named.items() if isinstance(light, HeldLight)}
    return {
        "title": title,
        "command": list(command),
        "lights": [parameters_of(light, name) for name, light in lamps.items()],
        "environment": next((_environment(light, name) for name, light in skies.items()), None),
        "tints": {locus: _tints(locus) for locus in LOCI},
        **_backdrop(background, size),
    }


def checked_lights(lights: Light | Iterable[Light]) -> dict[str, Light]:
    """Lights by name; ValueError or TypeError where the page cannot show them."""
    named = by_name(lights)
    skies = [light for light in named.values() if isinstance(light, EnvironmentLight)]
    for light in named.values():
        if not isinstance(light, DirectionalLight | PointLight | EnvironmentLight):
            raise TypeError(
                "lights: the viewer shows DirectionalLight, PointLight and EnvironmentLight, "
                f"got {type(light).__name__}"
            )
    if len(named) - len(skies) > LIGHTS or len(skies) > 1:
        raise ValueError(
            f"lights: the viewer shows up to {LIGHTS} directional lights and lamps, and one environment, "
            f"got {len(named) - len(skies)} and {len(skies)}"
        )
    return named


def parameters_of(light: HeldLight, name: str | None = None) -> dict[str, Any]:
    """A light as the page has it."""
    shared = {"name": name or light.name or ""} | {key: getattr(light, key) for key in SHARED}
    if isinstance(light, PointLight):
        return shared | {"position": list(light.position), "radius": light.radius}
    angles = {"azimuth": round(light.azimuth, 4), "elevation": round(light.elevation, 4)}
    return shared | angles | {"angle": light.angle}


def _environment(light: EnvironmentLight, name: str) -> dict[str, Any]:
    directions, powers = light.image.lamps
    return {
        "path": str(light.image.path or "environment.exr"),
        "settings": {"name": name, "rotation": light.rotation} | {key: getattr(light, key) for key in SHARED},
        "lamps": np.concatenate([directions, powers], axis=1).astype(float).round(7).tolist(),
    }


@functools.cache
def _tints(locus: str) -> dict[str, Any]:
    """Colours of temperatures, from hot to cold: the page interpolates between them."""
    coldest, hottest = LOCI[locus]
    mireds = np.linspace(1e6 / hottest, 1e6 / coldest, TINTS)
    colours = [temperature(float(np.clip(1e6 / mired, coldest, hottest)), locus) for mired in mireds]
    return {"mired": [mireds[0], mireds[1] - mireds[0]], "colours": np.round(colours, 6).tolist()}


def _backdrop(background: Background | None, size: tuple[int, int]) -> dict[str, Any]:
    """What is behind the person: a colour, or a picture as large as the page's and encoded for a display."""
    if background is None:
        return {"background": None, "backdrop": None}
    if isinstance(background, EnvironmentLight):
        pixels = background.view(size)
    elif np.ndim(background) == 1:
        colour = np.asarray(background, float)
        if colour.shape != (3,) or not np.isfinite(colour).all() or colour.min() < 0:
            raise ValueError(f"background: expected an image or three numbers >= 0, got {background!r}")
        return {"background": colour.tolist(), "backdrop": None}
    else:
        pixels = cover(scene_linear("background", background)[..., :3], size)
    codes = np.round(encode(pixels.clip(0, 1), white=1) * 255).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(codes).save(file, "JPEG", quality=92, optimize=True)
    picture = {"name": "background.jpg", "data": base64.b64encode(file.getvalue()).decode()}
    return {"background": "picture", "backdrop": picture}
