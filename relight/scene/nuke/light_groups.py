"""A Nuke script that rebuilds a picture from its light groups, with a Multiply for each light.

The script is plain text: nodes with their knobs, connected through a stack as Nuke's own files are. A node
takes its inputs from the stack and puts itself there; `set` names what is on top, `push` puts it there again.
"""

import os
from collections.abc import Iterable, Mapping
from fractions import Fraction
from pathlib import Path

from relight.scene.nuke.nodes import layer, literal, node, read_from, root, span, word_of
from relight.scene.nuke.relight_node import LiveLight, sources, switch
from shadow.files import AnyPath, replacing

BACKGROUND = "background"  # the group that shows no person
STEP = 110  # width of a column in the node graph


def is_script(path: AnyPath) -> bool:
    """Return whether a file name is that of a Nuke script."""
    return Path(path).suffix.lower() == ".nk"


def write_script(
    path: AnyPath,
    groups: Mapping[str, tuple[AnyPath, str | None]],
    size: tuple[int, ...],
    *,
    frames: tuple[int, int] | None = None,
    rate: float | Fraction = 24,
    pixel_aspect: float = 1.0,
    live: LiveLight | None = None,
) -> None:
    """Write the script. It finds the files relative to itself, so folder and script may move together.

    `groups`: {light name: (file, layer)}, where its light group is. `layer` is the name of an OpenEXR layer
    with red, green and blue, or None for the file's own picture. A file may be a sequence, `a.%04d.exr`.
    `size`: (height, width) of the pictures in pixels, which are `pixel_aspect` times as wide as high.
    `frames`: (first, last) frame of sequences, `rate` a second; None for stills. `live`: the camera of
    pictures with the passes albedo, N and P: adds a group, disabled at first, in which Nuke's own ReLight
    node takes the place of the person's light groups.

    Raises ValueError for no group, or layers that are one to Nuke (see `check_layers`); OSError if the script
    cannot be written.
    """
    path = Path(path)
    if not groups:
        raise ValueError("groups: expected at least one")
    names = check_layers(layer_name for _, layer_name in groups.values() if layer_name is not None).values()
    blocks = [root(size, frames, rate, pixel_aspect)]
    blocks += [layer(name, ("red", "green", "blue", "alpha")) for name in names]
    reads: dict[AnyPath, str] = {}
    words: list[str] = []
    lit = [name for name in groups if name != BACKGROUND]
    if live is not None:
        blocks += [layer(name, "XYZ") for name in ("N", "P")]
        blocks += [layer("albedo", ("red", "green", "blue")), *sources(live, size, pixel_aspect)]
    for column, (name, (file, layer_name)) in enumerate(groups.items()):
        position: dict[str, object] = {"xpos": column * STEP}
        word = word_of(name)
        while word in words:  # two nodes need two names
            word += "_"
        words.append(word)
        if file in reads:
            blocks.append(f"push ${reads[file]}")
        else:
            reads[file] = f"N{len(reads) + 1}"
            relative = Path(os.path.relpath(file, path.parent)).as_posix()
            knobs = span(frames) | {"name": f"Read{len(reads)}"} | read_from(path) | position
            blocks.append(node("Read", inputs=0, file=literal(relative), **knobs, ypos=-120))
            blocks.append(f"set {reads[file]} [stack 0]")
        if layer_name is not None:
            knobs = {"in": word_of(layer_name), "out": "rgb", "name": f"Shuffle_{word}"} | position
            blocks.append(node("Shuffle", **knobs, ypos=0))
        knobs = {"channels": "rgb", "value": 1, "name": f"Multiply_{word}", "label": literal(name)} | position
        blocks.append(node("Multiply", **knobs, ypos=80))
        if column:
            knobs = {"operation": "plus", "Achannels": "rgb", "Bchannels": "rgb", "output": "rgb"} | position
            blocks.append(node("Merge2", inputs=2, **knobs, name=f"Plus_{word}", ypos=160))
        if live is not None and layer_name is not None and name == lit[-1]:
            blocks += switch(word_of(layer_name), column * STEP)
    with replacing(path) as beside:
        beside.write_text("\n".join(blocks) + "\n", encoding="utf-8")


def check_layers(layers: Iterable[str]) -> dict[str, str]:
    """{layer of an OpenEXR file: its name in Nuke}.

    Nuke reads every character but ASCII letters, digits and underscores as an underscore. Raises ValueError
    for layers that it would take for one: neither it nor a script can tell these apart.
    """
    words: dict[str, str] = {}
    for name in layers:
        same = [other for other, word in words.items() if word == word_of(name) and other != name]
        if same:
            raise ValueError(
                f"layers: {same[0]!r} and {name!r} are one to Nuke, {word_of(name)}; rename one of the "
                "lights with ASCII letters, digits and underscores"
            )
        words[name] = word_of(name)
    return words
