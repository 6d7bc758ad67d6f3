"""What is behind the person of a shot, and its light: a picture, the plate, an environment, or nothing."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from relight.compositing.composite import Background
from relight.light_estimation import FILL, PlateLight
from relight.lights.environment import EnvironmentLight, environments
from relight.lights.moving import MovingLight
from relight.lights.rig import scaled
from relight.pipeline import preview
from relight.pipeline.frame import FrameReader
from relight.pipeline.option_fields import BACKGROUND
from relight.pipeline.options import Lighting
from relight.pipeline.readers import Reader, ReadLog, holds_display_light, person_reader, plate_reader
from relight.pipeline.shot_lights import ShotLights
from relight.quantities import ENVIRONMENT, NONE, PLATE
from relight.subject import Subject


def background_reader(lighting: Lighting) -> Reader:
    """Return the reader of backgrounds other than the plate; it reads None if there are none."""
    background = lighting.background
    is_word = isinstance(background, str) and background in (ENVIRONMENT, PLATE, NONE)
    return plate_reader(None if is_word else background, lighting.background_colour_space)


class Backgrounds:
    """The backgrounds of a shot's frames, and the light of those that light the person.

    `lights`: the others of the shot. `frames` reads the persons, `others` the backgrounds that are other
    pictures than the plate, through the same log.
    """

    def __init__(
        self, lighting: Lighting, lights: ShotLights, frames: FrameReader, others: Reader, log: ReadLog
    ) -> None:
        self._lighting, self._lights, self._frames = lighting, lights, frames
        self._others, self._log = others, log

    @cached_property
    def _plates(self) -> Reader:
        """What reads the plates as backgrounds: another reader, as a movie is read in order."""
        plates, source = self._frames.plates, self._frames.source
        if plates.numbers is None:
            return plates
        return person_reader(source.plate, source.colour_space, source.alpha)

    @property
    def _reader(self) -> Reader:
        return self._plates if self._lighting.background_is(PLATE) else self._others

    @property
    def _light_reader(self) -> Reader:
        """What reads the backgrounds whose light reaches the person; the plate if none is given."""
        return self._plates if self._lighting.background is None else self._reader

    @cached_property
    def _plate_light(self) -> PlateLight:
        return PlateLight(self._light_reader, self._frames.field_of_view)

    # What is so of all frames

    @property
    def numbers(self) -> Sequence[int] | None:
        """The frames of the backgrounds; None for a still."""
        return self._reader.numbers

    @cached_property
    def keeps_plate(self) -> bool:
        """Whether outputs for a display show the plate behind the person, though no background was given.

        A source without alpha keeps its background. One that is placed elsewhere needs another, a screen is
        keyed so that it goes, and an analysis cache holds no plates. Reads the first plate.
        """
        return self._lighting.background is None and self._why_without_plate() is None

    def keeps_codes(self, keeps_plate: bool) -> bool:
        """Return whether the background's code values are those of a display, and are passed on as they are.

        `keeps_plate`: whether it is the plate because there is no other.
        """
        lighting = self._lighting
        if lighting.background_blur or lighting.background_light:
            return False
        if keeps_plate or lighting.background_is(PLATE):
            return holds_display_light(self._plates, self._frames.source.colour_space)
        if isinstance(lighting.background, tuple):
            return max(lighting.background) <= 1
        return holds_display_light(self._others, lighting.background_colour_space)

    def _why_without_plate(self) -> str | None:
        """Return why the plate cannot be the background; None if it can."""
        source = self._frames.source
        if self._frames.cache is not None:
            return f"{source.plate} holds no photograph; name its file"
        if {"size", "placement", "scale", "offset"} & set(source.given()):
            return "the photograph is placed in another frame"
        if source.key is not None and not self._lighting.background_is(PLATE):
            return "the screen is keyed"
        return None if self._frames.is_opaque else "the source has alpha, so nothing is behind the person"

    # One frame

    def behind(self, number: int, person: Subject, keeps_plate: bool) -> Background | None:
        """Return what is behind the person of a frame: the plate without them, if that is their background.

        `keeps_plate`: it is the plate because there is no other, see the property.
        """
        if keeps_plate:
            plate = self._log.read(self._plates, number)
            return person.clean_plate(preview.halved(plate) if self._frames.is_preview else plate)
        background = self.seen(number, person.size)
        if isinstance(background, np.ndarray) and self._is_plate(background, number, person.size):
            return person.clean_plate(background)
        return background

    def seen(self, number: int, size: tuple[int, int]) -> Background | None:
        """Return the background of a frame whose picture has a `size` (H, W)."""
        field_of_view = self._frames.field_of_view
        if self._lighting.background_is(ENVIRONMENT):
            skies = environments(self._lights.at(number))
            return np.sum([sky.view(size, field_of_view) for sky in skies], axis=0)
        background = self._log.read(self._reader, number)
        background = background.at(number) if isinstance(background, MovingLight) else background
        if self._frames.is_preview:
            background = preview.halved(background)
        return (
            background.view(size, field_of_view) if isinstance(background, EnvironmentLight) else background
        )

    def _is_plate(self, background: np.ndarray, number: int, size: tuple[int, int]) -> bool:
        """Return whether a background is the plate on which the person of a frame was found."""
        if self._lighting.background_is(PLATE):
            return True
        if background.shape[:2] != size:
            return False
        file, number = self._reader.file(number), 0 if self._frames.is_still else number
        if file is not None:
            return file.resolve() in self._frames.plate_files(number)
        plate = None if self._frames.cache else self._log.read(self._frames.plates, number)
        return isinstance(plate, np.ndarray) and np.array_equal(plate, background)

    def lights(self, number: int, size: tuple[int, ...]) -> list[EnvironmentLight]:
        """Return the light of a frame's background, for a `size` (H, W); none unless it lights the person."""
        lighting = self._lighting
        if not lighting.uses_plate_light:
            return []
        light = self._plate_light.at(number, size)
        if lighting.fill:
            light = replace(light, name=FILL, intensity=light.intensity * lighting.fill_amount)
        return scaled([light], lighting.intensity)

    def hashes(self, number: int, as_read: bool) -> tuple[list[str], list[str]]:
        """Return hashes of what is seen behind a frame, and of what lights it.

        `as_read`: see `Shot.content_hash`.
        """
        seen = [number]
        if self._frames.placement.size == BACKGROUND and self._reader.numbers:
            seen.append(self._reader.numbers[0])
        shining = self._plate_light.frames_for(number) if self._lighting.uses_plate_light else []
        return (
            [self._log.content_hash(self._reader, n, as_read) for n in seen],
            [self._log.content_hash(self._light_reader, n, as_read) for n in shining],
        )

    # Checks

    def check_plate(self) -> None:
        """Raise ValueError if the plate is to be the background, and there is none."""
        why = self._why_without_plate() if self._lighting.background_is(PLATE) else None
        if why is not None:
            raise ValueError(f"background: the photograph cannot stay behind the person, as {why}")

    def check_lights(self, number: int) -> None:
        """Raise ValueError if a background of environments lacks one, or one that is to shine is no image.

        `number`: of the frame whose lights are looked at.
        """
        lighting = self._lighting
        if lighting.background_is(ENVIRONMENT) and not environments(self._lights.at(number)):
            raise ValueError("background: 'environment' expected an environment among the lights")
        option = "fill" if lighting.fill else "match_plate" if lighting.match_plate else None
        if option is not None:
            if lighting.background is None and (why := self._why_without_plate()):
                raise ValueError(f"{option}: expected a background that is an image (background=FILE): {why}")
            self._plate_light.check(option)
