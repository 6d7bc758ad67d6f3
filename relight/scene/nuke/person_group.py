"""A Nuke script with a group that lights a person: knobs for four lights, whose shadows move too.

All nodes are built into Nuke. A light's three directions are the rows of the matrices of its ColorMatrix
nodes, one for each layer. Red, green and blue of a layer are then what its three components add to the
light's three directions, and an Expression makes the shading of them, as `shading.diffuse.Shading` does.
"""

import inspect
import math
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

from relight.analysis.gloss import BEND, DEPTH, FORWARD, MIN_COSINE
from relight.lights.directional import DirectionalLight
from relight.lights.rig import as_rig
from relight.scene.nuke import callback
from relight.scene.nuke.callback import LIGHTS, direction, matrices, samples
from relight.scene.nuke.layers import CAST_LAYERS, LAYERS, NAMES, PHOTOGRAPH, RESIDUAL_LAYERS, Basis
from relight.scene.nuke.light_groups import is_script
from relight.scene.nuke.nodes import layer, literal, node, quoted, read_from, root, span
from shading.diffuse import RESIDUAL_BIAS
from shadow.files import AnyPath, replacing
from shadow.networks.field import LIT_LOGIT

COLUMN, ROW = 110, 26  # of the node graph
CHANNELS = ("red", "green", "blue")
KEY = DirectionalLight(azimuth=-40, elevation=30, name="key")  # unless lights are given


def write(
    path: AnyPath,
    picture: AnyPath,
    basis: Basis,
    lights: Sequence[DirectionalLight],
    size: tuple[int, int],
    *,
    frames: tuple[int, int] | None = None,
    rate: float | Fraction = 24,
    gloss: float = 0.0,
    amount: float = 1.0,
) -> None:
    """Write the script. It finds the pictures in its own folder.

    `picture`: the file with the layers, of `size` (H, W), or the sequence, such as `person.%04d.exr`;
    `basis`: what the layers are components of. `lights`, at most four, `gloss` and `amount`, both in [0, 1]:
    what the knobs begin with. `frames`: (first, last) of a sequence, `rate` a second; None for a still.
    Raises OSError if the script cannot be written.
    """
    path, file = Path(path), literal(Path(picture).name)
    knobs = span(frames) | read_from(path)
    parts = [
        root(size, frames, rate),
        *(layer(name, CHANNELS) for name in NAMES),
        node("Read", inputs=0, file=file, **knobs, raw="true", name="Layers", xpos=0, ypos=-120),
        _group(basis, lights, gloss, amount),
        *_inside(basis, lights),
        "end_group",
    ]
    with replacing(path) as beside:
        beside.write_text("\n".join(parts) + "\n", encoding="utf-8")


def checked_lights(lights: object) -> list[DirectionalLight]:
    """Return the lights that the knobs begin with, a key light unless given.

    Raises TypeError for what is no light, ValueError for more than four or lights other than
    DirectionalLight.
    """
    chosen: list[DirectionalLight] = []
    for light in [] if lights is None else as_rig(lights):
        if not isinstance(light, DirectionalLight):
            raise ValueError(
                f"lights: a Nuke script takes DirectionalLight, which its knobs then move; "
                f"got {type(light).__name__}"
            )
        chosen.append(light)
    if len(chosen) > LIGHTS:
        raise ValueError(f"lights: a Nuke script takes up to {LIGHTS}, got {len(chosen)}")
    return chosen or [KEY]


def check_amount(path: AnyPath, amount: float) -> None:
    """Raise ValueError for an amount below 1 and a mesh, which has no photograph to be mixed with."""
    if amount < 1 and not is_script(path):
        raise ValueError(f"amount: {path} holds lights alone, not the photograph; expected 1, got {amount:g}")


def settings_of(light: DirectionalLight) -> dict[str, str]:
    """Return the values of a light's knobs; intensity is in the exposure, the temperature in the colour."""
    power = light.power
    brightest = float(max(power)) or 1.0
    red, green, blue = (f"{float(value) / brightest:.9g}" for value in power)
    return {
        "azimuth": f"{light.azimuth:.9g}",
        "elevation": f"{light.elevation:.9g}",
        "softness": f"{light.angle:.9g}",
        "colour": f"{{{red} {green} {blue}}}",
        "exposure": f"{math.log2(brightest):.9g}",
    }


