"""Nuke's own ReLight node on the passes of a relit person, in a group that is disabled at first.

Foundry's reference: learn.foundry.com/nuke/content/reference_guide/3d_nodes/relight.html. The node's inputs
are colour, lights, camera and material. Nuke's axes are those of the passes `N` and `P`: x to image right, y
up, and a camera that looks along -z.
"""

from typing import NamedTuple

from relight.scene.nuke.nodes import node

FILM_WIDTH = 36.0  # millimetres, of the camera that is written
LIGHT = (-1.0, 1.0, 2.0)  # metres from the subject's middle: where the light stands at first


class LiveLight(NamedTuple):
    """The plate's camera, as the header of a picture with the pass `P` states it."""

    eye: tuple[float, float, float]  # metres from the origin of positions
    focal: float  # focal length, heights of a pixel


def sources(live: LiveLight, size: tuple[int, ...], pixel_aspect: float) -> list[str]:
    """Return the nodes of the camera and of the light, which `switch` takes from the stack.

    `size` is (H, W) in pixels that are `pixel_aspect` times as wide as high.
    """
    scale = FILM_WIDTH / (size[1] * pixel_aspect)  # millimetres for each height of a pixel
    film = {"haperture": f"{FILM_WIDTH:g}", "vaperture": f"{scale * size[0]:.9g}"}
    focal = f"{scale * live.focal:.9g}"
    knobs = {"name": "Camera", "xpos": -330, "ypos": 160}
    camera = node("Camera2", inputs=0, translate=_vector(live.eye), focal=focal, **film, **knobs)
    light = node("Light2", inputs=0, translate=_vector(LIGHT), name="Light", xpos=-220, ypos=160)
    return [camera, light]


def switch(matte: str, xpos: int) -> list[str]:
    """Return the group. On the stack are the light groups' sum, with all layers, the light and the camera.

    `matte`: a layer whose alpha is the person's matte, by which the result is multiplied. `xpos`: the group's
    column in the node graph.
    """
    products = {f"expr{index}": f"A{channel}*B{matte}.alpha" for index, channel in enumerate("rgb")}
    return [
        node("Group", inputs=3, name="LiveLight", disable="true", xpos=xpos, ypos=220),
        node("Phong", inputs=0, specular=0, name="Material", xpos=330, ypos=0),
        node("Input", inputs=0, name="cam", number=2, xpos=220, ypos=0),
        node("Input", inputs=0, name="lights", number=1, xpos=110, ypos=0),
        node("Input", inputs=0, name="groups", number=0, xpos=0, ypos=0),
        "set Ngroups [stack 0]",
        node("Shuffle", **{"in": "albedo"}, out="rgb", name="Albedo", xpos=0, ypos=60),
        node(
            "ReLight", inputs=4, use_alpha="false", normal="N", position="P", ambient=0, name="ReLight1",
            xpos=0, ypos=120,
        ),
        "push $Ngroups",
        node("MergeExpression", inputs=2, **products, expr3="Ba", name="Matte", xpos=0, ypos=180),
        node("Output", name="Output1", xpos=0, ypos=240),
        "end_group",
    ]  # fmt: skip


def _vector(values: tuple[float, float, float]) -> str:
    return "{" + " ".join(f"{value:.9g}" for value in values) + "}"
