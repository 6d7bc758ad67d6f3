"""Relit sequences and movies: moving lights on a still, a still light on a moving person, or both."""

import contextlib
import importlib
import math
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from relight import __version__, keying
from relight.cutting import Cutting
from relight.depth import Camera
from relight.floor import Floor
from relight.foreground import matte_of, plate_of
from relight.lights.environment import FIELD_OF_VIEW
from relight.lights.light import Light, Lights, by_name
from relight.lights.moving import MovingLight, lights_at
from relight.lights.near import NearLight
from relight.matching import PLATE, Matching, lights_in
from relight.media import images, movies
from relight.media.identity import NAME, identity
from relight.media.sequences import Sequence
from relight.outputs import Report, check, open_outputs
from relight.preparation import Placement, Preparation, Source, Surface
from relight.rendering import Background, check_exr_type, check_names, described, render_subject
from relight.steadying import AROUND
from relight.subject import Subject
from shadow import inputs
from shadow.directions import CAMERA
from shadow.mattes import person_in
from shadow.networks.checkpoints import checksum

RATE = 24  # frames a second, where nothing says otherwise
LAST = 10**9  # of the frame numbers
WEIGHTS = (checksum("field", "shadow"), checksum("shading", "shading"))  # what frames are analysed with


def render_video(
    source: Source,
    lights: Light | MovingLight | Iterable[Light | MovingLight],
    outputs: str | Path | Iterable[str | Path],
    *,
    frames: tuple[int, int] | None = None,
    mask: Source | None = None,
    key: str | None = None,
    cutting: Cutting | None = None,
    background: Background | MovingLight | str | Path | None = None,
    field_of_view: float = FIELD_OF_VIEW,
    placement: Placement | None = None,
    matching: Matching | None = None,
    colour_space: str | None = None,
    normals: Surface | None = None,
    axes: str = CAMERA,
    depth: Source | None = None,
    height: float | None = None,
    passes: Iterable[str] = (),
    exr_type: str = "half",
    floor: Floor | None = None,
    steady: bool = True,
    rate: float | None = None,
    view: str | None = None,
    exposure: float = 0.0,
    white: float = movies.WHITE,
    save_matte: str | Path | None = None,
    save_lights: str | Path | None = None,
    device: str | None = None,
    resume: bool = False,
    progress: Report | None = None,
) -> dict[int, str]:
    """Relight a person frame by frame.

    Parameters
    ----------
    source, mask, key, cutting, colour_space, normals, axes, depth, height, background, field_of_view,
        placement, matching: as of `relight.preparation.Preparation`. Where lights stand in the room, it is
        that of the source's first frame with a person, whichever frames are made. A background may be an
        environment that moves.
    lights: a light, or any number of them; a relight.MovingLight changes with the frame number.
    outputs: a path or several: sequences of files that `relight.write` writes; movies, .mp4 (which needs a
        background) or .mov; and with an .exr sequence, whose files have light groups and passes as
        `relight.rendering` describes them, a Nuke script, .nk.
    frames: (first, last). Unless given, those of the source; of a still, those of the mask or the background,
        or from the first keyframe of the lights to the last.
    passes: further layers of an .exr, of relight.rendering.PASSES.
    exr_type: "half" or "float", what .exr files hold.
    floor: relight.Floor that the person stands on: their shadow falls on the background. The floor stands
        still, and the person's lowest point is on it in every frame.
    steady: average what the networks find of a moving person over 5 frames, where it is alike.
    rate: frames a second of the movies. Unless given, the source's, or 24.
    view, exposure, white: how light becomes what a display shows, see `relight.media.colour.encode`. White is
        one for all frames, so that they do not pump.
    save_matte: also write the mattes, grey: a sequence of PNG, TIFF or OpenEXR files.
    save_lights: also write the lights to a lights file.
    device: where the networks run, such as "cuda"; the CPU unless given.
    resume: keep the frames that are there and were made with the same lights, sources, options and weights
        by this version; warns of how many were not. Otherwise all are made anew. An .hdr cannot say what it
        was made with, and is made anew.
    progress: called with (frames done, frames in all, what is done) after every frame.

    Where nobody is in the frame, the picture is empty. Until a movie is whole, its frames are half-float
    files in a folder beside it, `relit.mp4.frames`: so an interruption loses none.

    Returns
    -------
    {frame number: what is wrong}: the frames that could not be made. The others are there; in a movie the
    frame before stands for them, and its folder of frames is kept, for `resume` when they are mended.

    Raises
    ------
    FileNotFoundError: no such file or frames. OSError: a frame cannot be written.
    TypeError, ValueError: bad arguments, outputs that need frame numbers or a background, outputs that are
    read as well, no frames to make, or none that could be made.
    """
    paths = [Path(path) for path in ([outputs] if isinstance(outputs, str | Path) else outputs)]
    matte_path = None if save_matte is None else Path(save_matte)
    lights_path = None if save_lights is None else Path(save_lights)
    lamps: Any = lights
    lamps = [lamps] if hasattr(lamps, "at") or hasattr(lamps, "samples") else list(lamps)
    matching = matching or Matching()
    read = (source, mask, background, normals, depth, matching.reference, matching.mask, *lamps)
    check(paths, read, mattes=matte_path, lights=lights_path, maps=matching.keeps(lights_path))
    passes = check_names(passes, paths)
    if rate is not None:
        movies.frame_rate(rate)
    check_exr_type(exr_type)
    inputs.device("device", device)
    prepared = Preparation(
        source, mask=mask, key=key, cutting=cutting, colour_space=colour_space, normals=normals, axes=axes,
        depth=depth, height=height, background=background, field_of_view=field_of_view, placement=placement,
        matching=matching,
    )  # fmt: skip
    if floor is not None and floor.feet is not None and prepared.numbers is not None:
        raise ValueError("floor: feet are those of a still; of a moving person expected height or horizon")
    numbers = _numbers(frames, prepared.span, lamps)
    first = lights_at(lamps, numbers[0])
    prepared.check_lights(first)
    if matching.keeps(lights_path) is not None and not prepared.borrows_once:
        raise ValueError("save_lights: the light of a background that moves fits in no lights file")
    reference = matching.person(cutting)
    if reference is not None:
        lamps += lights_in(*reference, device=device)
    names = [
        *by_name(lights_at(lamps, numbers[0])),
        *([PLATE] if matching.plate else []),
        *(["background"] if prepared.has_background else []),
    ]
    display = {"view": view, "exposure": exposure, "white": white}
    mattes = _mattes(matte_path)
    sinks: list[Any] = open_outputs(
        paths, transparent=not prepared.has_background, resume=resume, display=display, depth=exr_type,
        rate=rate or prepared.rate or RATE, names=names,
    )  # fmt: skip
    if lights_path is not None:
        size = prepared.person(numbers[0]).plate.shape[:2] if matching.plate else (1, 1)
        matching.write_lights(lights_path, [*lamps, *prepared.borrowed(numbers[0], size)])
    report = progress or (lambda done, total, what: None)
    if (key is not None or cutting is not None) and not keying.is_compiled():
        report(0, 1, keying.COMPILING)
        importlib.import_module("pymatting")
        report(1, 1, keying.COMPILING)
    in_room = floor is not None or "Z" in passes or any(isinstance(light, NearLight) for light in first)
    people = _People(prepared, steady, device, in_room)
    if floor is not None:
        people.check(floor, numbers[0])
    return _Shot(prepared, people, lamps, passes, exr_type, floor, sinks, mattes, resume).make(
        numbers, report
    )


