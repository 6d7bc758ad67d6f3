"""The nodes that make pictures of an analysed person: in still and in moving light, and the passes."""

from collections.abc import Callable, Iterable
from itertools import chain
from typing import Annotated

import numpy as np
import torch
from annotated_types import Interval

from relight import quantities
from relight.arguments import About, checked_number
from relight.comfyui import host, tensors, widgets
from relight.comfyui.lights import Lights
from relight.comfyui.subjects import SubjectBatch
from relight.compositing.floor import Floor
from relight.light_estimation import FILL
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light
from relight.lights.moving import MovingLight
from relight.lights.plate import few_rows, whole_field_of_view
from relight.lights.rig import by_name
from relight.rendering import relit_over
from relight.subject import Subject

FLOOR = (
    "The floor on which the person's shadow falls in the background: the camera's height above it in metres "
    "and the horizon as a share of the picture's height from the top, one or both, such as height=1.5 or "
    "height=1.5,horizon=0.45. Empty for no floor."
)
EXPOSURE = "Stops: each doubles the light. Light up to 1 is shown exactly, brighter highlights roll off."
BEHIND = (
    "What is behind the person: one image, or one a frame; scaled to cover the frame and cropped. Without it "
    "the image is straight colour, for the mask."
)
FILL_SHARE = (
    "Share of the background's light that fills the shadows of the lights, as walls and floor do on a set. "
    "Needs a background."
)

Analysed = Annotated[SubjectBatch, widgets.SUBJECT_LAST]
Given = Annotated[Lights, widgets.LIGHTS]
Behind = Annotated[torch.Tensor | None, widgets.Socket("IMAGE", BEHIND)]
Ground = Annotated[str, About(FLOOR)]
Exposure = Annotated[quantities.Exposure, Interval(ge=-16.0, le=16.0), widgets.Step(0.1), About(EXPOSURE)]
Amount = Annotated[quantities.Amount, widgets.Step(0.05)]
Gloss = Annotated[quantities.Gloss, widgets.Step(0.05)]
Fill = Annotated[quantities.Amount, widgets.Step(0.05), About(FILL_SHARE)]
Blur = Annotated[quantities.Blur, widgets.Step(0.005)]
BackgroundLight = Annotated[
    quantities.Amount,
    widgets.Step(0.05),
    About("Share of the new light that reaches the background too: it darkens and tints with it."),
]


class CheckedNode(widgets.Node):
    """A node that refuses its lights and its floor before it asks for the analysed person."""

    def check_lazy_status(
        self,
        subject: SubjectBatch | None = None,
        lights: Lights = (),
        still_lights: Lights = (),
        background: torch.Tensor | None = None,
        floor: str = "",
        fill: float = 0.0,
        **others: object,
    ) -> list[str]:
        """Return the inputs that ComfyUI has still to compute; ValueError for those that do not fit."""
        by_name((*lights, *still_lights))  # two lights of one name
        Backdrop(background, floor, fill)
        return ["subject"] if subject is None else []


