"""The viewer in a notebook: the page's program as a widget whose lights are also Python's."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from shadow.installing import install_command

try:
    import anywidget
    import traitlets
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"a view in a notebook needs anywidget; install it with: {install_command('notebook')}"
    ) from error

from relight.lights.directional import DirectionalLight
from relight.lights.light import Light
from relight.lights.near import PointLight
from relight.lights.rig import as_lights
from relight.viewer.constants import MAX_LIGHTS
from relight.viewer.initial_state import HandleLight, parameters_of
from relight.viewer.page import module, style


def _to_browser(lights: list[HandleLight], widget: object) -> list[dict[str, object]]:
    return [parameters_of(light) for light in lights]


def _from_browser(lights: list[dict[str, Any]], widget: object) -> list[HandleLight]:
    kinds = [PointLight if "position" in light else DirectionalLight for light in lights]
    return [
        kind(**{**light, "name": light["name"] or None}) for kind, light in zip(kinds, lights, strict=True)
    ]


class Viewer(anywidget.AnyWidget):
    """A person whose lights one drags. `Subject.view()` makes it.

    `lights`: up to eight `DirectionalLight` and `PointLight`, those that shine. Dragging in the notebook
    changes the list; setting the list moves the lights. Observe it as any trait: `widget.observe(changed,
    "lights")`. `gloss`: strength of the reflection at grazing angles, and `amount`, share of the lights, in
    [0, 1], see `Subject.relit`; the sliders', both ways.
    """

    _esm = module() + "\nexport default { render };\n"
    _css = style()
    pack = traitlets.Bytes().tag(sync=True)
    scene = traitlets.Dict().tag(sync=True)
    lights = traitlets.List(
        traitlets.Union([traitlets.Instance(DirectionalLight), traitlets.Instance(PointLight)]),
        maxlen=MAX_LIGHTS,
    ).tag(sync=True, to_json=_to_browser, from_json=_from_browser)
    gloss = traitlets.Float(min=0, max=1).tag(sync=True)
    amount = traitlets.Float(1.0, min=0, max=1).tag(sync=True)

    def __init__(
        self,
        packed: bytes,
        scene: Mapping[str, Any],
        relit: Callable[[list[Light], float, float], np.ndarray],
    ) -> None:
        """`packed`, `scene`: see `packing` and `scene` in this package. `relit`: relights the person."""
        self._relit = relit
        first = _from_browser(scene["lights"], self)
        super().__init__(
            pack=packed, scene=dict(scene), lights=first, gloss=scene["gloss"], amount=scene["amount"]
        )

    def snapshot(self, further: Light | Iterable[Light] = ()) -> np.ndarray:
        """Relight the person by the widget's lights and gloss and by `further` lights, see `Subject`."""
        return self._relit([*self.lights, *as_lights(further)], self.gloss, self.amount)