@dataclass(frozen=True)
class _Shot:
    """The frames of a shot, and where they go."""

    prepared: Preparation
    people: "_People"
    lights: list[Light | MovingLight]
    passes: tuple[str, ...]
    exr_type: str
    floor: Floor | None
    sinks: list[Any]
    mattes: Sequence | None
    resume: bool

    def make(self, numbers: range, report: Report) -> dict[int, str]:
        """All frames; {frame number: what is wrong}. ValueError if none could be made."""
        made = self._checked(numbers, report) if self.resume else {}
        for sink in self.sinks:
            sink.begin(made)
        if self.resume:
            self._warn_of_others(made)
        problems = {}
        for done, number in enumerate(numbers, 1):
            try:
                made[number] = made.get(number) or self._identity(number)
                self._make(number, made[number])
            except (OSError, ValueError) as error:
                problems[number] = str(error)
            report(done, len(numbers), "Relighting")
        if len(problems) == len(numbers):
            first = f"frame {numbers[0]}: {problems[numbers[0]]}"
            raise ValueError(f"none of {len(numbers)} frames could be made; {first}")
        for sink in self.sinks:
            sink.finish(numbers, made, problems, report)
        return problems

    def _checked(self, numbers: range, report: Report) -> dict[int, str]:
        """{frame number: what it is made of}."""
        made = {}
        for done, number in enumerate(numbers, 1):
            made[number] = self._identity(number)
            report(done, len(numbers), "Checking")
        return made

    def _identity(self, number: int) -> str:
        """Differs where the frame is made of something else."""
        lit = lights_at(self.lights, number)
        return identity(
            self.prepared.identity(number, self.people.made_of(number)), [*by_name(lit).items()],
            self.passes, self.floor, __version__, *WEIGHTS,
        )  # fmt: skip

    def _warn_of_others(self, made: dict[int, str]) -> None:
        others = sum(any(sink.holds_another(n, made[n]) for sink in self.sinks) for n in made)
        if others:
            warnings.warn(
                f"resume: {others} of {len(made)} frames were made with other lights, sources, options, "
                "weights or by another version, and are made anew",
                stacklevel=4,
            )

    def _make(self, number: int, made: str) -> None:
        """The frame in all outputs that lack it, and its matte."""
        wanted = [sink for sink in self.sinks if not sink.has(number, made)]
        matte = None if self.mattes is None else self.mattes.path(number)
        if matte is not None and self.resume and images.read_identity(matte) == made:
            matte = None
        if not wanted and matte is None:
            return
        subject = self.people.at(number)
        if wanted:
            lit = lights_at(self.lights, number)
            backdrop = self.prepared.backdrop(number, lit, subject.size)
            lit = [*lit, *self.prepared.borrowed(number, subject.size)]
            picture, layers = render_subject(
                subject,
                lit,
                background=backdrop,
                passes=self.passes,
                exr_type=self.exr_type,
                floor=self.floor,
            )
            metadata = described(subject, self.passes)
            for sink in wanted:
                sink.write(number, picture, layers, made, metadata)
        if matte is not None:
            images.write_mask(matte, subject.matte, metadata={NAME: made})


