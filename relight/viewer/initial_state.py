"""What the viewer begins with: lights, background, and the colours of temperatures."""

import base64
import functools
from collections.abc import Sequence
from typing import TypedDict

import numpy as np

from relight.analysis.gloss import checked_gloss
from relight.arguments import checked_number
from relight.compositing.composite import Background
from relight.compositing.placement import cover
from relight.lights.directional import DirectionalLight
from relight.lights.environment import FIELD_OF_VIEW, EnvironmentLight, environments
from relight.lights.light import Light
from relight.lights.near import PointLight
from relight.lights.plate import few_rows, whole_field_of_view
from relight.lights.rig import Lights, as_lights, by_name, checked_amount
from relight.media.colour import LOCI, encode, temperature
from relight.media.images import scene_linear
from relight.media.images.arrays import as_array
from relight.media.images.encode import compressed
from relight.viewer.constants import MAX_LIGHTS

DEFAULT_LIGHT = DirectionalLight(azimuth=-40, elevation=30, angle=10, name="key")
TINT_COUNT = 100  # colours of each locus, in equal steps of mired


class Backdrop(TypedDict):
    """A picture behind the person: its name, a JPEG in base64, and its light, see `fill_lamps`."""

    name: str | None
    data: str
    lamps: list[list[float]] | None


class SkyState(TypedDict):
    """An environment: the name of its file, its parameters, and its lamps, see `fill_lamps`."""

    path: str
    settings: dict[str, object]
    lamps: list[list[float]]


class Behind(TypedDict):
    """What is behind the person: nothing, a linear colour, or "picture", which is the backdrop."""

    background: str | list[float] | None
    backdrop: Backdrop | None


class SceneState(Behind):
    """A scene as the page's program reads it."""

    title: str
    command: list[str]
    lights: list[dict[str, object]]
    environment: SkyState | None
    gloss: float
    amount: float
    fill: float
    blur: float
    backgroundLight: float
    tints: dict[str, dict[str, object]]


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
    fill: float = 0.0,
    blur: float = 0.0,
    background_light: float = 0.0,
    field_of_view: float = FIELD_OF_VIEW,
) -> SceneState:
    """Describe a scene as the page's program reads it, ready for JSON.

    `size`: (H, W) of the picture. `lights`: up to eight directional lights and lamps, and one environment; a
    soft key light unless given. `background`: see `relight.over`; `background_name`: its file, or
    `environment`, as `--background` takes it. `command`: the words that relight the photograph on the command
    line, without its lights. `gloss`, `amount`: see `relight.Subject.relit`. `fill`: share of the light of
    the background, which fills shadows; `blur` and `background_light`: of the background, see
    `relight.Lighting`; `field_of_view`: the picture's, vertical.

    Raises ValueError for too many lights, two of one name, a gloss, an amount or a fill outside [0, 1], or a
    fill without a background that is an image; TypeError for lights of another kind, or that move.
    """
    named = checked_lights(DEFAULT_LIGHT if lights is None else lights)
    skies = {name: light for name, light in named.items() if isinstance(light, EnvironmentLight)}
    lamps = {name: light for name, light in named.items() if isinstance(light, HandleLight)}
    behind = _backdrop(background, size, background_name, field_of_view)
    fill = checked_number("fill", fill, 0, 1)
    if fill and not (behind["backdrop"] and behind["backdrop"]["lamps"]):
        raise ValueError("fill: expected a background that is an image, whose light it is")
    return {
        "title": title,
        "command": list(command),
        "lights": [parameters_of(light, name) for name, light in lamps.items()],
        "environment": next((_environment(light, name) for name, light in skies.items()), None),
        "gloss": checked_gloss(gloss),
        "amount": checked_amount(amount),
        "fill": fill,
        "blur": blur,
        "backgroundLight": background_light,
        "tints": {locus: _tints(locus) for locus in LOCI},
        **behind,
    }