class Render(CheckedNode):
    """The person in the lights, over a background or for one."""

    DESCRIPTION = "The person in new light: exactly linear in the lights, with cast shadows."
    RETURN_TYPES = ("IMAGE", "MASK", "IMAGE")
    RETURN_NAMES = ("image", "mask", "light_only")
    OUTPUT_TOOLTIPS = (
        "The relit picture.",
        "The person's matte: 1 is the person.",
        "What the lights do to a white person.",
    )
    FUNCTION = "render"

    def render(
        self,
        subject: Analysed,
        lights: Given,
        *,
        background: Behind = None,
        floor: Ground = "",
        exposure: Exposure = 0.0,
        gloss: Gloss = 0.0,
        amount: Amount = 1.0,
        fill: Fill = 0.0,
        background_blur: Blur = 0.0,
        background_light: BackgroundLight = 0.0,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Relight each frame; see `relight.apply`."""
        by_name(lights)  # two lights of one name are refused before the work
        backdrop = Backdrop(background, floor, fill)
        count = tensors.frames_together(subject=len(subject), background=len(backdrop))
        frames, masks, lighting = [], [], []
        for number in host.progress(range(count), count):
            person = subject[number]
            shining = backdrop.with_fill(lights, person, number)
            look = gloss, amount, background_blur, background_light
            frames.append(backdrop.behind(person, shining, number, *look))
            masks.append(person.matte)
            lighting.append(person.lighting(shining))
        return (
            tensors.to_image(frames, exposure),
            tensors.to_mask(masks),
            tensors.to_image(lighting, exposure),
        )


class Orbit(CheckedNode):
    """The person in lights that turn around them."""

    DESCRIPTION = "The lights turn about the person: a video of a still, or a moving light over a shot."
    RETURN_TYPES = ("IMAGE", "MASK")
    RETURN_NAMES = ("images", "masks")
    OUTPUT_TOOLTIPS = ("The frames, for a video node.", "The person's matte in each frame.")
    FUNCTION = "orbit"

    def orbit(
        self,
        subject: Analysed,
        lights: Given,
        frames: Annotated[
            int,
            Interval(ge=1, le=100000),
            About(
                "Frames of the video. A shot has its own number: its lights turn within as many as this says."
            ),
        ] = 48,
        turns: Annotated[
            float,
            Interval(ge=-1000.0, le=1000.0),
            widgets.Step(0.25),
            About(
                "Turns within the frames: 1 is once around, from the camera toward image right; -1 the other "
                "way."
            ),
        ] = 1.0,
        *,
        still_lights: Annotated[
            Lights, widgets.Socket("RELIGHT_LIGHTS", "Lights that stay where they are.")
        ] = (),
        background: Behind = None,
        floor: Ground = "",
        exposure: Exposure = 0.0,
        fill: Fill = 0.0,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Relight each frame by the lights as `relight.MovingLight` turns them."""
        backdrop = Backdrop(background, floor, fill)
        count = tensors.frames_together(subject=len(subject), background=len(backdrop))
        count = frames if count == 1 else count
        by_name((*lights, *still_lights))  # two lights of one name are refused before the work
        moving = [orbiting(light, frames / turns) for light in lights] if turns else []
        resting = still_lights if turns else (*lights, *still_lights)
        pictures, masks = [], []
        for number in host.progress(range(count), count):
            person = subject[number]
            shining = [*(light(number + 1) for light in moving), *resting]
            pictures.append(backdrop.behind(person, backdrop.with_fill(shining, person, number), number))
            masks.append(person.matte)
        return tensors.to_image(pictures, exposure), tensors.to_mask(masks)


class Passes(CheckedNode):
    """What the picture is made of, light by light."""

    DESCRIPTION = "For each light its visibility, its shading and its light group, as batches."
    RETURN_TYPES = ("IMAGE", "IMAGE", "IMAGE", "STRING")
    RETURN_NAMES = ("visibility", "shading", "light_groups", "names")
    OUTPUT_TOOLTIPS = (
        "The share of each light that no part of the person blocks, values as they are.",
        "What each light does to a white person.",
        "The person in each light alone; in linear light they sum to the picture.",
        "The names of the lights, one a line, in the order of the batches: all frames of one, then the next.",
    )
    FUNCTION = "passes"

    def passes(
        self, subject: Analysed, lights: Given, *, exposure: Exposure = 0.0
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, str]:
        """Render the passes of each light, all frames of one light after the other."""
        named = by_name(lights)
        if not named:
            raise ValueError("lights: expected at least one")
        visibility: dict[str, list[np.ndarray]] = {name: [] for name in named}
        shading: dict[str, list[np.ndarray]] = {name: [] for name in named}
        groups: dict[str, list[np.ndarray]] = {name: [] for name in named}
        for person in host.progress(subject, len(subject)):
            for name, light in named.items():
                visibility[name].append(person.unshadowed(light))
                shading[name].append(person.lighting(light))
                groups[name].append(person.relit([light]))
        return (
            tensors.as_grey(list(chain(*visibility.values()))),
            tensors.to_image(list(chain(*shading.values())), exposure),
            tensors.to_image(list(chain(*groups.values())), exposure),
            "\n".join(named),
        )


class Backdrop:
    """What is behind the person in each frame, and the floor there."""

    def __init__(self, background: torch.Tensor | None, floor: str, fill: float = 0.0) -> None:
        self._images = None if background is None else tensors.pictures("background", background)
        self.floor = Floor.parse(floor) if floor.strip() else None
        if self.floor is not None and background is None:
            raise ValueError("floor: expected a background too, on which the shadow falls")
        self._fill = checked_number("fill", fill, 0, 1)
        if self._fill and background is None:
            raise ValueError("fill: expected a background too, whose light it is")

    def __len__(self) -> int:
        return 1 if self._images is None else len(self._images)

    def picture(self, number: int) -> np.ndarray | None:
        """Return what is behind the person in a frame, scene-linear; None for nothing."""
        if self._images is None:
            return None
        return tensors.light("background", self._images[number if len(self) > 1 else 0])

    def with_fill(self, lights: Iterable[Light], person: Subject, number: int) -> list[Light]:
        """Return the lights, and the light of a frame's background that fills their shadows, if any."""
        picture = self.picture(number) if self._fill else None
        if picture is None:
            return [*lights]
        whole = whole_field_of_view(picture.shape, person.size, person.camera.field_of_view)
        picture = picture if len(self) == 1 else few_rows(picture)
        return [*lights, EnvironmentLight.from_plate(picture, whole, intensity=self._fill, name=FILL)]

    def behind(
        self,
        person: Subject,
        lights: Lights | list[Light],
        number: int,
        gloss: float = 0.0,
        amount: float = 1.0,
        blur: float = 0.0,
        background_light: float = 0.0,
    ) -> np.ndarray:
        """Return the person in the lights over it, (H, W, 3) linear; without one (H, W, 4), premultiplied."""
        return relit_over(
            person, lights, self.picture(number), self.floor, gloss, amount, blur, background_light
        )


def orbiting(light: Light, frames: float) -> Callable[[float], Light]:
    """Return the light of a frame, from 1, of a turn of so many frames about the person."""
    if isinstance(light, EnvironmentLight):  # a map that is no file has no settings
        settings = {"image": light.image} | Light.settings(light)
    else:
        settings = light.settings()
    return MovingLight(type(light), orbit=frames, **settings).at
