"""Writes the viewer's page: one HTML file that holds the person, the lights and the program."""

import base64
import functools
import html
import json
import re
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from relight.viewer.packing import pack
from shadow.files import AnyPath, check_writable, replacing

if TYPE_CHECKING:
    from relight.subject import Subject

SUFFIXES = (".html", ".htm")

# The program's files, each after those that it imports from.
MODULES = (
    "pack", "lights", "room", "engine", "environment", "dom", "ball", "state", "png", "stage", "controls",
    "actions", "keys", "viewer",
)  # fmt: skip
SHADERS = ("quad", "common", "light", "near", "sum", "prepare", "enlarge", "compose", "reduce", "show")


def write_page(path: AnyPath, scene: Mapping[str, Any], subject: "Subject") -> Path:
    """Write a subject's page, whole or not at all; ValueError for a path of another suffix."""
    target = check_writable(path, SUFFIXES)
    text = page(scene, pack(subject))
    with replacing(target) as beside:
        beside.write_text(text, encoding="utf-8")
    return target


def page(scene: Mapping[str, Any], packed: bytes) -> str:
    """The page as text, from what `relight.viewer.scene` and `relight.viewer.packing` make."""
    return _text("page.html").format(
        title=html.escape(scene["title"]),
        style=style(),
        scene=_within_script(json.dumps(scene)),
        pack=base64.b64encode(packed).decode(),
        module=module(),
    )


@functools.cache
def module() -> str:
    """The program as one ES module, its files one after the other, with its shaders; exports none."""
    shaders = {name: _text(f"shaders/{name}.glsl") for name in SHADERS}
    parts = [f"const SHADERS = {_within_script(json.dumps(shaders))};"]
    for name in MODULES:
        text = re.sub(r"^import [^;]*;\n", "", _text(f"{name}.js"), flags=re.MULTILINE)
        parts.append(re.sub(r"^export (?=async|class|const|function)", "", text, flags=re.MULTILINE))
    return "\n".join(parts)


def style() -> str:
    """The page's style sheet, which keeps to what is within `.relight`."""
    return _text("style.css")


def _text(name: str) -> str:
    return files("relight.viewer").joinpath("web", name).read_text(encoding="utf-8")


def _within_script(text: str) -> str:
    """JSON in which no text ends the script element that holds it (`</script>`, `<!--`)."""
    return text.replace("<", "\\u003c")
