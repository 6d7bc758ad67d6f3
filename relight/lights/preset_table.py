"""What `relight/presets.yaml` says, without the classes of lights."""

import functools
from importlib.resources import files
from typing import Any, NotRequired, TypedDict

import yaml

from relight.arguments import meant, shown


class Preset(TypedDict):
    """A lighting preset: what people read of it, the entries of a lights file, and its gloss."""

    title: str
    about: str
    lights: list[dict[str, Any]]
    gloss: NotRequired[float]


@functools.cache
def document() -> dict[str, Preset]:
    """Return the file: {name: {"title", "about": words, "lights": entries of a lights file, "gloss"}}."""
    return yaml.safe_load(files("relight").joinpath("presets.yaml").read_text(encoding="utf-8"))


def known(text: str) -> str:
    """Return a preset's name as the file has it: `Golden Hour` is golden-hour. ValueError for no preset."""
    names = list(document())
    if (name := text.strip().lower().replace(" ", "-").replace("_", "-")) in names:
        return name
    near = meant(name, names)
    hint = f"did you mean {near}?" if near else f"there are {', '.join(names)}"
    raise ValueError(f"no preset is called {shown(text)}; {hint}")
