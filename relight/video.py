"""Relit sequences and movies: moving lights on a still, a still light on a moving person, or both."""

import importlib
import math
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from relight import __version__, keying
from relight.cutting import Cutting
from relight.floor import Floor
from relight.lights.environment import FIELD_OF_VIEW
from relight.lights.light import Light, by_name
from relight.lights.moving import MovingLight, lights_at
from relight.lights.near import NearLight
from relight.matching import PLATE, Matching, lights_in
from relight.media import images, movies
from relight.media.identity import NAME, identity
from relight.media.sequences import Frames, Sequence
from relight.outputs import ALL, END, FRAMES, PARTS, Report, check, open_outputs
from relight.people import People, computing
from relight.preparation import Placement, Preparation, Source, Surface
from relight.rendering import Background, check_exr_type, check_names, described, render_subject
from relight.subject import weights
from shadow import inputs
from shadow.directions import CAMERA
from shadow.networks.precision import in_use

RATE = 24  # frames a second, where nothing says otherwise


def render_video(
    source: Source,
    lights: Light | MovingLight | Iterable[Light | MovingLight],
    outputs: str | Path | Iterable[str | Path],
    *,
    frames: tuple[int, int] | str | Frames | None = None,
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
    autocrop: bool = False,
    floor: Floor | None = None,
    steady: bool = True,
    rate: float | None = None,
    view: str | None = None,
    exposure: float = 0.0,
    white: float = movies.WHITE,
    save_matte: str | Path | None = None,
    save_lights: str | Path | None = None,
    device: str | None = None,
    precision: str | None = None,
    threads: int | None = None,
    resume: bool = False,
    part: str = ALL,
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
    frames: (first, last), or text such as "1-100", "1-100x2" or "1-10,20,30-40", see
        `relight.media.sequences.Frames`. Unless given, those of the source; of a still, those of the mask or
        the background, or from the first keyframe of the lights to the last.
    passes: further layers of an .exr, of relight.rendering.PASSES.
    exr_type: "half" or "float", what .exr files hold. autocrop: whether they store the person's box alone;
        as of `relight.write`.
    floor: relight.Floor that the person stands on: their shadow falls on the background. The floor stands
        still, and the person's lowest point is on it in every frame.
    steady: average what the networks find of a moving person over 5 frames, where it is alike.
    rate: frames a second of the movies. Unless given, the source's, or 24.
    view, exposure, white: how light becomes what a display shows, see `relight.media.colour.encode`. White is
        one for all frames, so that they do not pump.
    save_matte: also write the mattes, grey: a sequence of PNG, TIFF or OpenEXR files.
    save_lights: also write the lights to a lights file.
    device: where the networks run, such as "cuda"; the CPU unless given.
    precision, threads: as of `relight.analyse_shot`.
    resume: keep the frames that are there and were made with the same lights, sources, options and weights
        by this version; warns of how many were not. Otherwise all are made anew. An .hdr cannot say what it
        was made with, and is made anew.
    part: what of the work is done: "all"; "frames", those of a chunk of a shot, and no movie and no script;
        or "end", the movies and scripts of the frames that chunks have made, which are checked as `resume`
        does and reported where they are not there. Chunks and their end write what one run writes.
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
    read as well, no frames to make, or none that could be made; of a chunk, that is no error.
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
    if part not in PARTS:
        raise ValueError(f"part: expected one of {', '.join(PARTS)}, got {part!r}")
    prepared = Preparation(
        source, mask=mask, key=key, cutting=cutting, colour_space=colour_space, normals=normals, axes=axes,
        depth=depth, height=height, background=background, field_of_view=field_of_view, placement=placement,
        matching=matching,
    )  # fmt: skip
    _check_fits(prepared, source, precision, steady, floor)
    numbers = frames_of(frames, prepared.span, lamps)
    start = numbers[0] if numbers else (prepared.span or (0,))[0]
    first = lights_at(lamps, start)
    prepared.check_lights(first)
    if matching.keeps(lights_path) is not None and not prepared.borrows_once:
        raise ValueError("save_lights: the light of a background that moves fits in no lights file")
    reference = matching.person(cutting)
    if reference is not None:
        lamps += lights_in(*reference, device=device)
    names = [
        *by_name(lights_at(lamps, start)),
        *([PLATE] if matching.plate else []),
        *(["background"] if prepared.has_background else []),
    ]
    display = {"view": view, "exposure": exposure, "white": white}
    mattes = _mattes(matte_path)
    sinks: list[Any] = open_outputs(
        paths, transparent=not prepared.has_background, resume=resume, part=part, display=display,
        exr={"depth": exr_type, "autocrop": autocrop}, rate=rate or prepared.rate or RATE, names=names,
    )  # fmt: skip
    if lights_path is not None:
        size = prepared.size(start) if matching.plate else (1, 1)
        matching.write_lights(lights_path, [*lamps, *prepared.borrowed(start, size)])
    report = progress or (lambda done, total, what: None)
    if (key is not None or cutting is not None) and not keying.is_compiled():
        report(0, 1, keying.COMPILING)
        importlib.import_module("pymatting")
        report(1, 1, keying.COMPILING)
    in_room = floor is not None or "Z" in passes or any(isinstance(light, NearLight) for light in first)
    people = People(prepared, steady, device, in_room)
    if floor is not None:
        people.check(floor, start)
    with computing(precision, threads):
        runs_in = (None if prepared.kept is not None else in_use(device or "cpu"), threads)
        shot = _Shot(prepared, people, lamps, passes, exr_type, floor, runs_in, sinks, mattes, resume, part)
        return shot.make(numbers, report)


@dataclass(frozen=True)
class _Shot:
    """The frames of a shot, and where they go."""

    prepared: Preparation
    people: People
    lights: list[Light | MovingLight]
    passes: tuple[str, ...]
    exr_type: str
    floor: Floor | None
    computing: tuple[str | None, int | None]  # precision and threads
    sinks: list[Any]
    mattes: Sequence | None
    resume: bool
    part: str

    def make(self, numbers: Frames, report: Report) -> dict[int, str]:
        """All frames; {frame number: what is wrong}. ValueError if none of a whole shot could be made."""
        made = self._checked(numbers, report) if self.resume or self.part == END else {}
        for sink in self.sinks:
            sink.begin(made)
        if self.resume:
            self._warn_of_others(made)
        make = self._expect if self.part == END else self._make
        problems = {}
        for done, number in enumerate(numbers, 1):
            try:
                made[number] = made.get(number) or self._identity(number)
                make(number, made[number])
            except (OSError, ValueError) as error:
                problems[number] = str(error)
            report(done, len(numbers), "Relighting")
        if len(problems) == len(numbers) and self.part != FRAMES:
            first = f"frame {numbers[0]}: {problems[numbers[0]]}"
            raise ValueError(f"none of {len(numbers)} frames could be made; {first}")
        for sink in self.sinks if self.part != FRAMES else ():
            sink.finish(numbers, made, problems, report)
        return problems

    def _checked(self, numbers: Frames, report: Report) -> dict[int, str]:
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
            self.passes, self.floor, __version__, *weights(), self.computing,
        )  # fmt: skip

    def _warn_of_others(self, made: dict[int, str]) -> None:
        others = sum(any(sink.holds_another(n, made[n]) for sink in self.sinks) for n in made)
        if others:
            warnings.warn(
                f"resume: {others} of {len(made)} frames were made with other lights, sources, options, "
                "weights or by another version, and are made anew",
                stacklevel=4,
            )

    def _expect(self, number: int, made: str) -> None:
        """ValueError where an output lacks the frame."""
        for sink in self.sinks:
            if not sink.has(number, made):
                state = "made with other lights, sources or options" if sink.there(number) else "not there"
                raise ValueError(f"{sink.path}: the frame is {state}")

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


