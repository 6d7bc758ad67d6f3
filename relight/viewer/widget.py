"""The viewer in a notebook: the page's program as a widget whose lights are also Python's."""

from collections.abc import Iterable, Mapping
from typing import Any

import anywidget
import numpy as np
import traitlets

from relight.lights.directional import DirectionalLight
from relight.lights.light import Light
from relight.lights.near import PointLight
from relight.subject import Subject
from relight.viewer.packing import pack
from relight.viewer.page import module, style
from relight.viewer.scene import LIGHTS, HeldLight, parameters_of


def _to_browser(lights: list[HeldLight], widget: Any) -> list[dict[str, Any]]:
    return [parameters_of(light) for light in lights]


def _from_browser(lights: list[dict[str, Any]], widget: Any) -> list[HeldLight]:
    kinds = [PointLight if "position" in light else DirectionalLight for light in lights]
    return [
        kind(**{**light, "name": light["name"] or None}) for kind, light in zip(kinds, lights, strict=True)
    ]


class Viewer(anywidget.AnyWidget):
    """A subject with the light in one's hand. Made by `Subject.view()`.

    Attributes
    ----------
    lights: up to eight `DirectionalLight` and `PointLight`, those that shine. Dragging in the notebook
        changes the list; setting the list moves the lights. Observe it as any trait:
        `widget.observe(changed, "lights")`.
    """

    _esm = module() + "\nexport default { render };\n"
    _css = style()
    pack = traitlets.Bytes().tag(sync=True)
    scene = traitlets.Dict().tag(sync=True)
    lights = traitlets.List(
        traitlets.Union([traitlets.Instance(DirectionalLight), traitlets.Instance(PointLight)]), maxlen=LIGHTS
    ).tag(sync=True, to_json=_to_browser, from_json=_from_browser)

    def __init__(self, subject: Subject, scene: Mapping[str, Any]) -> None:
        self._subject = subject
        begun = _from_browser(scene["lights"], self)
        super().__init__(pack=pack(subject), scene=dict(scene), lights=begun)

    def snapshot(self, further: Light | Iterable[Light] = ()) -> np.ndarray:
        """`Subject.relit` by the widget's lights and by `further` ones, such as an environment."""
        others = [further] if isinstance(further, Light) else list(further)
        return self._subject.relit([*self.lights, *others])
