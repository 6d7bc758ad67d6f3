"""What the viewer begins with: lights, background, and the colours of temperatures."""

import base64
import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from relight.analysis.gloss import checked_gloss
from relight.compositing.composite import Background
from relight.compositing.placement import cover
from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight, environments
from relight.lights.light import Light
from relight.lights.near import PointLight
from relight.lights.rig import Lights, by_name, checked_amount
from relight.media.colour import LOCI, encode, temperature
from relight.media.images import scene_linear
from relight.media.images.encode import compressed
from relight.viewer.constants import MAX_LIGHTS

DEFAULT_LIGHT = DirectionalLight(azimuth=-40, elevation=30, angle=10, name="key")
TINT_COUNT = 100  # colours of each locus, in equal steps of mired
HandleLight = DirectionalLight | PointLight  # lights that have a handle on the page
COMMAND = ("relight", "apply", "photo.png")  # unless the caller names the file


def scene_of(
    size: tuple[int, int],
    lights: Lights | None = None,
    background: Background | None = None,
    *,
    title: str = "relight",
    command: Sequence[str] = COMMAND,
    background_name: str | None = None,
    gloss: float = 0.0,
    amount: float = 1.0,
) -> dict[str, Any]:
    """Describe a scene as the page's program reads it, ready for JSON.

    `size`: (H, W) of the picture. `lights`: up to eight directional lights and lamps, and one environment; a
    soft key light unless given. `background`: see `relight.over`; `background_name`: its file, or
    `environment`, as `--background` takes it. `command`: the words that relight the photograph on the command
    line, without its lights. `gloss`, `amount`: see `relight.Subject.relit`.

    Raises ValueError for too many lights, two of one name, or a gloss or an amount outside [0, 1];
    TypeError for lights of another kind, or that move.
    """
    named = checked_lights(DEFAULT_LIGHT if lights is None else lights)
    skies = {name: light for name, light in named.items() if isinstance(light, EnvironmentLight)}
    lamps = {name: light for name, light in named.items() if isinstance(light, HandleLight)}
    return {
        "title": title,
        "command": list(command),
        "lights": [parameters_of(light, name) for name, light in lamps.items()],
        "environment": next((_environment(light, name) for name, light in skies.items()), None),
        "gloss": checked_gloss(gloss),
        "amount": checked_amount(amount),
        "tints": {locus: _tints(locus) for locus in LOCI},
        **_backdrop(background, size, background_name),
    }


def checked_lights(lights: Lights) -> dict[str, Light]:
    """Return lights by name; raise ValueError or TypeError where the page cannot show them."""
    named = by_name(lights)
    skies = environments(named.values())
    for light in named.values():
        if not isinstance(light, DirectionalLight | PointLight | EnvironmentLight):
            raise TypeError(
                "lights: the viewer shows DirectionalLight, PointLight and EnvironmentLight, "
                f"got {type(light).__name__}"
            )
        if light.cone_axis is not None:
            raise ValueError("lights: the viewer shows lamps that shine all around; a light has a cone")
    if len(named) - len(skies) > MAX_LIGHTS or len(skies) > 1:
        raise ValueError(
            f"lights: the viewer shows up to {MAX_LIGHTS} directional lights and lamps, and one environment, "
            f"got {len(named) - len(skies)} and {len(skies)}"
        )
    return named


def parameters_of(light: HandleLight, name: str | None = None) -> dict[str, Any]:
    """Return a light as the page's program has it."""
    shared = {"name": name or light.name or "", **_shared(light)}
    if isinstance(light, PointLight):
        return shared | {"position": list(light.position), "radius": light.radius}
    angles = {"azimuth": round(light.azimuth, 4), "elevation": round(light.elevation, 4)}
    return shared | angles | {"angle": light.angle}


def _shared(light: Light) -> dict[str, Any]:
    return {key: getattr(light, key) for key in Light.parameters() if key != "name"}


def _environment(light: EnvironmentLight, name: str) -> dict[str, Any]:
    directions, powers = light.image.lamps
    return {
        "path": "environment.exr" if light.image.path is None else light.image.path.name,
        "settings": {"name": name, "rotation": light.rotation, **_shared(light)},
        "lamps": np.concatenate([directions, powers], axis=1).astype(float).round(7).tolist(),
    }


@functools.cache
def _tints(locus: str) -> dict[str, Any]:
    """Return the colours of temperatures, from hot to cold, between which the page interpolates."""
    coldest, hottest = LOCI[locus]
    mireds = np.linspace(1e6 / hottest, 1e6 / coldest, TINT_COUNT)
    colours = [temperature(float(np.clip(1e6 / mired, coldest, hottest)), locus) for mired in mireds]
    return {"mired": [mireds[0], mireds[1] - mireds[0]], "colours": np.round(colours, 6).tolist()}


def _backdrop(background: Background | None, size: tuple[int, int], name: str | None) -> dict[str, Any]:
    """Describe the background: a colour, or a picture of the plate's size, encoded for a display."""
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
    data = compressed(encode(pixels.clip(0, 1), white=1), "JPEG", quality=92, optimize=True)
    picture = {"name": name, "data": base64.b64encode(data).decode()}
    return {"background": "picture", "backdrop": picture}
