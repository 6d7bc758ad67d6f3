"""The nodes that make lights. Each adds one to those that come in, so that they chain."""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from relight.comfyui import host, widgets
from relight.comfyui.tensors import light, pictures
from relight.lights import presets
from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light
from relight.lights.near import PointLight
from relight.lights.parameters import Number, parameters
from relight.media.colour import LOCI
from relight.media.images import scene_linear

Lights = tuple[Light, ...]  # what a RELIGHT_LIGHTS socket carries


def _number(kind: type[Light], name: str, step: float, tooltip: str, **shown: float) -> widgets.Input:
    """Describe a parameter of a light. `shown`: another default, or a range that suits a slider."""
    declared = parameters(kind)[name]
    assert isinstance(declared, Number)
    limits = {"default": declared.default, "low": declared.low, "high": declared.high, **shown}
    return widgets.number(**limits, step=step, tooltip=tooltip)


SHARED = {
    "intensity": _number(
        Light, "intensity", 0.05,
        "At 1, a white surface that faces the light (a lamp: from one metre) is white.", high=1000.0,
    ),
    "colour": widgets.text(
        "#ffffff", "#rrggbb as a colour picker says it, or linear red/green/blue such as 1/0.9/0.8."
    ),
    "temperature": widgets.number(
        0.0, 0.0, LOCI["planckian"][1], 50.0,
        "Kelvin of a black body, from 1000: 3200 is tungsten, 5600 a flash. 0: none.",
    ),
}  # fmt: skip
NAME = widgets.text("", "The name of the light's layer in Save EXR and of its handle in the viewer.")


class LightNode:
    """A light so far away that its rays are parallel."""

    CATEGORY = "relight"
    DESCRIPTION = "A distant light: the sun, a far softbox."
    RETURN_TYPES = ("RELIGHT_LIGHTS",)
    RETURN_NAMES = ("lights",)
    OUTPUT_TOOLTIPS = ("The lights that came in, and this one.",)
    FUNCTION = "add"

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:
        """Return ComfyUI's description of the inputs."""
        return {
            "required": {
                "azimuth": _number(
                    DirectionalLight,
                    "azimuth",
                    1.0,
                    "Degrees from the camera (0) toward image right (90); 180: behind.",
                    default=-40.0,
                    low=-180.0,
                    high=180.0,
                ),
                "elevation": _number(
                    DirectionalLight,
                    "elevation",
                    1.0,
                    "Degrees up from the horizon (0) to overhead (90).",
                    default=30.0,
                ),
                **SHARED,
                "softness": _number(
                    DirectionalLight,
                    "angle",
                    1.0,
                    "Angular diameter in degrees: 0 a hard light, tens a softbox.",
                ),
            },
            "optional": {"lights": widgets.CHAINED, "name": NAME},
        }

    def add(
        self,
        azimuth: float,
        elevation: float,
        intensity: float = 1.0,
        colour: str = "#ffffff",
        temperature: float = 0.0,
        softness: float = 0.0,
        lights: Lights = (),
        name: str = "",
    ) -> tuple[Lights]:
        """Add a `relight.DirectionalLight` to the lights."""
        added = DirectionalLight(
            azimuth=azimuth,
            elevation=elevation,
            angle=softness,
            **_shared(intensity, colour, temperature, name),
        )
        return ((*lights, added),)


class Lamp:
    """A lamp in the room, at a position."""

    CATEGORY = "relight"
    DESCRIPTION = "A lamp in the room: near the person, falling off with the square of the distance."
    RETURN_TYPES = ("RELIGHT_LIGHTS",)
    RETURN_NAMES = ("lights",)
    OUTPUT_TOOLTIPS = ("The lights that came in, and this lamp.",)
    FUNCTION = "add"

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:
        """Return ComfyUI's description of the inputs."""
        return {
            "required": {
                "x": widgets.number(-0.8, -100, 100, 0.05, "Metres to image right of the subject's middle."),
                "y": widgets.number(0.6, -100, 100, 0.05, "Metres above the subject's middle."),
                "z": widgets.number(0.6, -100, 100, 0.05, "Metres from the subject's middle to the camera."),
                **SHARED,
                "radius": _number(
                    PointLight,
                    "radius",
                    0.01,
                    "Metres, of a sphere that shines: larger is softer, and no brighter.",
                    high=10.0,
                ),
            },
            "optional": {"lights": widgets.CHAINED, "name": NAME},
        }

    def add(
        self,
        x: float,
        y: float,
        z: float,
        intensity: float = 1.0,
        colour: str = "#ffffff",
        temperature: float = 0.0,
        radius: float = 0.0,
        lights: Lights = (),
        name: str = "",
    ) -> tuple[Lights]:
        """Add a `relight.PointLight` to the lights."""
        added = PointLight((x, y, z), radius=radius, **_shared(intensity, colour, temperature, name))
        return ((*lights, added),)


