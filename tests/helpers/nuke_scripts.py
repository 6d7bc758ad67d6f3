"""An interpreter of Nuke scripts: the stock nodes that ours have, as Foundry's reference describes them.

A picture is {channel: (H, W)}, such as `rgba.red`. Nodes with knobs that are not known here are refused.
"""

import math
import re
from dataclasses import dataclass, field

import numpy as np
import OpenImageIO as oiio

RGBA = ("red", "green", "blue", "alpha")
PLACE = {"name", "xpos", "ypos", "inputs", "disable", "label"}
# The knobs of each class, as learn.foundry.com's reference names them for scripts.
KNOBS = {
    "Root": {"project_directory", "frame", "first_frame", "last_frame", "fps", "format"},
    "Read": {"file", "first", "last", "origfirst", "origlast", "raw", "label"},
    "Shuffle": {"in", "out"},
    "Multiply": {"channels", "value"},
    "Merge2": {"operation", "Achannels", "Bchannels", "output"},
    "ColorMatrix": {"channels", "matrix"},
    "Expression": {f"{kind}{n}" for kind in ("temp_name", "temp_expr", "expr") for n in range(4)},
    "MergeExpression": {f"{kind}{n}" for kind in ("temp_name", "temp_expr", "expr") for n in range(4)},
    "Remove": {"operation", "channels"},
    "Premult": set(),
    "Input": {"number"},
    "Output": set(),
    "ReLight": {"use_alpha", "normal", "position", "ambient"},
    "Phong": {"specular"},
    "Light2": {"translate"},
    "Camera2": {"translate", "focal", "haperture", "vaperture"},
}
FUNCTIONS = {
    "exp": np.exp, "max": np.maximum, "min": np.minimum, "pow": np.power, "cos": np.cos,
    "radians": np.radians, "clamp": lambda value, low=0, high=1: np.clip(value, low, high),
}  # fmt: skip

ESCAPES = {"n": "\n"}


def words_of(text):
    """The commands of a Tcl text, each a list of its words; a word in braces keeps what is within."""
    commands, words, at = [], [], 0
    while at < len(text):
        character = text[at]
        if character in " \t":
            at += 1
        elif character == "\n":
            commands.append(words)
            words, at = [], at + 1
        elif character == "{":
            depth, end = 0, at
            while True:
                if text[end] == "\\":
                    end += 1
                elif text[end] in "{}":
                    depth += 1 if text[end] == "{" else -1
                end += 1
                if depth == 0:
                    break
            words.append(text[at + 1 : end - 1])
            at = end
        elif character == '"':
            found = re.compile(r'"((?:[^"\\]|\\.)*)"', re.DOTALL).match(text, at)
            words.append(re.sub(r"\\(.)", lambda m: ESCAPES.get(m[1], m[1]), found[1]))
            at = found.end()
        else:
            found = re.compile(r"(?:[^\s\\]|\\.)+").match(text, at)
            words.append(found[0])
            at = found.end()
    return [words for words in [*commands, words] if words]


@dataclass
class Node:
    """A node: its class, the words of its knobs, and the nodes that it gets its inputs from."""

    kind: str
    knobs: dict
    inputs: list
    parent: "Script | None" = None
    user: set = field(default_factory=set)
    inside: "Script | None" = None

    @property
    def name(self):
        return self.knobs.get("name", self.kind)


class Script:
    """A script, or what is within a group."""

    def __init__(self, text):
        self.nodes, self.layers, self.group = [], {}, None
        stack, names, open_groups = [], {}, []
        place = self
        for words in words_of(text):
            if words[0] == "set":
                names[words[1]] = stack[-1]
            elif words[0] == "push":
                stack.append(None if words[1] == "0" else names[words[1].removeprefix("$")])
            elif words[0] == "add_layer":
                name, *channels = words[1].split()
                self.layers[name] = channels
            elif words[0] == "end_group":
                place.output = next(node for node in reversed(place.nodes) if node.kind == "Output")
                node, place, stack, names = open_groups.pop()
                stack.append(node)
            else:
                node = self._node(*words, stack)
                node.parent = place
                place.nodes.append(node)
                if node.kind == "Group":
                    open_groups.append((node, place, stack, names))
                    node.inside = Script("")
                    node.inside.group, place, stack, names = node, node.inside, [], {}
                elif node.kind != "Root":
                    stack.append(node)
        self.stack = stack

    @staticmethod
    def _node(kind, body, stack):
        knobs, user = {}, set()
        for words in words_of(body):
            if words[0] == "addUserKnob":
                user.add(words_of(words[1])[0][1])
            else:
                assert len(words) == 2, words
                knobs[words[0]] = words[1]
        expected = KNOBS[kind] if kind != "Group" else {"knobChanged", "updateUI"} | user
        unknown = knobs.keys() - PLACE - expected
        assert not unknown, f"{kind} has no knobs {unknown}"
        count = int(knobs.get("inputs", 0 if kind == "Root" else 1))
        return Node(kind, knobs, [stack.pop() for _ in range(count)], user=user)

    def __getitem__(self, name):
        (found,) = [node for node in self.nodes if node.name == name]
        return found


