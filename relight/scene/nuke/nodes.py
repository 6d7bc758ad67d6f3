"""The text of Nuke's nodes: knobs are words as Tcl reads them."""

import re
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path


def root(
    size: tuple[int, ...], frames: tuple[int, int] | None, rate: float | Fraction, pixel_aspect: float = 1
) -> str:
    """Write the script's settings: its format of `size` (H, W) pixels, its frames and frames a second.

    Files are named relative to the script's folder. The format is named for its size: Nuke keeps one each.
    """
    first, last = frames or (1, 1)
    height, width = size
    name = f"relight_{width}x{height}" + (f"_{pixel_aspect:g}" if pixel_aspect != 1 else "")
    return node(
        "Root",
        inputs=0,
        project_directory=r'"\[python \{nuke.script_directory()\}]"',
        frame=first,
        first_frame=first,
        last_frame=last,
        fps=f"{float(rate):g}",
        format=f'"{width} {height} 0 0 {width} {height} {pixel_aspect:g} {name}"',
    )


def read_from(script: Path) -> dict[str, str]:
    """Return the knob of a Read node that says what its file is relative to.

    Nuke searches another folder after the script was inserted into another one.
    """
    return {"label": literal(f"relative to {script.name}")}


def layer(name: str, channels: Iterable[str]) -> str:
    """Declare a layer and its channels, as a script does before it uses them."""
    return f"add_layer {{{name} {' '.join(f'{name}.{channel}' for channel in channels)}}}"


def span(frames: tuple[int, int] | None) -> dict[str, int]:
    """Return the knobs of a Read node for the frames of a sequence."""
    if frames is None:
        return {}
    first, last = frames
    return {"first": first, "last": last, "origfirst": first, "origlast": last}


def node(kind: str, **knobs: object) -> str:
    """Write a node of a class with its knobs; the values are words as Tcl reads them."""
    return "\n".join([f"{kind} {{", *(f" {knob} {value}" for knob, value in knobs.items()), "}"])


def word_of(name: str) -> str:
    """Return a name that Nuke accepts for nodes and layers: letters, digits and underscores."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def literal(text: str) -> str:
    """Quote a file name or a label, which Nuke evaluates as Tcl when it uses it."""
    return quoted(re.sub(r"([\\\[\]$])", r"\\\1", text))


def quoted(text: str) -> str:
    """Quote a text for Tcl, including braces, brackets and line breaks."""
    return '"' + re.sub(r'([\\"\[\]{}$])', r"\\\1", text).replace("\n", "\\n") + '"'
