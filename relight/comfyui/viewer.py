"""The node that holds the page of `relight view`: the light that is dragged there feeds the workflow."""

import secrets
from pathlib import Path
from typing import Annotated
from urllib.parse import parse_qs

import torch

from relight.arguments import About, read_settings
from relight.comfyui import host, widgets
from relight.comfyui.lights import Lights
from relight.comfyui.render import Backdrop
from relight.comfyui.subjects import SubjectBatch
from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight, environments
from relight.lights.light import Light
from relight.lights.near import PointLight
from relight.viewer.initial_state import DEFAULT_LIGHT


class Viewer(widgets.Node):
    """A page in the node in which one drags the lights on the person."""

    DESCRIPTION = (
        "Shows the person of the first image with the lights in your hand. After the first run drag a light "
        "in the node; what you see feeds the workflow when it runs again."
    )
    RETURN_TYPES = ("RELIGHT_LIGHTS",)
    RETURN_NAMES = ("lights",)
    OUTPUT_TOOLTIPS = ("The lights as they stand in the viewer.",)
    OUTPUT_NODE = True
    FUNCTION = "show"

    def __init__(self) -> None:
        self._shown: tuple[object, ...] = ()  # what the page was made of
        self._page = Path()

    def show(
        self,
        subject: Annotated[SubjectBatch, widgets.SUBJECT],
        *,
        lights: Annotated[
            Lights | None,
            widgets.Socket(
                "RELIGHT_LIGHTS",
                "What the viewer begins with, up to 8 lights and an environment; a key light unless "
                "connected.",
            ),
        ] = None,
        background: Annotated[
            torch.Tensor | None, widgets.Socket("IMAGE", "What is behind the person in the viewer.")
        ] = None,
        held: Annotated[
            str,
            About(
                "The lights as they were dragged, which the viewer writes: the part of the page's link "
                "behind #. Empty: the lights that come in."
            ),
        ] = "",
    ) -> dict[str, object]:
        """Write the page to ComfyUI's temporary folder, and return the lights that it holds."""
        begun = (DEFAULT_LIGHT,) if lights is None else tuple(lights)
        page = self._written(subject, begun, background)
        message = {"filename": page.name, "subfolder": "", "type": "temp"}
        return {"ui": {"relight_viewer": [message]}, "result": (held_lights(held, begun),)}

    def _written(self, subject: SubjectBatch, lights: Lights, background: torch.Tensor | None) -> Path:
        """Return the page's file.

        The existing file is reused while it shows the same person, so that the browser keeps it open.
        """
        shown = (subject, lights, background)
        same = len(shown) == len(self._shown) and all(map(lambda a, b: a is b, shown, self._shown))
        if not (same and self._page.is_file()):
            if subject.shown is None:
                raise ValueError("subject: none of the images shows a person")
            folder = host.folder("temp")
            folder.mkdir(parents=True, exist_ok=True)
            page = folder / f"relight-{secrets.token_hex(8)}.html"
            subject.shown.view(page, lights, background=Backdrop(background, "").picture(0))
            self._shown, self._page = shown, page
        return self._page


def held_lights(held: str, begun: Lights) -> Lights:
    """Return the lights that shine on the viewer's page.

    `held`: what the page's link says behind `#`: `light=key:azimuth=-40,elevation=30&muted=1`, URL-encoded.
    Empty where nothing was dragged. `begun`: the lights that the page began with, among them an environment,
    whose map comes from there. Raises ValueError if the text does not read so, or has an environment that was
    dropped on the page, whose map the workflow does not have.
    """
    query = parse_qs(held.strip().removeprefix("#"))
    if "light" not in query:
        return begun
    lights = [_parse(text) for text in query["light"] if text != "none"]
    muted, solo = (set(query.get(key, [""])[0].split()) for key in ("muted", "solo"))
    shining = [
        light
        for number, light in enumerate(lights, 1)
        if str(number) not in muted and (not solo or str(number) in solo)
    ]
    skies = environments(begun)
    shown = query.get("environment", ["none"])[0]
    if shown != "none" and not skies:
        raise ValueError(
            "held: has an environment that was dropped on the viewer; give it by a Relight Environment node"
        )
    if shown != "none" and "dark" not in query:
        (environment,) = skies
        settings = read_settings(shown.split(","), EnvironmentLight.parameters())
        shining.append(EnvironmentLight(environment.image, **{"name": environment.name} | settings))
    return tuple(shining)


def _parse(text: str) -> Light:
    """Parse a light of the page; the page has distant lights and lamps."""
    return (PointLight if "position=" in text.rpartition(":")[2] else DirectionalLight).parse(text)