@dataclass
class Player:
    """Renders a script's nodes, read from a folder, at a frame."""

    folder: object
    frame: int = 1
    files: dict = field(default_factory=dict)  # read already

    def picture(self, node):
        """What a node shows, as {channel: (H, W)}."""
        if self._off(node):
            return self.picture(node.inputs[0])
        return getattr(self, f"_{node.kind.lower()}")(node)

    def rgba(self, node):
        """What a node shows, (H, W, 4)."""
        found = self.picture(node)
        return np.stack([found[f"rgba.{channel}"] for channel in RGBA], axis=-1)

    def _off(self, node):
        word = node.knobs.get("disable", "false")
        return word == "true" or (word.startswith("{") and bool(self.value(node, word)))

    def value(self, node, word):
        """The number of a knob's word: a number, an expression in braces, or a curve."""
        word = word.strip()
        if word.startswith("{"):
            word = words_of(word)[0][0].strip()
        if word.startswith("curve"):
            keys = [float(key) for key in re.findall(r"x(\S+)", word)]
            return float(np.interp(self.frame, keys, [float(v) for v in re.findall(r"x\S+ (\S+)", word)]))

        def known(match):
            name, channel = match[1], match[2]
            word = node.parent.group.knobs[name]
            if word in ("true", "false"):
                return str(int(word == "true"))
            parts = words_of(word)[0] if channel else [word]
            return repr(
                self.value(node, parts["rgb".index(channel)] if channel and len(parts) > 1 else parts[0])
            )

        text = re.sub(r"parent\.(\w+)(?:\.([rgb])\b)?", known, word)
        return float(eval(text.replace("!", "not "), {"__builtins__": {}}, FUNCTIONS))

    def values(self, node, knob, count):
        words = words_of(node.knobs[knob])
        words = [word for line in words for word in line]
        parts = [f"{{{word}}}" if not re.fullmatch(r"[-+.\de]+", word) else word for word in words]
        return [self.value(node, part) for part in (parts if len(parts) > 1 else parts * count)]

    # Classes of nodes.

    def _read(self, node):
        file = str(self.folder / node.knobs["file"])
        file = re.sub(r"%0(\d)d", lambda m: f"{self.frame:0{m[1]}d}", file)
        if file not in self.files:
            self.files[file] = self._channels(oiio.ImageBuf(file))
        return self.files[file]

    @staticmethod
    def _channels(buffer):
        spec, roi = buffer.spec(), buffer.roi_full
        pixels = np.zeros((roi.height, roi.width, spec.nchannels), np.float32)
        window = np.s_[spec.y : spec.y + spec.height, spec.x : spec.x + spec.width]
        pixels[window] = buffer.get_pixels("float")
        short = dict(zip("RGBA", RGBA, strict=True))
        channels = {}
        for index, name in enumerate(spec.channelnames):
            layer, _, channel = name.rpartition(".")
            layer = re.sub(r"\W", "_", layer) or "rgba"
            channels[f"{layer}.{short.get(channel, channel)}"] = pixels[..., index]
        empty = np.zeros(pixels.shape[:2], np.float32)
        return {f"rgba.{channel}": empty for channel in RGBA} | channels

    def _input(self, node):
        group = node.parent.group
        return self.picture(group.inputs[int(node.knobs.get("number", 0))])

    def _group(self, node):
        return self.picture(node.inside.output)

    def _output(self, node):
        return self.picture(node.inputs[0])

    def _shuffle(self, node):
        found = self.picture(node.inputs[0])
        assert node.knobs["out"] == "rgb"
        return found | {f"rgba.{c}": found[f"{node.knobs['in']}.{c}"] for c in RGBA[:3]}

    def _multiply(self, node):
        found, factors = self.picture(node.inputs[0]), self.values(node, "value", 4)
        assert node.knobs["channels"] == "rgb"
        return found | {f"rgba.{c}": found[f"rgba.{c}"] * f for c, f in zip(RGBA[:3], factors, strict=False)}

    def _merge2(self, node):
        below, above = map(self.picture, node.inputs)
        assert (node.knobs["operation"], node.knobs["output"]) == ("plus", "rgb")
        return below | {f"rgba.{c}": above[f"rgba.{c}"] + below[f"rgba.{c}"] for c in RGBA[:3]}

    def _colormatrix(self, node):
        """The rows are for red, green and blue of the output, of the layer that `channels` names."""
        found, layer = self.picture(node.inputs[0]), node.knobs["channels"]
        names = [f"{layer}.{c}" for c in RGBA[:3]]
        keys = node.knobs.get("matrix_keys", {})
        matrix = np.array(keys.get(self.frame) or self._rows(node))
        mixed = np.tensordot(np.stack([found[name] for name in names], axis=-1), matrix.reshape(3, 3).T, 1)
        return found | {name: mixed[..., index] for index, name in enumerate(names)}

    def _rows(self, node):
        if isinstance(node.knobs["matrix"], list):
            return node.knobs["matrix"]
        return [float(value) for row in words_of(node.knobs["matrix"])[0] for value in row.split()]

    def _expression(self, node):
        found = self.picture(node.inputs[0])
        return self._computed(node, found, {"": found})

    def _mergeexpression(self, node):
        below, above = map(self.picture, node.inputs)
        return self._computed(node, below, {"A": above, "B": below})

    def _computed(self, node, through, pictures):
        """`through`, with the expressions of its knobs in red, green, blue and alpha."""
        scope = dict(FUNCTIONS)
        for prefix, picture in pictures.items():
            scope |= {f"{prefix}{channel[0]}": picture[f"rgba.{channel}"] for channel in RGBA}
            scope |= {prefix + name.replace(".", "__"): values for name, values in picture.items()}

        def knob(match):
            return repr(self.value(node, node.parent.group.knobs[match[1]]))

        def evaluate(text):
            text = re.sub(r"parent\.(\w+)", knob, text)
            return eval(re.sub(r"([A-Za-z]\w*)\.(\w+)", r"\1__\2", text), {"__builtins__": {}}, scope)

        with np.errstate(over="ignore"):
            for index in range(4):
                if f"temp_name{index}" in node.knobs:
                    scope[node.knobs[f"temp_name{index}"]] = evaluate(node.knobs[f"temp_expr{index}"])
            results = {
                f"rgba.{channel}": evaluate(node.knobs[f"expr{index}"])
                for index, channel in enumerate(RGBA)
                if f"expr{index}" in node.knobs
            }
        return through | results

    def _remove(self, node):
        assert (node.knobs["operation"], node.knobs["channels"]) == ("keep", "rgba")
        found = self.picture(node.inputs[0])
        return {name: found[name] for name in found if name.startswith("rgba.")}

    def _premult(self, node):
        found = self.picture(node.inputs[0])
        return found | {f"rgba.{c}": found[f"rgba.{c}"] * found["rgba.alpha"] for c in RGBA[:3]}


