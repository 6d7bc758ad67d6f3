"""The node that takes its lights from a picture: of another person, or of the place behind."""

from typing import Annotated

import numpy as np
import torch
from annotated_types import Interval

from relight.arguments import About
from relight.comfyui import tensors, widgets
from relight.comfyui.lights import Chained, Lights
from relight.comfyui.subjects import SubjectBatch
from relight.lights.environment import FIELD_OF_VIEW, EnvironmentLight


class Match(widgets.Node):
    """The lights of a reference, or of a background."""

    DESCRIPTION = (
        "Estimates the lights of a photograph of another person (reference and its mask), or the light of "
        "the place that a background shows. Connect one of the two."
    )
    RETURN_TYPES = ("RELIGHT_LIGHTS",)
    RETURN_NAMES = ("lights",)
    OUTPUT_TOOLTIPS = ("The lights of the input, and the estimated ones.",)
    FUNCTION = "match"

    def match(
        self,
        subject: Annotated[SubjectBatch, widgets.SUBJECT],
        mask_shows: widgets.MaskShows = tensors.PERSON,
        field_of_view: Annotated[
            float,
            Interval(ge=1.0, le=170.0),
            widgets.Step(1.0),
            About("Vertical field of view of the picture's camera, in degrees."),
        ] = FIELD_OF_VIEW,
        *,
        reference: Annotated[
            torch.Tensor | None,
            widgets.Socket("IMAGE", "A photograph of another person, whose light is used."),
        ] = None,
        reference_mask: Annotated[
            torch.Tensor | None, widgets.Socket("MASK", "The matte of that person.")
        ] = None,
        background: Annotated[
            torch.Tensor | None,
            widgets.Socket(
                "IMAGE",
                "The place behind the person. For a batch, the light is that of the mean of its frames.",
            ),
        ] = None,
        lights: Chained = (),
    ) -> tuple[Lights]:
        """Find lights as `relight.match`, or as `relight.EnvironmentLight.from_plate`."""
        if (reference is None) == (background is None):
            raise ValueError("match: expected a reference or a background, one of the two")
        if background is not None:
            return ((*lights, _of_place(background, subject.size, field_of_view)),)
        assert reference is not None
        return ((*lights, *_of_person(reference, reference_mask, mask_shows)),)


def _of_person(reference: torch.Tensor, mask: torch.Tensor | None, shows: str) -> Lights:
    """Return the lights of a photograph of a person."""
    from relight.light_estimation import lights_in

    images = tensors.pictures("reference", reference)
    if len(images) > 1:
        raise ValueError(f"reference: expected one image, got a batch of {len(images)}")
    matte = None if mask is None else tensors.mattes("reference_mask", mask, images.shape[1:3], shows)[0]
    if matte is None and images.shape[-1] == 3:
        raise ValueError("reference_mask: expected the matte of the person in the reference")
    return tuple(lights_in(tensors.light("reference", images[0]), matte, str(reference.device)))


def _of_place(background: torch.Tensor, size: tuple[int, int], field_of_view: float) -> EnvironmentLight:
    """Return the light of the place that a background shows, behind a picture of `size` (H, W)."""
    from relight.light_estimation import PlateLight
    from relight.media.sequences import Still

    images = tensors.pictures("background", background)
    mean = np.zeros(images.shape[1:], np.float64)
    for image in images:
        mean += tensors.light("background", image)
    return PlateLight(Still((mean / len(images)).astype(np.float32)), field_of_view).at(0, size)
