"""Writes the viewer's page: one HTML file that holds the person, the lights and the program."""

import base64
import functools
import html
import json
import re
from collections.abc import Iterable, Mapping
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light, by_name
from relight.media.colour import LOCI, temperature
from relight.viewer.packing import pack

if TYPE_CHECKING:
    from relight.subject import Subject

MODULES = ("pack", "lights", "environment", "engine", "state", "texts", "png", "controls", "stage", "viewer")
SHADERS = ("quad", "common", "light", "sum", "prepare", "enlarge", "compose", "reduce", "show")
LIGHTS = 8  # at most, and one environment
MIREDS = (25.0, 1000.0, 66)  # of the table of temperatures: first, last, how many
KEY = {"azimuth": -40.0, "elevation": 30.0, "angle": 10.0, "name": "key"}  # where no lights are given


def page(subject: "Subject", scene: Mapping[str, Any], title: str = "relight") -> str:
    """The page as text. `scene` is what `scene_of` gives."""
    return _text("page.html").format(
        title=html.escape(title),
        style=_text("style.css"),
        scene=_within_script(json.dumps(scene)),
        pack=base64.b64encode(pack(subject)).decode(),
        module=module(),
    )


@functools.cache
def module() -> str:
    """The viewer as one ES module: its files one after the other, and its shaders."""
    shaders = {name: _text(f"shaders/{name}.glsl") for name in SHADERS}
    parts = [f"const SHADERS = {_within_script(json.dumps(shaders))};"]
    for name in MODULES:
        text = re.sub(r"^import [^;]*;\n", "", _text(f"{name}.js"), flags=re.MULTILINE)
        parts.append(re.sub(r"^export (?=async|class|const|function)", "", text, flags=re.MULTILINE))
    return "\n".join(parts)


def _text(name: str) -> str:
    return files("relight.viewer").joinpath("web", name).read_text(encoding="utf-8")


def _within_script(text: str) -> str:
    """JSON that no text in it ends the script element of (`</script>`, `<!--`)."""
    return text.replace("<", "\\u003c")