class NukeModule:
    """The part of Nuke's Python module that callbacks use, around the group that they belong to."""

    def __init__(self, group, axes=None, frames=(1, 1)):
        self.group, self.axes, self.frames = group, axes or {}, frames

    def run(self, knob="knobChanged"):
        """Run a callback of the group, as Nuke does after a change."""
        exec(compile(self.group.knobs[knob], knob, "exec"), {"nuke": self, "__name__": "__main__"})

    def thisNode(self):
        return Handle(self.group, self.axes)

    def root(self):
        return {"first_frame": Value(self.frames[0]), "last_frame": Value(self.frames[1])}


class Value:
    """A knob that does not change, or that is a function of the frame."""

    def __init__(self, value):
        self.held = value

    def value(self):
        return self.held

    def getValueAt(self, frame, index=0):
        value = self.held(frame) if callable(self.held) else self.held
        return value[index] if np.ndim(value) else value


class Handle:
    """A node as Python sees it in Nuke."""

    def __init__(self, node, axes=None):
        self._node, self._axes = node, axes or {}

    def __getitem__(self, name):
        return KnobHandle(self._node, name)

    def node(self, name):
        return Handle(self._node.inside[name])

    def input(self, index):
        return {"world_matrix": Value(self._axes[index])} if index in self._axes else None


class KnobHandle:
    """A knob of a node of the script as Python sees it in Nuke."""

    def __init__(self, node, name):
        assert name in node.knobs or name in node.user
        self.node, self.name = node, name

    def value(self):
        return self.node.knobs.get(self.name, "")

    def getValueAt(self, frame, index=0):
        return Player(None, frame).value(self.node, self.value())

    def setValue(self, value, index=None):
        if index is None:
            self.node.knobs[self.name] = value
        else:
            self._matrix()[index] = value

    def _matrix(self):
        held = self.node.knobs[self.name]
        if not isinstance(held, list):
            held = self.node.knobs[self.name] = Player(None)._rows(self.node)
        return held

    def setAnimated(self):
        self._matrix()
        self.node.knobs[f"{self.name}_keys"] = {}

    def clearAnimated(self):
        self.node.knobs.pop(f"{self.name}_keys", None)

    def setValueAt(self, value, frame, index):
        self.node.knobs[f"{self.name}_keys"].setdefault(frame, [0.0] * 9)[index] = value


def spherical(azimuth, elevation):
    """A world matrix, 16 numbers row by row, of an Axis two metres away in this direction."""
    a, e = math.radians(azimuth), math.radians(elevation)
    place = 2 * np.array([math.cos(e) * math.sin(a), math.sin(e), math.cos(e) * math.cos(a)])
    matrix = np.eye(4)
    matrix[:3, 3] = place
    return matrix.ravel().tolist()