class Environment:
    """Light from all around: a latitude-longitude map."""

    CATEGORY = "relight"
    DESCRIPTION = "Light from a latitude-longitude map (HDRI), given as an image or as a file."
    RETURN_TYPES = ("RELIGHT_LIGHTS",)
    RETURN_NAMES = ("lights",)
    OUTPUT_TOOLTIPS = ("The lights that came in, and the environment.",)
    FUNCTION = "add"

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:
        """Return ComfyUI's description of the inputs."""
        return {
            "required": {
                "path": widgets.text(
                    "",
                    "The map's file, .exr or .hdr, in ComfyUI's input folder or by its whole path.",
                ),
                "rotation": _number(
                    EnvironmentLight,
                    "rotation",
                    1.0,
                    "Degrees about the vertical, from the camera toward image right.",
                    low=-360.0,
                    high=360.0,
                ),
                **SHARED,
            },
            "optional": {
                "image": widgets.socket(
                    "IMAGE",
                    "The map, twice as wide as high, its centre at the camera. Values above 1 are kept.",
                ),
                "lights": widgets.CHAINED,
                "name": NAME,
            },
        }

    @classmethod
    def IS_CHANGED(cls, path: str = "", **inputs: Any) -> tuple[float, int] | None:
        """Return what tells ComfyUI that the file has changed."""
        file = _file(path)
        return (file.stat().st_mtime, file.stat().st_size) if path and file.is_file() else None

    def add(
        self,
        path: str = "",
        rotation: float = 0.0,
        intensity: float = 1.0,
        colour: str = "#ffffff",
        temperature: float = 0.0,
        image: torch.Tensor | None = None,
        lights: Lights = (),
        name: str = "",
    ) -> tuple[Lights]:
        """Add a `relight.EnvironmentLight` to the lights."""
        if (image is None) == (not path):
            raise ValueError("environment: expected a path or an image, one of the two")
        source: Any = _file(path)
        if image is not None:
            maps = pictures("image", image)
            if len(maps) > 1:
                raise ValueError(f"image: expected one latitude-longitude map, got a batch of {len(maps)}")
            source = light("image", maps[0])
        added = EnvironmentLight(source, rotation=rotation, **_shared(intensity, colour, temperature, name))
        return ((*lights, added),)


class Preset:
    """Lighting that photographers know by name."""

    CATEGORY = "relight"
    DESCRIPTION = "Lighting by name, such as rembrandt: the presets of `relight apply --preset`."
    RETURN_TYPES = ("RELIGHT_LIGHTS", "FLOAT")
    RETURN_NAMES = ("lights", "gloss")
    OUTPUT_TOOLTIPS = ("The lights that came in, and those of the preset.", "The preset's gloss, for Render.")
    FUNCTION = "add"

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:
        """Return ComfyUI's description of the inputs."""
        return {
            "required": {
                "preset": widgets.choice([*presets.document()], "The lighting's name."),
                "height": widgets.number(
                    presets.HEIGHT,
                    0.01,
                    100.0,
                    0.05,
                    "Metres of the person, as in Relight Analyse: lamps near them stand in proportion.",
                ),
            },
            "optional": {"lights": widgets.CHAINED},
        }

    def add(self, preset: str, height: float = presets.HEIGHT, lights: Lights = ()) -> tuple[Lights, float]:
        """Add the lights of a preset of `relight.presets`."""
        known = presets.presets(height)
        if preset not in known:
            raise ValueError(f"preset: expected one of {', '.join(known)}, got {preset!r}")
        return (*lights, *known[preset]), presets.gloss(preset)


def _file(path: str) -> Path:
    """Return a path; relative paths are in ComfyUI's input folder."""
    return host.folder("input") / path


def _shared(intensity: float, colour: str, temperature: float, name: str) -> dict[str, Any]:
    """Return the settings that all lights have."""
    return {
        "intensity": intensity,
        "colour": _colour(colour),
        "temperature": temperature or None,
        "name": name.strip() or None,
    }


def _colour(text: str) -> list[float]:
    """Linear Rec.709 from #rrggbb, sRGB-encoded, or from linear red/green/blue."""
    text = text.strip()
    try:
        if text.startswith("#") and len(text) == 7:
            codes = np.frombuffer(bytes.fromhex(text[1:]), np.uint8)
            return scene_linear("colour", codes.reshape(1, 1, 3))[0, 0].tolist()
        red, green, blue = map(float, text.split("/"))
        return [red, green, blue]
    except ValueError as error:
        raise ValueError(f"colour: expected #rrggbb or red/green/blue, got {text!r}") from error