def checked_lights(lights: Lights) -> dict[str, Light]:
    """Return lights by name; raise ValueError or TypeError where the page cannot show them."""
    named = by_name(as_lights(lights))
    skies = environments(named.values())
    for light in named.values():
        if not isinstance(light, DirectionalLight | PointLight | EnvironmentLight):
            raise TypeError(
                "lights: the viewer shows DirectionalLight, PointLight and EnvironmentLight, "
                f"got {type(light).__name__}"
            )
        if isinstance(light, PointLight):
            light.check_placed()
        if light.cone_axis is not None:
            raise ValueError(
                "lights: the viewer shows lamps that shine all around; a light has a cone or a profile"
            )
    if len(named) - len(skies) > MAX_LIGHTS or len(skies) > 1:
        raise ValueError(
            f"lights: the viewer shows up to {MAX_LIGHTS} directional lights and lamps, and one environment, "
            f"got {len(named) - len(skies)} and {len(skies)}"
        )
    return named


def parameters_of(light: HandleLight, name: str | None = None) -> dict[str, object]:
    """Return a light as the page's program has it."""
    shared = {"name": name or light.name or "", **_shared(light)}
    if isinstance(light, PointLight):
        return shared | {"position": list(light.position), "radius": light.radius}
    angles = {"azimuth": round(light.azimuth, 4), "elevation": round(light.elevation, 4)}
    return shared | angles | {"angle": light.angle}


def _shared(light: Light) -> dict[str, object]:
    plain = light.plain  # the page's program knows neither lamps nor gels
    return {key: getattr(plain, key) for key in ("intensity", "colour", "exposure", "temperature", "locus")}


def _environment(light: EnvironmentLight, name: str) -> SkyState:
    return {
        "path": "environment.exr" if light.image.path is None else light.image.path.name,
        "settings": {"name": name, "rotation": light.rotation, **_shared(light)},
        "lamps": _rows(light),
    }


def fill_lamps(background: np.ndarray, size: tuple[int, int], field_of_view: float) -> list[list[float]]:
    """Return the light of a background (H, W, 3), linear, around a person: rows of direction and power.

    `size`: (H, W) of the picture, `field_of_view` its own. `relight.Lighting(fill="background")` has this
    light, of the whole background; here it is reduced to a few rows, as is that of movies.
    """
    whole = whole_field_of_view(background.shape, size, field_of_view)
    return _rows(EnvironmentLight.from_plate(few_rows(background), whole))


def _rows(light: EnvironmentLight) -> list[list[float]]:
    """Return the lamps of an environment as the page's program has them: direction and power in a row."""
    return np.concatenate(light.image.lamps, axis=1).astype(float).round(7).tolist()


@functools.cache
def _tints(locus: str) -> dict[str, object]:
    """Return the colours of temperatures, from hot to cold, between which the page interpolates."""
    coldest, hottest = LOCI[locus]
    mireds = np.linspace(1e6 / hottest, 1e6 / coldest, TINT_COUNT)
    colours = [temperature(float(np.clip(1e6 / mired, coldest, hottest)), locus) for mired in mireds]
    return {"mired": [mireds[0], mireds[1] - mireds[0]], "colours": np.round(colours, 6).tolist()}


def _backdrop(
    background: Background | None, size: tuple[int, int], name: str | None, field_of_view: float
) -> Behind:
    """Describe the background: a colour, or a picture of the plate's size, encoded for a display."""
    lamps = None
    if background is None:
        return {"background": None, "backdrop": None}
    if isinstance(background, EnvironmentLight):
        pixels = background.view(size)
    elif (colour := as_array("background", background)).ndim == 1:
        if (
            colour.shape != (3,)
            or colour.dtype.kind not in "iuf"
            or not np.isfinite(colour).all()
            or colour.min() < 0
        ):
            raise ValueError(f"background: expected an image or three numbers >= 0, got {background!r}")
        return {"background": colour.astype(float).tolist(), "backdrop": None}
    else:
        image = scene_linear("background", background)[..., :3]
        pixels, lamps = cover(image, size), fill_lamps(image, size, field_of_view)
    data = compressed(encode(pixels.clip(0, 1), white=1), "JPEG", quality=92, optimize=True)
    picture = Backdrop(name=name, data=base64.b64encode(data).decode(), lamps=lamps)
    return {"background": "picture", "backdrop": picture}
