"""The lights of a shot: given ones, those of a preset, and those that are estimated or painted."""

import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TypeGuard

import numpy as np

from relight.analysis import joints
from relight.light_estimation import FILL, MATCH_PREFIX, PLATE, lights_on, read_reference
from relight.light_painting import paint_lights, read_strokes
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light
from relight.lights.moving import MovingLight, lights_at
from relight.lights.near import NearLight, Point
from relight.lights.rig import as_lights, by_name, scaled
from relight.matting.sequence import MattingOptions
from relight.media import images, movies
from relight.media.sequences import FrameSequence
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Lighting
from relight.pipeline.persons import Persons
from relight.rendering import BACKGROUND_LAYER
from relight.scene.lights import write_rig
from relight.subject import PHOTOGRAPH, Subject
from shadow.files import is_path

FOLLOWED = 2  # frames to each side over which the place of a light that follows the person is smoothed


class ShotLights:
    """The lights of a shot, without that of the background, see `Backgrounds`.

    `given`: all but those of the preset. `persons`: those of the shot, which say how bright a preset is and
    where followers stand. Raises ValueError for a photograph to match that cannot be one.
    """

    def __init__(self, lighting: Lighting, given: list[Light | MovingLight], persons: Persons) -> None:
        self._lighting, self.given, self._persons = lighting, given, persons
        self._preset = lighting.preset_lights
        if lighting.match is None and lighting.match_mask is not None:
            raise ValueError("match_mask: expected a reference as well (match=FILE), whose matte it is")
        for path in (lighting.match, lighting.match_mask):
            if is_path(path) and (movies.is_movie(path) or FrameSequence.of(path) is not None):
                raise ValueError(f"match: expected one picture's file, got {path}")

    # Of all frames

    def stated(self) -> list[Light | MovingLight]:
        """Return the lights, those of a preset as bright as it states them."""
        return scaled([*self._preset, *self.given], self._lighting.intensity)

    def exposed(self) -> list[Light | MovingLight]:
        """Return the lights, those of a preset as bright as the person was photographed."""
        return scaled(self._exposed(), self._lighting.intensity)

    def _exposed(self) -> list[Light | MovingLight]:
        return [*scaled(self._preset, self._gain), *self.given]

    @cached_property
    def _gain(self) -> float:
        """The factor of a preset's lights, see `Subject.preset_gain`: that of the reference frame.

        It depends on the source alone, so that runs over parts of a shot agree.
        """
        name = self._lighting.preset
        if name is None:
            return 1.0
        return self._persons.analysed(self._persons.first_found(self._persons.reference)).preset_gain(name)

    # Of one frame

    def at(self, number: int) -> list[Light]:
        """Return the lights of a frame, those of a preset as bright as it states them."""
        return lights_at(self.stated(), number)

    def placed(self, number: int) -> list[Light]:
        """Return the lights of a frame as they are on its person: a preset exposed, followers in place.

        Raises ValueError if the part that a light follows is seen in none of the frames around.
        """
        lights = lights_at(self.exposed(), number)
        return [_placed(light, number, self._persons) if _follows(light) else light for light in lights]

    def frames_of(self, number: int) -> list[int]:
        """Return the frames whose persons say where the lights of a frame stand."""
        return self._persons.near(number, FOLLOWED) if any(map(_follows, self.at(number))) else []

    # Checks, and the long work before the first frame

    def check(self, number: int) -> None:
        """Raise ValueError if a frame's lights have names of layers, or follow what cannot be found."""
        lights, matching = self.at(number), self._lighting.match is not None
        for name in (light.name for light in lights if light.name is not None):
            taken = self._lighting.match_plate and name == PLATE
            if taken or (matching and re.fullmatch(rf"{MATCH_PREFIX}\d+", name)):
                raise ValueError(
                    f"lights: {name!r} is the name of a matched light; give the light another name"
                )
        for light in filter(_follows, lights):
            joints.check_available(light)
        self.groups(number)

    def groups(self, number: int) -> list[str]:
        """Return the names of a frame's light groups, including that of the background.

        Raises ValueError if two lights have one name, or a light that of another layer.
        """
        lighting = self._lighting
        before = [PHOTOGRAPH] if lighting.amount < 1 else []
        after = [PLATE] if lighting.match_plate else [FILL] if lighting.fill else []
        after += [BACKGROUND_LAYER] if lighting.has_background else []
        return [*before, *by_name(self.at(number), [*before, *after]), *after]

    def estimate(
        self, analyse: Callable[..., Subject], matting: MattingOptions | None, report: Report
    ) -> None:
        """Add the lights of the photograph to match, and then let painted ones take the place of all.

        `matting`: what makes the matte of a photograph that has none. Strokes are on the first frame with a
        person. Raises as `read_reference`, `read_strokes` and `paint_lights` do.
        """
        lighting = self._lighting
        if lighting.match is not None:
            report(0, 1, "Matching")
            photograph, mask = read_reference(lighting.match, lighting.match_mask, matting)
            self.given += lights_on(analyse(photograph, mask), photograph)
        if lighting.paint is not None:
            report(0, 1, "Painting")
            strokes, present = read_strokes(lighting.paint), as_lights(self._exposed())
            person = self._persons.shown(self._persons.first_found())
            count, gloss = lighting.paint_count, lighting.effective_gloss
            self.given = [*paint_lights(person, strokes, present or None, count=count, gloss=gloss)]
            self._preset = []

    def write(self, path: Path, shining: Iterable[EnvironmentLight]) -> None:
        """Write the lights file. `shining`: the light of the background, an image beside the file."""
        lights = self.exposed()
        for light in shining:
            images.write(sidecar(path), light.image.pixels)
            lights.append(EnvironmentLight(sidecar(path), name=PLATE))
        write_rig(path, lights)


def sidecar(path: Path) -> Path:
    """Return the image of the background's light beside a lights file."""
    return path.with_name(f"{path.stem}.{PLATE}.exr")


def _follows(light: Light) -> TypeGuard[NearLight]:
    return isinstance(light, NearLight) and light.at is not None


def _placed(light: NearLight, number: int, persons: Persons) -> NearLight:
    """Return a light that follows a part of the person as it stands in a frame, smoothed over time."""
    if persons.analysed(number).is_empty:
        return light.standing_at((0, 0, 0))
    seen: dict[int, Point] = {}
    for each in persons.near(number, FOLLOWED):
        with suppress(OSError, ValueError):  # that frame is reported when it is its turn
            person = persons.analysed(each)
            if light.at in person.joints:
                seen[each] = person.joints[light.at]
    if not seen:
        return joints.placed(light, {}, where="" if persons.is_still else f"frame {number}: ")
    weights = [FOLLOWED + 1 - abs(each - persons.source_frame(number)) for each in seen]
    return light.standing_at(tuple(np.average(list(seen.values()), axis=0, weights=weights).tolist()))
