"""How the nodes describe their inputs to ComfyUI; every input has a tooltip."""

from collections.abc import Sequence
from inspect import Parameter, signature
from typing import Annotated, NamedTuple

from relight.arguments import About, about, limits, members, parameters
from relight.comfyui.tensors import BACKGROUND, PERSON

Input = tuple[str | list[str], dict[str, object]]

MASK_SHOWS = (
    "What is white in the mask. 'person' for segmentation and background removal nodes. 'background' for the "
    "MASK output of Load Image, which is one minus the picture's alpha."
)


class Node:
    """A node of ComfyUI, whose inputs are the parameters of its method `FUNCTION`.

    Their annotations say what they are, see `relight.arguments`: type, range, tooltip, and what only a widget
    has. They have the defaults that ComfyUI shows. Inputs that ComfyUI may leave out are keyword-only.
    """

    CATEGORY = "relight"
    FUNCTION: str

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, dict[str, Input]]:
        """Return ComfyUI's description of the inputs."""
        function = getattr(cls, cls.FUNCTION)
        inputs: dict[str, dict[str, Input]] = {"required": {}, "optional": {}}
        own = signature(function).parameters
        for name, each in list(parameters(function).items())[1:]:
            group = "optional" if own[name].kind is Parameter.KEYWORD_ONLY else "required"
            inputs[group][name] = _input(each.kind, each.default)
        return inputs


class Socket(NamedTuple):
    """In an annotation: the input comes from another node. `lazy`: it is asked for after the others."""

    kind: str
    tooltip: str
    lazy: bool = False


class Choice(NamedTuple):
    """In an annotation: the words among which one chooses."""

    options: Sequence[str]


class Step(NamedTuple):
    """In an annotation: the step of a slider."""

    size: float


def _input(kind: object, default: object) -> Input:
    """Describe an input to ComfyUI."""
    type_, said = next(members(kind))
    for each in said:
        if isinstance(each, Socket):
            return each.kind, {"tooltip": each.tooltip} | ({"lazy": True} if each.lazy else {})
    shown: dict[str, object] = {"default": default, "tooltip": (about(kind) or About()).help}
    for each in said:
        if isinstance(each, Choice):
            return list(each.options), shown
    if type_ is str:
        return "STRING", shown | {"multiline": False}
    low, high = limits(kind)
    shown |= {"min": low, "max": high}
    if type_ is int:
        return "INT", shown
    step = next(each.size for each in said if isinstance(each, Step))
    return "FLOAT", shown | {"step": step, "round": False}


MaskShows = Annotated[str, Choice((PERSON, BACKGROUND)), About(MASK_SHOWS)]
SUBJECT = Socket("RELIGHT_SUBJECT", "The analysed person, from Relight Analyse.")
# Asked for after the other inputs, so that `check_lazy_status` refuses these before the person is analysed.
SUBJECT_LAST = SUBJECT._replace(lazy=True)
LIGHTS = Socket(
    "RELIGHT_LIGHTS", "The lights, from Relight Light, Lamp, Environment, Preset, Match or Viewer."
)
CHAINED = Socket("RELIGHT_LIGHTS", "Further lights, to which this one is added.")
