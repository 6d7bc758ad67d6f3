"""Write the viewer's page: one HTML file that holds the person, the lights and the program."""

import base64
import functools
import html
import json
import re
from importlib.resources import files
from pathlib import Path

import numpy as np

from relight.analysis.record import AnalysisRecord
from relight.viewer import SUFFIXES, constants
from relight.viewer.initial_state import SceneState
from relight.viewer.packing import pack
from shadow.files import AnyPath, check_writable, replacing

# The program's files, each after those that it imports from.
MODULES = (
    "pack", "lights", "room", "gl", "engine", "colour", "environment", "opened", "dom", "sliders", "ball",
    "state", "draft", "png", "zoom", "stage", "plan", "inspector", "sheet", "surround", "controls", "actions",
    "keys", "painting", "brush", "viewer", "entry",
)  # fmt: skip


def write_page(
    path: AnyPath, scene: SceneState, record: AnalysisRecord, matte: np.ndarray, albedo: np.ndarray
) -> Path:
    """Write a person's page, .html or .htm, whole or not at all.

    `scene`: what the page begins with, see `relight.viewer.initial_state`; the rest: see
    `relight.viewer.packing.pack`. Raises ValueError for another suffix, OSError if the file cannot be
    written.
    """
    target = check_writable(path, SUFFIXES)
    text = page(scene, pack(record, matte, albedo))
    with replacing(target) as beside:
        beside.write_text(text, encoding="utf-8")
    return target


def page(scene: SceneState, packed: bytes) -> str:
    """Return the page as text, from what `relight.viewer.initial_state` and `relight.viewer.packing` make."""
    return _text("page.html").format(
        title=html.escape(scene["title"]),
        style=style(),
        scene=_within_script(json.dumps(scene)),
        pack=base64.b64encode(packed).decode(),
        module=module(),
    )


@functools.cache
def module() -> str:
    """Return the program as one ES module without exports: constants, shaders, and its files in order."""
    names = sorted(file.name for file in files("relight.viewer").joinpath("web", "shaders").iterdir())
    shaders = {name.removesuffix(".glsl"): _text(f"shaders/{name}") for name in names}
    shaders["common"] += constants.of_the_shaders()
    given = {"SHADERS": shaders, "PYTHON": constants.of_the_program()}
    parts = [f"const {name} = {_within_script(json.dumps(value))};" for name, value in given.items()]
    for name in MODULES:
        text = re.sub(r"^import [^;]*;\n", "", _text(f"{name}.js"), flags=re.MULTILINE)
        parts.append(re.sub(r"^export (?=async|class|const|function)", "", text, flags=re.MULTILINE))
    return "\n".join(parts)


def style() -> str:
    """Return the page's style sheet, all of whose rules are below `.relight`."""
    return _text("style.css")


def _text(name: str) -> str:
    return files("relight.viewer").joinpath("web", name).read_text(encoding="utf-8")


def _within_script(text: str) -> str:
    """Escape JSON so that no text ends the script element that holds it (`</script>`, `<!--`)."""
    return text.replace("<", "\\u003c")
