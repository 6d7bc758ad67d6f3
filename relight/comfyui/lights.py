"""The nodes that make lights. Each adds one to those that come in, so that they chain."""

from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from annotated_types import Interval, Le

from relight import quantities
from relight.arguments import About, about
from relight.comfyui import host, widgets
from relight.comfyui.subjects import SubjectBatch
from relight.comfyui.tensors import light, pictures
from relight.lights import presets
from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light, Settings
from relight.lights.near import PointLight
from relight.lights.rig import scaled
from relight.media.colour import LOCI

Lights = tuple[Light, ...]  # what a RELIGHT_LIGHTS socket carries
PRESETS = [*presets.document()]


Intensity = Annotated[quantities.Intensity, Le(1000), widgets.Step(0.05)]
Colour = Annotated[str, About((about(quantities.GivenColour) or About()).help)]
Kelvin = Annotated[
    float,
    Interval(ge=0, le=LOCI["planckian"][1]),
    widgets.Step(50.0),
    About("Kelvin of a black body, from 1000: 3200 is tungsten, 5600 a flash. 0: none."),
]
Chained = Annotated[Lights, widgets.CHAINED]
Name = Annotated[str, About("The name of the light's layer in Save EXR and of its handle in the viewer.")]


class LightsNode(widgets.Node):
    """A node that adds lights to those that come in."""

    RETURN_TYPES: tuple[str, ...] = ("RELIGHT_LIGHTS",)
    RETURN_NAMES: tuple[str, ...] = ("lights",)
    FUNCTION = "add"


class LightNode(LightsNode):
    """A light so far away that its rays are parallel."""

    DESCRIPTION = "A distant light: the sun, a far softbox."
    OUTPUT_TOOLTIPS = ("The lights that came in, and this one.",)

    def add(
        self,
        azimuth: Annotated[
            quantities.Azimuth,
            Interval(ge=-180.0, le=180.0),
            widgets.Step(1.0),
        ] = -40.0,
        elevation: Annotated[
            quantities.Elevation,
            widgets.Step(1.0),
        ] = 30.0,
        intensity: Intensity = 1.0,
        colour: Colour = "#ffffff",
        temperature: Kelvin = 0.0,
        softness: Annotated[
            quantities.Diameter,
            widgets.Step(1.0),
        ] = 0.0,
        *,
        lights: Chained = (),
        name: Name = "",
    ) -> tuple[Lights]:
        """Add a `relight.DirectionalLight` to the lights."""
        added = DirectionalLight(
            azimuth=azimuth,
            elevation=elevation,
            angle=softness,
            **_shared(intensity, colour, temperature, name),
        )
        return ((*lights, added),)


class Lamp(LightsNode):
    """A lamp in the room, at a position."""

    DESCRIPTION = "A lamp in the room: near the person, falling off with the square of the distance."
    OUTPUT_TOOLTIPS = ("The lights that came in, and this lamp.",)

    def add(
        self,
        x: Annotated[
            float,
            Interval(ge=-100, le=100),
            widgets.Step(0.05),
            About("Metres to image right of the subject's middle."),
        ] = -0.8,
        y: Annotated[
            float, Interval(ge=-100, le=100), widgets.Step(0.05), About("Metres above the subject's middle.")
        ] = 0.6,
        z: Annotated[
            float,
            Interval(ge=-100, le=100),
            widgets.Step(0.05),
            About("Metres from the subject's middle to the camera."),
        ] = 0.6,
        intensity: Intensity = 1.0,
        colour: Colour = "#ffffff",
        temperature: Kelvin = 0.0,
        radius: Annotated[
            quantities.Radius,
            Interval(le=10.0),
            widgets.Step(0.01),
        ] = 0.0,
        *,
        lights: Chained = (),
        name: Name = "",
    ) -> tuple[Lights]:
        """Add a `relight.PointLight` to the lights."""
        added = PointLight((x, y, z), radius=radius, **_shared(intensity, colour, temperature, name))
        return ((*lights, added),)


class Environment(LightsNode):
    """Light from all around: a latitude-longitude map."""

    DESCRIPTION = "Light from a latitude-longitude map (HDRI), given as an image or as a file."
    OUTPUT_TOOLTIPS = ("The lights that came in, and the environment.",)

    @classmethod
    def IS_CHANGED(cls, path: str = "", **inputs: object) -> tuple[float, int] | None:
        """Return what tells ComfyUI that the file has changed."""
        file = _file(path)
        return (file.stat().st_mtime, file.stat().st_size) if path and file.is_file() else None

    def add(
        self,
        path: Annotated[
            str, About("The map's file, .exr or .hdr, in ComfyUI's input folder or by its whole path.")
        ] = "",
        rotation: Annotated[
            quantities.Rotation,
            Interval(ge=-360.0, le=360.0),
            widgets.Step(1.0),
        ] = 0.0,
        intensity: Intensity = 1.0,
        colour: Colour = "#ffffff",
        temperature: Kelvin = 0.0,
        *,
        image: Annotated[
            torch.Tensor | None,
            widgets.Socket(
                "IMAGE", "The map, twice as wide as high, its centre at the camera. Values above 1 are kept."
            ),
        ] = None,
        lights: Chained = (),
        name: Name = "",
    ) -> tuple[Lights]:
        """Add a `relight.EnvironmentLight` to the lights."""
        if (image is None) == (not path):
            raise ValueError("environment: expected a path or an image, one of the two")
        source: Path | np.ndarray = _file(path)
        if image is not None:
            maps = pictures("image", image)
            if len(maps) > 1:
                raise ValueError(f"image: expected one latitude-longitude map, got a batch of {len(maps)}")
            source = light("image", maps[0])
        added = EnvironmentLight(source, rotation=rotation, **_shared(intensity, colour, temperature, name))
        return ((*lights, added),)


class Preset(LightsNode):
    """Lighting that photographers know by name."""

    DESCRIPTION = "Lighting by name, such as rembrandt: the presets of `relight apply --preset`."
    RETURN_TYPES = ("RELIGHT_LIGHTS", "FLOAT")
    RETURN_NAMES = ("lights", "gloss")
    OUTPUT_TOOLTIPS = ("The lights that came in, and those of the preset.", "The preset's gloss, for Render.")

    def add(
        self,
        preset: Annotated[str, widgets.Choice(PRESETS), About("The lighting's name.")] = PRESETS[0],
        height: Annotated[
            float,
            Interval(ge=0.01, le=100.0),
            widgets.Step(0.05),
            About("Metres of the person, as in Relight Analyse: lamps near them stand in proportion."),
        ] = presets.HEIGHT,
        *,
        lights: Chained = (),
        subject: Annotated[
            SubjectBatch | None,
            widgets.Socket(
                "RELIGHT_SUBJECT",
                "The analysed person: the lights leave the face as bright as it is in the photograph.",
            ),
        ] = None,
    ) -> tuple[Lights, float]:
        """Add the lights of a preset, with a subject those of `Subject.preset` of the first frame."""
        added = presets.named(preset, height=height)
        if subject is not None and subject.shown is not None:
            added = scaled(added, subject.shown.preset_gain(preset))
        return (*lights, *added), presets.gloss(preset)


def _file(path: str) -> Path:
    """Return a path; relative paths are in ComfyUI's input folder."""
    return host.folder("input") / path


def _shared(intensity: float, colour: str, temperature: float, name: str) -> Settings:
    """Return the settings that all lights have."""
    return {
        "intensity": intensity,
        "colour": colour,
        "temperature": temperature or None,
        "name": name.strip() or None,
    }