def _numbers(
    frames: tuple[int, int] | None, span: tuple[int, int] | None, lights: list[Light | MovingLight]
) -> range:
    """The numbers of the frames to make, in order."""
    spans = [light.span for light in lights if isinstance(light, MovingLight) and light.span]
    frames = frames or span
    if frames is None and spans:
        frames = math.floor(min(first for first, _ in spans)), math.ceil(max(last for _, last in spans))
    if frames is None:
        raise ValueError("frames: expected (first, last), as neither source nor lights say how many")
    first, last = frames
    if not 0 <= first <= last <= LAST:
        raise ValueError(f"frames: expected (first, last) with 0 <= first <= last <= {LAST}, got {frames}")
    return range(first, last + 1)


def _mattes(path: Path | None) -> Sequence | None:
    """The sequence that mattes are written to."""
    sequence = None if path is None else Sequence.of(path)
    if path is not None and sequence is None:
        raise ValueError(f"{path}: expected a frame number in the name, such as matte.%04d.png")
    return sequence


class _People:
    """The person of each frame; of a moving one the last few frames are kept, to steady the next."""

    def __init__(self, prepared: Preparation, steady: bool, device: str | None, in_room: bool) -> None:
        """`in_room`: the frames share one room, see `relight.depth.Camera`."""
        self._prepared, self._device, self._in_room = prepared, device, in_room
        self._there = prepared.numbers
        self._reach = AROUND if steady else 0
        self._analysed: dict[int, Subject | _Nobody | Exception] = {}

    def around(self, number: int) -> list[int]:
        """The frames that take part in one: it, and those that steady it; of a still 0, for all frames."""
        if self._there is None:
            return [0]
        near = range(number - self._reach, number + self._reach + 1)
        return [n for n in near if n == number or n in self._there]

    def made_of(self, number: int) -> list[int]:
        """The frames that one is made of: those around it, and the one that says where the room is."""
        first, _ = self._room
        return self.around(number) + ([] if first is None else [first])

    @cached_property
    def _room(self) -> tuple[int | None, Camera | None]:
        """The first frame of a moving person that shows them, and its camera; (None, None) for a still, or
        where nothing stands in the room.

        It depends on the source alone, so that runs over parts of a shot agree.
        """
        for number in self._there or () if self._in_room else ():
            with contextlib.suppress(OSError, ValueError):
                plate, matte, _, _ = self._prepared.person(number)
                coverage = person_in(matte_of(plate_of(plate), matte))
                return number, Camera.of(coverage, self._prepared.height, self._prepared.field_of_view)
        return None, None

    def check(self, floor: Floor, number: int) -> None:
        """ValueError where the person cannot stand on the floor in the frame that says where the room is, or
        of a still in any."""
        first, _ = self._room
        if first is not None or self._there is None:
            plate, matte, _, _ = self._prepared.person(number if first is None else first)
            floor.check(plate, matte)

    def at(self, number: int) -> Any:
        """A Subject, or the like of one; raises as reading and `Subject` do."""
        around = self.around(number)
        number = number if number in around else 0
        self._analysed = {n: found for n, found in self._analysed.items() if n in around}
        for n in around:
            if n not in self._analysed:
                self._analysed[n] = self._analyse(n)
        subject = self._analysed[number]
        if isinstance(subject, Exception):
            raise subject
        others = [found for found in self._analysed.values() if isinstance(found, Subject)]
        if not isinstance(subject, Subject) or len(others) == 1:
            return subject
        return subject.steadied([other for other in others if other is not subject])

    def _analyse(self, number: int) -> "Subject | _Nobody | Exception":
        """The Subject of a frame, nobody, or what is wrong with it."""
        try:
            plate, matte, normals, depth = self._prepared.person(number)
            coverage = plate[..., 3:] if matte is None else matte
            if self._there is not None and coverage.size and coverage.max() <= 0.5:
                return _Nobody(plate.shape[:2])
            return Subject(
                plate, matte, normals=normals, depth=depth, height=self._prepared.height,
                field_of_view=self._prepared.field_of_view, camera=self._room[1], device=self._device,
            )  # fmt: skip
        except (OSError, ValueError) as error:
            return error


class _Nobody:
    """The Subject of a frame in which nobody is."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size
        self.matte = self.depth = np.zeros(size, np.float32)
        self.distance, self.camera = 0.0, Camera(size, 0.0, (0.0, 0.0), 0.0, 0)
        self.albedo = self.normals = self.lighting(None)

    def relit(self, lights: object) -> np.ndarray:
        return np.zeros((*self.size, 4), np.float32)

    def lighting(self, lights: object) -> np.ndarray:
        return np.zeros((*self.size, 3), np.float32)

    def unshadowed(self, light: object) -> np.ndarray:
        return self.matte

    def shadows(self, lights: Lights, floor: object) -> tuple[dict[str, np.ndarray], np.ndarray]:
        none = np.ones((*self.size, 3), np.float32)
        return dict.fromkeys(by_name(lights), none), none
