"""A Nuke script that rebuilds a picture from its light groups, with a Multiply for each light to mix anew.

The script is plain text: nodes with their knobs, connected through a stack as Nuke's own files are. A node
takes its inputs from the stack and puts itself there; `set` names what is on top, `push` puts it there again.
"""

import os
import re
from collections.abc import Iterable, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

from shadow.files import AnyPath, replacing

STEP = 110  # width of a column in the node graph


def write_script(
    path: AnyPath,
    groups: Mapping[str, tuple[AnyPath, str | None]],
    size: tuple[int, ...],
    *,
    frames: tuple[int, int] | None = None,
    rate: float | Fraction = 24,
) -> None:
    """Write the script. It finds the files relative to itself, so folder and script may move together.

    Parameters
    ----------
    path: the script, .nk. Its folder must exist.
    groups: {light name: (file, layer)}: where its light group is. `layer` is the name of an OpenEXR layer
        with red, green and blue, or None for the file's own picture. A file may be a sequence, `a.%04d.exr`.
    size: (height, width) of the pictures in pixels.
    frames: (first, last) frame of sequences; None for stills.
    rate: frames a second.

    Raises
    ------
    ValueError: no group, or layers that are one to Nuke (see `check_layers`). OSError: the script cannot be
    written.
    """
    path = Path(path)
    if not groups:
        raise ValueError("groups: expected at least one")
    layers = list(check_layers(layer for _, layer in groups.values() if layer is not None).values())
    blocks = [_root(size, frames, rate)]
    blocks += [f"add_layer {{{name} {name}.red {name}.green {name}.blue {name}.alpha}}" for name in layers]
    reads: dict[AnyPath, str] = {}
    words: list[str] = []
    for column, (name, (file, layer)) in enumerate(groups.items()):
        place: dict[str, object] = {"xpos": column * STEP}
        word = _word(name)
        while word in words:  # two nodes need two names
            word += "_"
        words.append(word)
        if file in reads:
            blocks.append(f"push ${reads[file]}")
        else:
            reads[file] = f"N{len(reads) + 1}"
            relative = Path(os.path.relpath(file, path.parent)).as_posix()
            knobs = _span(frames) | {"name": f"Read{len(reads)}"} | place
            blocks.append(_node("Read", inputs=0, file=_quoted(relative), **knobs, ypos=-120))
            blocks.append(f"set {reads[file]} [stack 0]")
        if layer is not None:
            knobs = {"in": _word(layer), "out": "rgb", "name": f"Shuffle_{word}"} | place
            blocks.append(_node("Shuffle", **knobs, ypos=0))
        knobs = {"channels": "rgb", "value": 1, "name": f"Multiply_{word}", "label": _quoted(name)} | place
        blocks.append(_node("Multiply", **knobs, ypos=80))
        if column:
            knobs = {"operation": "plus", "Achannels": "rgb", "Bchannels": "rgb", "output": "rgb"} | place
            blocks.append(_node("Merge2", inputs=2, **knobs, name=f"Plus_{word}", ypos=160))
    with replacing(path) as beside:
        beside.write_text("\n".join(blocks) + "\n", encoding="utf-8")


def check_layers(layers: Iterable[str]) -> dict[str, str]:
    """{layer of an OpenEXR file: its name in Nuke}.

    Nuke reads every character but ASCII letters, digits and underscores as an underscore. ValueError for
    layers that it would take for one: neither it nor a script can tell these apart.
    """
    words: dict[str, str] = {}
    for layer in layers:
        same = [other for other, word in words.items() if word == _word(layer) and other != layer]
        if same:
            raise ValueError(
                f"layers: {same[0]!r} and {layer!r} are one to Nuke, {_word(layer)}; rename one of the "
                "lights with ASCII letters, digits and underscores"
            )
        words[layer] = _word(layer)
    return words


def _root(size: tuple[int, ...], frames: tuple[int, int] | None, rate: float | Fraction) -> str:
    first, last = frames or (1, 1)
    height, width = size
    return _node(
        "Root",
        inputs=0,
        project_directory=r'"\[python \{nuke.script_directory()\}]"',
        frame=first,
        first_frame=first,
        last_frame=last,
        fps=f"{float(rate):g}",
        format=f'"{width} {height} 0 0 {width} {height} 1 relight"',
    )


def _span(frames: tuple[int, int] | None) -> dict[str, int]:
    """A Read's knobs for the frames of a sequence."""
    if frames is None:
        return {}
    first, last = frames
    return {"first": first, "last": last, "origfirst": first, "origlast": last}


def _node(kind: str, **knobs: Any) -> str:
    return "\n".join([f"{kind} {{", *(f" {knob} {value}" for knob, value in knobs.items()), "}"])


def _word(name: str) -> str:
    """A name as Nuke takes it for nodes and layers: letters, digits and underscores."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _quoted(text: str) -> str:
    """A text as Tcl reads it back, braces and brackets included."""
    return '"' + re.sub(r'([\\"\[\]{}$])', r"\\\1", text) + '"'
