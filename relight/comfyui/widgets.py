"""How the nodes describe their inputs to ComfyUI; every input has a tooltip."""

import inspect
from collections.abc import Sequence
from typing import Annotated, Any, get_type_hints

from relight.comfyui.tensors import BACKGROUND, PERSON

Input = tuple[Any, dict[str, Any]]

MASK_SHOWS = (
    "What is white in the mask. 'person' for segmentation and background removal nodes. 'background' for the "
    "MASK output of Load Image, which is one minus the picture's alpha."
)


class Node:
    """A node of ComfyUI, whose inputs are the parameters of its method `FUNCTION`.

    A parameter is annotated with its type and its `Input`, and has the default that ComfyUI shows. Inputs
    that ComfyUI may leave out are keyword-only.
    """

    CATEGORY = "relight"
    FUNCTION: str

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, dict[str, Input]]:
        """Return ComfyUI's description of the inputs."""
        function = getattr(cls, cls.FUNCTION)
        hints = get_type_hints(function, include_extras=True)
        inputs: dict[str, dict[str, Input]] = {"required": {}, "optional": {}}
        for name, parameter in list(inspect.signature(function).parameters.items())[1:]:
            (kind, shown), default = hints[name].__metadata__[0], parameter.default
            if kind in ("FLOAT", "INT", "STRING") or isinstance(kind, list):
                shown = {"default": default} | shown
            group = "optional" if parameter.kind is parameter.KEYWORD_ONLY else "required"
            inputs[group][name] = kind, shown
        return inputs


def socket(kind: str, tooltip: str) -> Input:
    """Describe an input that comes from another node."""
    return kind, {"tooltip": tooltip}


def number(low: float, high: float, step: float, tooltip: str) -> Input:
    """Describe a number in [low, high]."""
    return "FLOAT", {"min": low, "max": high, "step": step, "round": False, "tooltip": tooltip}


def whole(low: int, high: int, tooltip: str) -> Input:
    """Describe a whole number in [low, high]."""
    return "INT", {"min": low, "max": high, "tooltip": tooltip}


def text(tooltip: str) -> Input:
    """Describe a line of text."""
    return "STRING", {"multiline": False, "tooltip": tooltip}


def choice(options: Sequence[str], tooltip: str) -> Input:
    """Describe a choice."""
    return list(options), {"tooltip": tooltip}


MaskShows = Annotated[str, choice((PERSON, BACKGROUND), MASK_SHOWS)]
SUBJECT = socket("RELIGHT_SUBJECT", "The analysed person, from Relight Analyse.")
# Asked for after the other inputs, so that `check_lazy_status` refuses these before the person is analysed.
SUBJECT_LAST = (SUBJECT[0], SUBJECT[1] | {"lazy": True})
LIGHTS = socket(
    "RELIGHT_LIGHTS", "The lights, from Relight Light, Lamp, Environment, Preset, Match or Viewer."
)
CHAINED = socket("RELIGHT_LIGHTS", "Further lights, to which this one is added.")