def _check_fits(
    prepared: Preparation, source: Source, precision: str | None, steady: bool, floor: Floor | None
) -> None:
    """ValueError for options that a kept analysis, or a person who moves, leaves no room for."""
    if prepared.kept is not None and (precision is not None or not steady):
        option = "steady" if precision is None else "precision"
        raise ValueError(f"{option}: {source} is analysed already; give it to `relight analyse`")
    if floor is not None and floor.feet is not None and prepared.numbers is not None:
        raise ValueError("floor: feet are those of a still; of a moving person expected height or horizon")


def frames_of(
    frames: tuple[int, int] | str | Frames | None,
    span: tuple[int, int] | None,
    lights: list[Light | MovingLight],
) -> Frames:
    """The numbers of the frames to make, in order."""
    spans = [light.span for light in lights if isinstance(light, MovingLight) and light.span]
    frames = span if frames is None else frames
    if frames is None and spans:
        frames = math.floor(min(first for first, _ in spans)), math.ceil(max(last for _, last in spans))
    if frames is None:
        raise ValueError("frames: expected (first, last), as neither source nor lights say how many")
    return Frames.of(frames)


def _mattes(path: Path | None) -> Sequence | None:
    """The sequence that mattes are written to."""
    sequence = None if path is None else Sequence.of(path)
    if path is not None and sequence is None:
        raise ValueError(f"{path}: expected a frame number in the name, such as matte.%04d.png")
    return sequence