def _started(lights: Sequence[DirectionalLight]) -> list[tuple[DirectionalLight, bool]]:
    """Return the four lights of the group, and whether each is on."""
    return [(light, True) for light in lights] + [(KEY, False)] * (LIGHTS - len(lights))


def _group(basis: Basis, lights: Sequence[DirectionalLight], gloss: float, amount: float) -> str:
    """Return the group's own knobs, up to its closing brace."""
    code = inspect.getsource(callback) + "\nupdate(nuke)\n"
    again = "exec(nuke.thisNode()['knobChanged'].value())"
    lines = [
        "Group {",
        " name Relight",
        " inputs 1",
        f" knobChanged {quoted(code)}",
        f" updateUI {quoted(again)}",
    ]
    for number, (light, on) in enumerate(_started(lights), 1):
        name = quoted(light.name or f"light {number}" if on else f"light {number}")
        prefix = f"light{number}_"
        lines += [
            f" addUserKnob {{20 {prefix}tab l {name}}}",
            f" addUserKnob {{6 {prefix}on l on +STARTLINE}}",
            f" {prefix}on {'true' if on else 'false'}",
            f" addUserKnob {{7 {prefix}azimuth l azimuth R -180 180}}",
            f" addUserKnob {{7 {prefix}elevation l elevation R -90 90}}",
            f" addUserKnob {{7 {prefix}softness l softness R 0 90}}",
            f" addUserKnob {{18 {prefix}colour l colour}}",
            f" addUserKnob {{7 {prefix}exposure l exposure R -8 8}}",
            f" addUserKnob {{1 {prefix}state l state +INVISIBLE}}",
            *(f" {prefix}{knob} {value}" for knob, value in settings_of(light).items()),
        ]
    numbers = " ".join(f"{value:.7g}" for value in basis.tables)
    lines += [
        " addUserKnob {20 picture l picture}",
        " addUserKnob {7 gloss l gloss R 0 1}",
        f" gloss {gloss:.9g}",
        " addUserKnob {7 amount l amount R 0 1}",
        f" amount {amount:.9g}",
        " addUserKnob {20 about l about}",
        " addUserKnob {1 tables l tables +INVISIBLE}",
        f" tables {quoted(numbers)}",
        f" ypos {-60}",
        "}",
    ]
    return "\n".join(lines)


def _inside(basis: Basis, lights: Sequence[DirectionalLight]) -> list[str]:
    """Return the nodes of the group: a column for each light, whose sum is mixed with the photograph.

    The first input of a node is what is on top of the stack, so the last light comes first.
    """
    blocks = [
        node("Input", inputs=0, name=f"axis{number}", number=number, xpos=COLUMN * number, ypos=-300)
        for number in range(1, LIGHTS + 1)
    ]
    blocks += [node("Input", inputs=0, name="layers", number=0, xpos=0, ypos=-300), "set Nlayers [stack 0]"]
    for number, (light, _) in reversed(list(enumerate(_started(lights), 1))):
        blocks += ["push $Nlayers", *_light(number, light, basis)]
    below = ROW * (len(LAYERS) + 5)
    blocks += ["push $Nlayers", node("Multiply", channels="rgb", value=0, name="Dark", xpos=0, ypos=below)]
    plus = {"operation": "plus", "Achannels": "rgb", "Bchannels": "rgb", "output": "rgb"}
    for number in range(1, LIGHTS + 1):
        off = f"{{{{!parent.light{number}_on}}}}"
        below += 40
        blocks.append(node("Merge2", inputs=2, **plus, name=f"Plus{number}", disable=off, xpos=0, ypos=below))
    aside, shuffle = {"xpos": -COLUMN}, {"in": PHOTOGRAPH, "out": "rgb"}
    rest = {"channels": "rgb", "value": "{{1-parent.amount}}"}
    return [
        *blocks,
        node("Multiply", channels="rgb", value="{{parent.amount}}", name="Amount", xpos=0, ypos=below + 40),
        "push $Nlayers",
        node("Shuffle", **shuffle, name="Photograph", **aside, ypos=below),
        node("Multiply", **rest, name="Rest", **aside, ypos=below + 40),
        node("Merge2", inputs=2, **plus, name="Mix", xpos=0, ypos=below + 80),
        node("Remove", operation="keep", channels="rgba", name="Picture", xpos=0, ypos=below + 120),
        node("Output", name="Output1", xpos=0, ypos=below + 160),
    ]


