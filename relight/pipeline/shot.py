"""A shot on disk with its lights: a still, a sequence, a movie or an analysis cache, opened once."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, Self, TypeGuard

import numpy as np
import torch

from relight.analysis import joints, skin
from relight.analysis.camera import Camera
from relight.compositing.composite import Background
from relight.light_estimation import FILL, Matching, lights_on
from relight.light_estimation import PLATE as PLATE_LIGHT
from relight.light_painting import paint_lights, read_strokes
from relight.lights.light import Light
from relight.lights.moving import MovingLight, lights_at
from relight.lights.near import NearLight, Point
from relight.lights.rig import as_lights, by_name, scaled
from relight.matting.people.track import Track
from relight.media.content_hash import FileRecord, content_hash
from relight.pipeline import outputs, preview
from relight.pipeline.backgrounds import Backgrounds, background_reader
from relight.pipeline.cache import check_not_analysed, is_cache
from relight.pipeline.frame import FrameInputs, FrameReader
from relight.pipeline.option_fields import Picture, Report
from relight.pipeline.options import Compute, GivenLighting, GivenSource, Lighting, Output, Source
from relight.pipeline.persons import FrameAnalyser, Persons
from relight.pipeline.plate_metadata import PlateMetadata, PlateMetadataReader
from relight.pipeline.readers import Reader, ReadLog
from relight.quantities import ENVIRONMENT, PLATE
from relight.rendering import BACKGROUND_LAYER
from relight.scene.camera_view import CameraView
from relight.scene.lights import write_rig
from relight.scene.plot import plot_of
from relight.subject import PHOTOGRAPH, Subject, weights
from relight.version import __version__
from shadow import inputs as checks
from shadow.files import is_path
from shadow.networks.precision import in_use, using

FOLLOWED = 2  # frames to each side over which the place of a light that follows the person is smoothed


def _follows(light: Light) -> TypeGuard[NearLight]:
    return isinstance(light, NearLight) and light.at is not None


class FramePerson(NamedTuple):
    """The person of a frame, and how they were found."""

    subject: Subject
    certainty: float | None  # that they are there, 0 to 1; None where nobody is followed
    neighbours: list[int] | None  # the frames with which they were filtered; None for an analysis cache


class Surroundings(NamedTuple):
    """What lights the person of a frame, and what is behind them."""

    lights: list[Light]  # as they stand in the frame, that of the background among them
    behind: Background | None
    keeps_codes: bool  # whether code values of a display are behind the person, and are passed on as they are


class Shot:
    """The frames of a shot: persons, the lights on them, and what is behind them.

    Lights and camera are read at once, pictures when they are asked for. A still is a shot whose only number
    is 0, and shows the same person at every number: its lights and its background may move. `analyse`
    analyses the person of a frame, from the arguments of `relight.Subject`, the default. `is_preview`: see
    `relight.pipeline.preview`. Raises
    FileNotFoundError for no such file or frames, TypeError or ValueError for bad arguments.

    >>> from relight.pipeline.shot import Shot
    >>> with Shot.open("examples/person.png", relight.DirectionalLight(azimuth=-40)) as shot:
    ...     picture = shot.person(0).relit(shot.lights(0))
    >>> picture.shape
    (768, 576, 4)
    """

    def __init__(
        self,
        source: GivenSource,
        lighting: GivenLighting = (),
        compute: Compute | None = None,
        analyse: Callable[..., Subject] | None = None,
        is_preview: bool = False,
    ) -> None:
        self._analyse, self.is_preview = analyse or Subject, is_preview
        self.source, self.lighting = Source.of(source), Lighting.of(lighting)
        if is_preview:
            if self.is_analysed:
                raise ValueError(f"preview: {self.source.plate} is analysed, and is relit fast without it")
            self.source, self.lighting = preview.source_of(self.source), preview.lighting_of(self.lighting)
        self.compute = compute or Compute()
        self.every_light: list[Light | MovingLight] = []
        self._camera_view: CameraView | None = None
        checks.device("device", self.compute.device)
        check_not_analysed(self.source, self.compute)
        self.preset_lights: list[Light] = []
        if self.lighting.has_lights:
            rig = self.lighting.rig()
            self.every_light, self.preset_lights = rig.lights, self.lighting.preset_lights
            self._camera_view = rig.view
        self.matching = Matching(self.lighting.match_plate, self.lighting.match, self.lighting.match_mask)
        self._log = ReadLog()

    @classmethod
    @contextmanager
    def open(
        cls,
        source: GivenSource,
        lighting: GivenLighting = (),
        compute: Compute | None = None,
        analyse: Callable[..., Subject] | None = None,
        is_preview: bool = False,
    ) -> Iterator[Self]:
        """Open a shot; until it is closed, networks run in its precision and torch on its threads.

        Machines of one kind that agree on both make bit-identical frames.
        """
        shot = cls(source, lighting, compute, analyse, is_preview)
        threads, before = shot.compute.threads, torch.get_num_threads()
        with using(shot.compute.precision):
            try:
                torch.set_num_threads(threads or before)
                yield shot
            finally:
                torch.set_num_threads(before)

    # What the shot consists of

    @cached_property
    def _frames(self) -> FrameReader:
        """What reads the persons."""
        return FrameReader(
            self.source, self._background_reader, self._log, self._camera_view, self.is_preview
        )

    @cached_property
    def _analyser(self) -> FrameAnalyser:
        """What analyses the persons; it does nothing in an analysis cache."""
        return FrameAnalyser(self._frames, self.compute.device, self._analyse)

    @cached_property
    def _persons(self) -> Persons:
        """The persons, analysed or read from an analysis cache."""
        if self._frames.cache is not None:
            return Persons(self.numbers, self._frames.cache.read, radius=0)
        frames = self._frames
        return Persons(self.numbers, self._analyser, frames.temporal_radius, frames.is_cut)

    @cached_property
    def _background_reader(self) -> Reader:
        """What reads the backgrounds that are other pictures than the plate; frames may have their size."""
        return background_reader(self.lighting)

    @cached_property
    def _backgrounds(self) -> Backgrounds:
        return Backgrounds(self.lighting, self._frames, self._background_reader, self._log)

    @property
    def _balance(self) -> tuple[object, ...]:
        """How strong the lights are beside each other and the photograph."""
        lighting = self.lighting
        return lighting.preset, lighting.fill, lighting.fill_amount, lighting.amount, lighting.intensity

    # What is so of all frames

    @property
    def is_still(self) -> bool:
        """Whether the person does not move."""
        return self._frames.is_still

    @property
    def is_analysed(self) -> bool:
        """Whether the source is an analysis cache, of which no network runs."""
        return is_cache(self.source.plate)

    @property
    def stated_source(self) -> Source:
        """The source with the field of view of the scene's camera, for runs that do not read the scene."""
        if self._camera_view is None or self.is_analysed:
            return self.source
        return replace(self.source, field_of_view=self._frames.field_of_view)

    @property
    def numbers(self) -> Sequence[int]:
        """The numbers of the person's frames, in order; (0,) for a still."""
        return self._frames.numbers

    @property
    def rate(self) -> Fraction | float | None:
        """Frames a second, if the source states it."""
        return self._frames.plates.rate

    @property
    def pixel_aspect(self) -> float:
        """How many times as wide as high the plates' pixels are; 1 in a picture of another size."""
        return self._frames.pixel_aspect

    @property
    def keeps_plate(self) -> bool:
        """Whether outputs for a display show the plate behind the person, though no background was given.

        A source without alpha keeps its background. One that is placed elsewhere needs another, a screen is
        keyed so that it goes, and an analysis cache holds no plates. Reads the first plate.
        """
        return self._backgrounds.keeps_plate

    @property
    def files(self) -> tuple[object, ...]:
        """What is read: paths, and lights whose images are files. Those in memory are among them."""
        source, lighting = self.source, self.lighting
        return (
            source.plate, source.mask, source.track, source.normals, source.depth, lighting.background,
            lighting.match, lighting.match_mask, lighting.paint, lighting.lights, *self.every_light,
        )  # fmt: skip

    @property
    def skin_is_known(self) -> bool:
        """Whether the network that sees skin takes part in an analysis, see `relight.analysis.skin`."""
        return self._frames.cache is None and skin.is_available()

    @property
    def computed_in(self) -> tuple[str | None, int | None]:
        """The precision and the threads on which the pixels depend; no network runs for an analysis cache."""
        cached = self._frames.cache is not None
        return None if cached else in_use(self.compute.device or "cpu"), self.compute.threads

    @property
    def _own_layers(self) -> tuple[list[str], list[str]]:
        """The names of the light groups that are no given light's: those before the lights, those after."""
        lighting = self.lighting
        shining = [PLATE_LIGHT] if self.matching.plate else [FILL] if lighting.fill else []
        behind = [BACKGROUND_LAYER] if lighting.has_background else []
        return [PHOTOGRAPH] if lighting.amount < 1 else [], [*shining, *behind]

    def light_groups(self, number: int) -> list[str]:
        """Return the names of a frame's light groups, including that of the background.

        Raises ValueError if two lights have one name, or a light that of another layer.
        """
        before, after = self._own_layers
        return [*before, *by_name(self.lights(number), [*before, *after]), *after]

    @property
    def options_hash(self) -> str:
        """Differs where the source's options do, its pictures apart."""
        return self._frames.options_hash

    @property
    def field_of_view(self) -> float:
        """Of the camera, vertical, in degrees."""
        return self._frames.field_of_view

    def track(self, corrections: Mapping[int, tuple[int, int]] | None = None) -> Track | None:
        """Return who is found and followed through the frames, see `FrameReader.track`."""
        return self._frames.track(corrections)

    # One frame

    def frame(self, number: int) -> FrameInputs:
        """Return a frame as `relight.Subject` takes it. Raises as reading and `relight.key` do."""
        return self._frames.read(number)

    def person(self, number: int) -> Subject:
        """Return the person of a frame, filtered in time. Raises the errors of reading and of Subject."""
        return self.found_person(number).subject

    def found_person(self, number: int) -> FramePerson:
        """Return the person of a frame, as `person` does, and how they were found."""
        number = self._frames.source_frame(number)
        person, neighbours = self._persons.filtered(number)
        if self._frames.cache:
            return FramePerson(person, None, None)
        return FramePerson(person, self._frames.certainty(number), neighbours)

    def subject(self, number: int, *, filtered: bool = True) -> Subject:
        """Return the person of a frame; raises ValueError if the frame shows no person."""
        number = self._frames.source_frame(number)
        person = self._persons.at(number) if filtered else self._persons.analysed(number)
        if person.is_empty:
            raise ValueError(f"frame {number}: shows no person; choose another (frame=NUMBER)")
        return person

    @cached_property
    def plate_metadata(self) -> Callable[[int], PlateMetadata]:
        """Returns what a frame's plate states of its scene and camera, as it is or as a cache keeps it."""
        cache = self._frames.cache
        return PlateMetadataReader(self._frames.plates).at if cache is None else cache.plate_metadata

    def size(self, number: int) -> tuple[int, int]:
        """Return the size (H, W) of a frame's picture, in pixels, without analysing it."""
        person = self._persons.if_analysed(self._frames.source_frame(number))
        if person is None and self._frames.cache is None:
            return self._analyser.size(self._frames.source_frame(number))
        return (person or self.person(number)).size

    def lights(self, number: int) -> list[Light]:
        """Return the lights of a frame, without that of the background; a preset's as it states them."""
        return lights_at(self.all_lights(), number)

    def exposed_lights(self, number: int) -> list[Light]:
        """Return the lights of a frame, those of a preset as bright as the person was photographed."""
        lights = lights_at(self.all_lights(self.preset_gain), number)
        return [self._placed(light, number) if _follows(light) else light for light in lights]

    def surroundings(self, number: int, person: Subject, keeps_plate: bool = False) -> Surroundings:
        """Return what lights the person of a frame, and what is behind them. `keeps_plate`: see `behind`."""
        behind = self.behind(number, person, keeps_plate)
        keeps_codes = self._backgrounds.keeps_codes(keeps_plate)
        shining = self._backgrounds.lights(number, person.size)
        return Surroundings([*self.exposed_lights(number), *shining], behind, keeps_codes)

    def _placed(self, light: NearLight, number: int) -> NearLight:
        """Return a light that follows a part of the person as it stands in a frame, smoothed over time.

        Raises ValueError if that part is seen in none of the frames around.
        """
        source_number = self._frames.source_frame(number)
        if self._persons.analysed(source_number).is_empty:
            return light.standing_at((0, 0, 0))
        seen: dict[int, Point] = {}
        for each in self._followed_in(source_number):
            with suppress(OSError, ValueError):  # that frame is reported when it is its turn
                person = self._persons.analysed(each)
                if light.at in person.joints:
                    seen[each] = person.joints[light.at]
        if not seen:
            return joints.placed(light, {}, where="" if self.is_still else f"frame {number}: ")
        weights = [FOLLOWED + 1 - abs(each - source_number) for each in seen]
        return light.standing_at(tuple(np.average(list(seen.values()), axis=0, weights=weights).tolist()))

    def _followed_in(self, number: int) -> list[int]:
        """Return the frames from which the place of a light that follows the person is found."""
        # Those that are analysed for the temporal filter; all may be read of an analysis cache.
        around = self.numbers if self._frames.cache else self._persons.around(number)
        return [each for each in around if abs(each - number) <= FOLLOWED]

    def all_lights(self, preset_gain: float = 1.0) -> list[Light | MovingLight]:
        """Return the lights of all frames, without that of the background.

        `preset_gain`: factor of those of the preset.
        """
        lights = [*scaled(self.preset_lights, preset_gain), *self.every_light]
        return scaled(lights, self.lighting.intensity)

    @cached_property
    def preset_gain(self) -> float:
        """The factor of a preset's lights, see `Subject.preset`: that of the reference frame.

        It depends on the source alone, so that runs over parts of a shot agree.
        """
        name = self.lighting.preset
        if name is None:
            return 1.0
        first = self.reference
        for number in self.numbers if first is None else (first, *self.numbers):
            person = self._persons.analysed(number)
            if not person.is_empty:
                return person.preset_gain(name)
        return 1.0

    @property
    def reference(self) -> int | None:
        """The reference frame, see `relight.pipeline.reference`; None for a still, or without a person."""
        return self._world[0] if self._frames.cache is None else self._frames.cache.reference

    @property
    def likely_reference(self) -> int | None:
        """The reference frame as far as it can be told without a matte."""
        return None if self._frames.cache else next(iter(self._frames.references[0]), None)

    def background(self, number: int, size: tuple[int, int]) -> Background | None:
        """Return the background of a frame whose picture has a `size` (H, W)."""
        return self._backgrounds.seen(number, size, self.lights(number))

    def behind(self, number: int, person: Subject, keeps_plate: bool = False) -> Background | None:
        """Return what is behind the person of a frame: the plate without them, if that is their background.

        `keeps_plate`: it is the plate because there is no other, see the property.
        """
        return self._backgrounds.behind(number, person, self.lights(number), keeps_plate)

    def content_hash(self, number: int, *further: object, as_read: bool = False) -> str:
        """Return a hash of all from which a frame is made; `further`: what its outputs add.

        `as_read`: whether to hash files as they were read, if they were, or as they are now.
        """
        lights, lighting = self.lights(number), self.lighting
        around = self._analysed_frames(self._frames.source_frame(number))
        if any(map(_follows, lights)):
            around = sorted({*around, *self._followed_in(self._frames.source_frame(number))})
        seen, shining = self._backgrounds.hashes(number, as_read)
        return content_hash(
            self._frames.person_hash(around, as_read), self._world[0],
            seen, shining, lighting.background_colour_space,
            lighting.has_background, lighting.background_is(ENVIRONMENT),
            lighting.background_light, lighting.background_blur,
            self.matching.plate, lights, *self._balance, lighting.floor, lighting.effective_gloss,
            __version__, *weights(), self.computed_in,
            self.skin_is_known, *further,
        )  # fmt: skip

    def person_hash(self, number: int, as_read: bool = False) -> str:
        """Return a hash of all that determines the analysis of a frame."""
        return content_hash(
            self._frames.person_hash(self._analysed_frames(number), as_read),
            self._world[1],
            __version__,
            *weights(),
            self.computed_in,
            self.skin_is_known,
        )

    def records(self, number: int) -> list[FileRecord]:
        """Return the records, made when they were read, of the files from which a person is analysed."""
        return self._frames.records(self._analysed_frames(number))

    def _analysed_frames(self, number: int) -> list[int]:
        """Return the frames on which a person depends: those around, and the reference."""
        first, _ = self._world
        around = self._persons.around(number)
        return around if first is None or first in around else [*around, first]

    @property
    def _world(self) -> tuple[int | None, Camera | None]:
        """See `FrameAnalyser.world`; the frames of an analysis cache have their places already."""
        return (None, None) if self._frames.cache is not None else self._analyser.world

    # Checks and preparation, before the first frame

    @cached_property
    def span(self) -> tuple[int, int] | None:
        """The first and the last frame of the sources; the person's take precedence over the background's."""
        numbers = next((each.numbers for each in self._frames.readers if each.numbers), None)
        numbers = numbers or self._backgrounds.numbers
        return (numbers[0], numbers[-1]) if numbers else None

    def check_outputs(self, output: Output, *further: Path) -> None:
        """Refuse outputs that cannot be written, or that this shot or `further` reads."""
        sidecar = self.matching.sidecar_path(output.save_lights)
        outputs.check_outputs(output, (*self.files, *further), sidecar)
        if sidecar is not None and self._backgrounds.numbers is not None:
            raise ValueError(
                "save_lights: the light of a background that moves cannot be stored in a lights file"
            )

    def check_form(self, output: Output) -> None:
        """Check codec and colours of movies before anything is analysed, see `outputs.check_form`."""

        def size() -> list[int]:
            return [length // 2 if self.is_preview else length for length in self._frames.picture_size()]

        outputs.check_form(output, size, self._frames.plates)

    def check_not_read(self, paths: Iterable[Path]) -> None:
        """Raise ValueError if one of these paths, which are to be written, is read."""
        outputs.check_not_read(paths, self.files)

    def check_lights(self, number: int) -> None:
        """Raise ValueError if a frame's lights do not go with the background, or have names of layers."""
        lights = self.lights(number)
        self._backgrounds.check_lights(lights)
        self.matching.check_names(lights)
        for light in lights:
            if _follows(light):
                joints.check_available(light)
        self.light_groups(number)

    def check_background(self) -> None:
        """Raise ValueError if the plate is to be the background, and there is none."""
        self._backgrounds.check()

    def lighting_of_analysed(self, output: Output) -> Lighting:
        """Return the lighting for frames relit from their analysis: it names a plate that is behind them.

        Beside an .exr, which holds the cut-out, pictures are cut out too. ValueError for an output that
        then cannot hold the alpha, or a plate that cannot be the background.
        """
        self.check_background()
        shown = outputs.shows_backgrounds(output) and not any(map(outputs.is_exr, output.paths))
        is_plate = self.lighting.background_is(PLATE) or (shown and self.keeps_plate)
        if is_plate and is_path(self.source.plate):
            plate, space = Path(self.source.plate), self.source.colour_space
            return replace(self.lighting, background=plate, background_colour_space=space)
        outputs.check_alpha(output, transparent=not self.lighting.has_background)
        return self.lighting

    def check_floor(self, number: int) -> None:
        """Raise ValueError if the person cannot stand on the floor; those of a cache are checked later."""
        floor = self.lighting.floor
        if floor is None:
            return
        if floor.feet is not None and not self.is_still:
            raise ValueError(
                "floor: feet are those of a still; for a moving person expected height or horizon"
            )
        if self._frames.cache is None:
            self._analyser.check_standing(floor, number)

    def prepare(self, report: Report) -> None:
        """Do the long work that comes before the first frame: fit matched and painted lights."""
        reference = self.matching.reference_person(self._frames.matting_options)
        if reference is not None:
            report(0, 1, "Matching")
            image, mask = reference
            self.every_light += lights_on(self._analyse(image, mask, device=self.compute.device), image)
        if self.lighting.paint is not None:
            report(0, 1, "Painting")
            self._paint(self.lighting.paint)

    def _paint(self, picture: Picture) -> None:
        """Let the lights that a picture of strokes asks for take the place of all others.

        The strokes are on the first frame with a person. Raises as `paint_lights` does.
        """
        strokes = read_strokes(picture)
        present = [*scaled(self.preset_lights, self.preset_gain), *self.every_light]
        number = next((each for each in self.numbers if not self._persons.at(each).is_empty), self.numbers[0])
        lighting = self.lighting
        self.every_light = [
            *paint_lights(
                self.subject(number), strokes, as_lights(present) or None, count=lighting.paint_count,
                gloss=lighting.effective_gloss,
            )
        ]  # fmt: skip
        self.preset_lights = []

    def write_plot(self, path: Path, number: int) -> None:
        """Draw the lighting plot of a frame; of the first with a person if it shows none."""
        person = self.person(number)
        if person.is_empty:
            number = next((each for each in self.numbers if not self.person(each).is_empty), number)
            person = self.person(number)
        title = Path(self.source.plate).name if is_path(self.source.plate) else "Lighting plot"
        plot_of(path, self.exposed_lights(number), person.camera, title)

    def write_lights(self, path: Path, start: int) -> None:
        """Write the lights file; with a matched plate it has the light of the background's frame `start`."""
        shining = self._backgrounds.lights(start, self.size(start)) if self.matching.plate else []
        lights = [*self.all_lights(self.preset_gain), *shining]
        write_rig(path, self.matching.with_sidecar(path, lights))
