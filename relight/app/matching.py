"""The light of a background, or of another photograph, as a few lights that a page shows."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from relight.app.pictures import resized
from relight.errors import EmptyMatteError
from relight.light_estimation import PlateLight, fit_lights, match
from relight.lights.environment import FIELD_OF_VIEW
from relight.lights.light import Light
from relight.matting.people import finder
from relight.matting.refine import encoded_srgb
from relight.media.resampling import size_within
from relight.media.sequences import Still
from relight.subject import Subject
from relight.viewer.initial_state import parameters_of

COUNT = 4  # lights at most: as many as one can hold
REFERENCE_SIDE = 1024  # pixels, the longer side of the other photograph, at most


def of_background(subject: Subject, pixels: np.ndarray) -> list[dict[str, object]]:
    """Return the lights of the place that a background (H, W, 3) shows."""
    return _few(subject, [PlateLight(Still(pixels), FIELD_OF_VIEW).at(0, subject.size)])


def of_photograph(subject: Subject, pixels: np.ndarray) -> list[dict[str, object]]:
    """Return the lights of another photograph (H, W, 3|4), whose person is found unless it has alpha.

    Raises EmptyMatteError if nobody is found.
    """
    reference = resized(pixels, size_within(pixels.shape, REFERENCE_SIDE))
    mask = None
    if reference.shape[-1] == 3 or reference[..., 3].min() >= 1:
        reference = np.ascontiguousarray(reference[..., :3])
        mask = finder.FoundPerson()(encoded_srgb(reference))
        if mask.max() <= 0.5:
            raise EmptyMatteError("No person was found in that photograph, whose light it is.")
    return _few(subject, match(subject, reference, mask=mask))


def _few(subject: Subject, lights: Sequence[Light]) -> list[dict[str, object]]:
    """Return at most `COUNT` lights that light a person most like these, with the page's parameters."""
    found = fit_lights(subject.relit(lights), subject, count=COUNT)
    return [parameters_of(replace(light, name=f"match{number}")) for number, light in enumerate(found, 1)]
