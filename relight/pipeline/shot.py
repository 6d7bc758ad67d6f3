"""A shot on disk with its lights: a still, a sequence, a movie or an analysis cache, opened once."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from functools import cached_property, partial
from pathlib import Path
from typing import Self

import torch

from relight.analysis import skin
from relight.analysis.camera import Camera
from relight.media.content_hash import FileRecord, content_hash
from relight.pipeline import outputs, preview
from relight.pipeline.backgrounds import Backgrounds, background_reader
from relight.pipeline.cache import check_not_analysed, is_cache
from relight.pipeline.frame import FrameInputs, FrameReader
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Compute, GivenLighting, GivenSource, Lighting, Output, Source
from relight.pipeline.persons import FrameAnalyser, FramePerson, Persons
from relight.pipeline.readers import Reader, ReadLog
from relight.pipeline.shot_lights import ShotLights, sidecar
from relight.quantities import ENVIRONMENT, PLATE
from relight.scene.plot import plot_of
from relight.scene.usd.read import Rig
from relight.subject import Subject, weights
from relight.version import __version__
from shadow import inputs as checks
from shadow.files import is_path
from shadow.networks.precision import in_use, using


class Shot:
    """The frames of a shot: persons, the lights on them, and what is behind them.

    Lights and camera are read at once, pictures when they are asked for. A still is a shot whose only number
    is 0, and shows the same person at every number: its lights and its background may move. `analyse`
    analyses the person of a frame, from the arguments of `relight.Subject`, the default. `is_preview`: see
    `relight.pipeline.preview`. Raises FileNotFoundError for no such file or frames, TypeError or ValueError
    for bad arguments.

    >>> from relight.pipeline.shot import Shot
    >>> with Shot.open("examples/person.png", relight.DirectionalLight(azimuth=-40)) as shot:
    ...     picture = shot.person(0).relit(shot.lights.at(0))
    >>> picture.shape
    (982, 502, 4)
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
        checks.device("device", self.compute.device)
        check_not_analysed(self.source, self.compute)
        self._rig = self.lighting.rig() if self.lighting.has_lights else Rig([])
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
    def frames(self) -> FrameReader:
        """What reads the persons."""
        return FrameReader(self.source, self._background_reader, self._log, self._rig.view, self.is_preview)

    @cached_property
    def _analyser(self) -> FrameAnalyser:
        """What analyses the persons; it does nothing in an analysis cache."""
        return FrameAnalyser(self.frames, self.compute.device, self._analyse)

    @cached_property
    def persons(self) -> Persons:
        """The persons, analysed or read from an analysis cache."""
        frames, numbers = self.frames, None if self.is_still else self.numbers
        if frames.cache is not None:
            return Persons(numbers, frames.cache.read, None, reference=lambda: self.reference)
        radius = frames.temporal_radius
        return Persons(numbers, self._analyser, radius, frames.is_cut, lambda: self.reference)

    @cached_property
    def lights(self) -> ShotLights:
        """The lights on the persons."""
        return ShotLights(self.lighting, self._rig.lights, self.persons)

    @cached_property
    def _background_reader(self) -> Reader:
        """What reads the backgrounds that are other pictures than the plate; frames may have their size."""
        return background_reader(self.lighting)

    @cached_property
    def backgrounds(self) -> Backgrounds:
        """What is behind the persons, and its light."""
        return Backgrounds(self.lighting, self.lights, self.frames, self._background_reader, self._log)

    @property
    def _balance(self) -> tuple[object, ...]:
        """How strong the lights are beside each other and the photograph."""
        lighting = self.lighting
        return lighting.preset, lighting.fill, lighting.fill_amount, lighting.amount, lighting.intensity

    # What is so of all frames

    @property
    def is_still(self) -> bool:
        """Whether the person does not move."""
        return self.frames.is_still

    @property
    def is_analysed(self) -> bool:
        """Whether the source is an analysis cache, of which no network runs."""
        return is_cache(self.source.plate)

    @property
    def stated_source(self) -> Source:
        """The source with the field of view of the scene's camera, for runs that do not read the scene."""
        if self._rig.view is None or self.is_analysed:
            return self.source
        return replace(self.source, field_of_view=self.frames.field_of_view)

    @property
    def numbers(self) -> Sequence[int]:
        """The numbers of the person's frames, in order; (0,) for a still."""
        return self.frames.numbers

    @property
    def rate(self) -> Fraction | float | None:
        """Frames a second, if the source states it."""
        return self.frames.plates.rate

    @property
    def files(self) -> tuple[object, ...]:
        """What is read: paths, and lights whose images are files. Those in memory are among them."""
        source, lighting = self.source, self.lighting
        return (
            source.plate, source.mask, source.track, source.normals, source.depth, lighting.background,
            lighting.match, lighting.match_mask, lighting.paint, lighting.lights, *self._rig.lights,
        )  # fmt: skip

    @property
    def skin_is_known(self) -> bool:
        """Whether the network that sees skin takes part in an analysis, see `relight.analysis.skin`."""
        return self.frames.cache is None and skin.is_available()

    @property
    def computed_in(self) -> tuple[str | None, int | None]:
        """The precision and the threads on which the pixels depend; no network runs for an analysis cache."""
        cached = self.frames.cache is not None
        return None if cached else in_use(self.compute.device or "cpu"), self.compute.threads

    def picture_size(self) -> tuple[int, ...]:
        """Return the size (H, W) of the pictures, in pixels: that of the first frame that can be read."""
        size = self.frames.picture_size()
        return tuple(length // 2 for length in size) if self.is_preview else size

    # One frame

    def frame(self, number: int) -> FrameInputs:
        """Return a frame as `relight.Subject` takes it. Raises as reading and `relight.key` do."""
        return self.frames.read(number)

    def person(self, number: int) -> Subject:
        """Return the person of a frame, filtered in time. Raises the errors of reading and of Subject."""
        return self.found_person(number).subject

    def found_person(self, number: int) -> FramePerson:
        """Return the person of a frame, as `person` does, and how they were found."""
        person, neighbours = self.persons.filtered(number)
        if self.frames.cache:
            return FramePerson(person, None, None)
        return FramePerson(person, self.frames.certainty(number), neighbours)

    @property
    def reference(self) -> int | None:
        """The reference frame, see `relight.pipeline.reference`; None for a still, or without a person."""
        return self._world[0] if self.frames.cache is None else self.frames.cache.reference

    @property
    def likely_reference(self) -> int | None:
        """The reference frame as far as it can be told without a matte."""
        return None if self.frames.cache else next(iter(self.frames.references[0]), None)

    def content_hash(self, number: int, *further: object, as_read: bool = False) -> str:
        """Return a hash of all from which a frame is made; `further`: what its outputs add.

        `as_read`: whether to hash files as they were read, if they were, or as they are now.
        """
        lights, lighting = self.lights.at(number), self.lighting
        around = self._analysed_frames(number)
        if followed := self.lights.frames_of(number):
            around = sorted({*around, *followed})
        seen, shining = self.backgrounds.hashes(number, as_read)
        return content_hash(
            self.frames.person_hash(around, as_read), self._world[0],
            seen, shining, lighting.background_colour_space,
            lighting.has_background, lighting.background_is(ENVIRONMENT),
            lighting.background_light, lighting.background_blur,
            lighting.match_plate, lights, *self._balance, lighting.floor, lighting.effective_gloss,
            __version__, *weights(), self.computed_in,
            self.skin_is_known, *further,
        )  # fmt: skip

    def person_hash(self, number: int, as_read: bool = False) -> str:
        """Return a hash of all that determines the analysis of a frame."""
        return content_hash(
            self.frames.person_hash(self._analysed_frames(number), as_read),
            self._world[1],
            __version__,
            *weights(),
            self.computed_in,
            self.skin_is_known,
        )

    def records(self, number: int) -> list[FileRecord]:
        """Return the records, made when they were read, of the files from which a person is analysed."""
        return self.frames.records(self._analysed_frames(number))

    def _analysed_frames(self, number: int) -> list[int]:
        """Return the frames on which a person depends: those around, and the reference."""
        first, _ = self._world
        around = self.persons.around(number)
        return around if first is None or first in around else [*around, first]

    @property
    def _world(self) -> tuple[int | None, Camera | None]:
        """See `FrameAnalyser.world`; the frames of an analysis cache have their places already."""
        return (None, None) if self.frames.cache is not None else self._analyser.world

    # Checks and preparation, before the first frame

    @cached_property
    def span(self) -> tuple[int, int] | None:
        """The first and the last frame of the sources; the person's take precedence over the background's."""
        numbers = next((each.numbers for each in self.frames.readers if each.numbers), None)
        numbers = numbers or self.backgrounds.numbers
        return (numbers[0], numbers[-1]) if numbers else None

    def check_outputs(self, output: Output, *further: Path) -> None:
        """Refuse outputs that cannot be written, or that this shot or `further` reads."""
        lights_file, matched = output.save_lights, self.lighting.match_plate
        beside = sidecar(lights_file) if lights_file is not None and matched else None
        outputs.check_outputs(output, (*self.files, *further), beside)
        if beside is not None and self.backgrounds.numbers is not None:
            raise ValueError(
                "save_lights: the light of a background that moves cannot be stored in a lights file"
            )

    def check_not_read(self, paths: Iterable[Path]) -> None:
        """Raise ValueError if one of these paths, which are to be written, is read."""
        outputs.check_not_read(paths, self.files)

    def check_lights(self, number: int) -> None:
        """Raise ValueError if a frame's lights do not go with the background, or with each other."""
        self.backgrounds.check_lights(number)
        self.lights.check(number)

    def lighting_of_analysed(self, output: Output) -> Lighting:
        """Return the lighting for frames relit from their analysis: it names a plate that is behind them.

        Beside an .exr, which holds the cut-out, pictures are cut out too. ValueError for an output that
        then cannot hold the alpha, or a plate that cannot be the background.
        """
        self.backgrounds.check_plate()
        shown = outputs.shows_backgrounds(output) and not any(map(outputs.is_exr, output.paths))
        is_plate = self.lighting.background_is(PLATE) or (shown and self.backgrounds.keeps_plate)
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
        if self.frames.cache is None:
            self._analyser.check_standing(floor, number)

    def prepare(self, report: Report) -> None:
        """Do the long work that comes before the first frame: fit matched and painted lights."""
        analyse = partial(self._analyse, device=self.compute.device)
        self.lights.estimate(analyse, self.frames.matting_options, report)

    def write_plot(self, path: Path, number: int) -> None:
        """Draw the lighting plot of a frame; of the first with a person if it shows none."""
        number = self.persons.first_found(number)
        title = Path(self.source.plate).name if is_path(self.source.plate) else "Lighting plot"
        camera = self.persons.analysed(number).camera
        plot_of(path, self.lights.placed(number), camera, title)

    def write_lights(self, path: Path, start: int) -> None:
        """Write the lights file; with a matched plate it has the light of the background's frame `start`."""
        shining = self.backgrounds.lights(start, self.picture_size()) if self.lighting.match_plate else []
        self.lights.write(path, shining)