def _light(number: int, light: DirectionalLight, basis: Basis) -> list[str]:
    """Return the nodes of a light: its matrices, the lit albedo with its gloss, and its colour."""
    toward = samples(direction(light.azimuth, light.elevation), light.angle)
    position: dict[str, object] = {"xpos": COLUMN * number}
    blocks = []
    for row, (name, values) in enumerate(
        zip(("facing", "toward", *LAYERS), matrices(basis.tables, toward), strict=True)
    ):
        rows = " ".join("{" + " ".join(f"{v:.7g}" for v in values[3 * i : 3 * i + 3]) + "}" for i in range(3))
        knobs = {"channels": name, "matrix": f"{{{rows}}}", "name": f"light{number}_{row}"} | position
        blocks.append(node("ColorMatrix", **knobs, ypos=ROW * row))
    below = ROW * (len(LAYERS) + 2)
    shading: dict[str, object] = {}
    for index, channel in enumerate(CHANNELS):
        shading |= {f"temp_name{index}": f"sample{index}", f"temp_expr{index}": quoted(_shading(channel))}
    gloss = "+".join(f"({_gloss(channel)})" for channel in CHANNELS)
    shading |= {"temp_name3": "gloss", "temp_expr3": quoted(gloss)}
    lit = {
        f"expr{index}": f'"((sample0+sample1+sample2)*{channel}+parent.gloss*gloss*a)/3"'
        for index, channel in enumerate("rgb")
    }
    blocks.append(node("Expression", **shading, **lit, name=f"Shading{number}", **position, ypos=below))
    knob = f"parent.light{number}_"
    strength = f"pow(2,{knob}exposure)*2/(1+cos(radians({knob}softness)/2))"
    power = " ".join(f"{{{knob}colour.{channel}*{strength}}}" for channel in "rgb")
    knobs = {"channels": "rgb", "value": f"{{{power} 1}}", "name": f"Colour{number}"} | position
    return [*blocks, node("Multiply", **knobs, ypos=below + ROW)]


def _shading(channel: str) -> str:
    """Return the expression of the shading by the direction that a channel stands for."""
    facing = f"facing.{channel}"
    residual = "+".join(f"residual{n}.{channel}" for n in range(1, RESIDUAL_LAYERS + 1))
    base = f"max({facing},0)/({_shadow(channel)})"
    return f"clamp({base}+{residual}-clamp({residual},0,{RESIDUAL_BIAS:g}),0,1)"


def _gloss(channel: str) -> str:
    """Return the expression of the gloss by that direction: `relight.analysis.gloss.reflectance`."""
    frontal = f"toward.{channel}"
    lit, seen = f"max(facing.{channel}-{BEND:g}*{frontal},0)", f"max(gate.green-{BEND:g},{MIN_COSINE:g})"
    phase = f"pow({1 + FORWARD**2:.9g}+{2 * FORWARD:g}*{frontal},-1.5)*{(1 - FORWARD**2) / 4:.9g}"
    reached = f"{lit}/({lit}+{DEPTH:g}*{seen}/({seen}+{DEPTH:g}))"
    return f"gate.blue*{reached}*{phase}/({_cast(channel)})"


def _shadow(channel: str) -> str:
    """Return the expression of one over the visibility in that direction."""
    return f"(1+exp(-gate.red*facing.{channel}))*{_cast(channel)}"


def _cast(channel: str) -> str:
    """Return the expression of one over the visibility of cast shadows alone."""
    logit = "+".join(f"cast{n}.{channel}" for n in range(1, CAST_LAYERS + 1)) + f"+{LIT_LOGIT:g}"
    return f"(1+exp(-({logit})))"
