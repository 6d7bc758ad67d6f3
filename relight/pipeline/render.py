"""Renders a shot from files to files: a still, a sequence or a movie. A still is a shot of one frame."""

import dataclasses
import math
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from relight import __version__
from relight.light_estimation import PLATE, lights_in
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light, by_name
from relight.lights.moving import MovingLight, lights_at, parse
from relight.lights.near import NearLight
from relight.media import images, movies
from relight.media.content_hash import HASH_ATTRIBUTE, content_hash
from relight.media.sequences import FrameRange
from relight.pipeline.cache import check_not_analysed, is_cache
from relight.pipeline.delivery import Delivery
from relight.pipeline.frames import FrameAnalyser, computing
from relight.pipeline.inputs import ShotInputs
from relight.pipeline.option_fields import Phase
from relight.pipeline.options import Compute, Lighting, Output, Source
from relight.pipeline.outputs import FRAME_NUMBER, Report, check_outputs, has_frames, is_exr
from relight.pipeline.sinks import Sink, file_of, open_sinks
from relight.rendering import Layers, check_names, metadata_of, render_subject
from relight.scene.lights import read_lights, read_rig, write_lights
from relight.subject import Subject, weights
from shadow import inputs as checks
from shadow.networks.precision import in_use


def render_shot(
    source: Source | Any,
    lighting: Lighting | Any,
    output: Output | Any,
    *,
    compute: Compute | None = None,
    frames: tuple[int, int] | str | FrameRange | None = None,
    resume: bool = False,
    phase: Phase | str = Phase.all,
    progress: Report | None = None,
) -> dict[int, str]:
    """Relight a still, a sequence, a movie or an analysis cache, from files to files.

    Parameters
    ----------
    source
        Source, or a plate: an image (H, W, 3|4), or the path of a still, a sequence, a movie or an analysis
        cache.
    lighting
        Lighting, or lights. A relight.MovingLight changes with the frame number.
    output
        Output, or paths. Single files are a still. Sequences and movies have frames; for a still source, the
        lights, the mask or the background determine their number.
    compute
        Compute: device, precision and threads.
    frames
        (first, last), or text such as "1-100", "1-100x2" or "1-10,20,30-40". By default those of the source,
        the mask or the background, or from the first keyframe of the lights to the last.
    resume
        Whether to keep existing frames that were made from the same lights, sources, options and weights by
        this version; a warning gives the number of others. Otherwise all frames are made again. An .hdr
        cannot store its provenance, and is always made again.
    phase
        "all"; "frames", for a chunk of a shot, without movies and scripts; or "finalize", for movies and
        scripts from the frames of all chunks. Frames that are missing or have another provenance are
        reported. Together the phases write the same files as "all".
    progress
        Called with (frames done, number of frames, name of the step) after every frame.

    Returns
    -------
    dict[int, str]
        {frame number: error} of the frames that could not be made. All others exist. A movie repeats the
        previous frame for a missing one, and its folder of frames is kept, so that `resume` can complete it.

    Raises
    ------
    FileNotFoundError
        No such file or frames.
    OSError
        A frame cannot be written.
    TypeError, ValueError
        Bad arguments; outputs that need frame numbers or a background; outputs that are also inputs; no
        frames to make, or none that could be made (except in a chunk).

    Notes
    -----
    The picture of a frame without a person is empty. Until a movie is complete, its frames are half-float
    files in a folder beside it, `relit.mp4.frames`, so an interruption loses none of them.

    Examples
    --------
    >>> key = relight.DirectionalLight(azimuth=-40, elevation=30, name="key")
    >>> relight.render_shot("examples/person.png", key, "relit.exr")
    {}
    """
    source, lighting, output = Source.of(source), Lighting.of(lighting), Output.of(output)
    compute, phase = compute or Compute(), checked_phase(phase)
    report = progress or (lambda done, total, what: None)
    lights = lights_of(lighting)
    moving = has_frames(output)
    _check_arguments(source, lighting, output, compute, lights)
    with computing(compute):
        inputs = ShotInputs(seen_by(source, lighting), lighting)
        numbers = frames_of(frames, inputs, lights, output)
        start = numbers[0] if numbers else (inputs.span or (0,))[0]
        _check_fits(inputs, lighting, output, lights_at(lights, start))
        reference = inputs.matching.reference_person(inputs.matting_options)
        if reference is not None:
            report(0, 1, "Matching")
            lights += lights_in(*reference, device=compute.device)
        delivery = Delivery(inputs, output.rate)
        sinks = open_sinks(
            output, moving=moving, transparent=not inputs.has_background, resume=resume, phase=phase,
            delivery=delivery, groups=_groups(inputs, lights_at(lights, start)),
        )  # fmt: skip
        inputs.compile_matting(report)
        near = any(isinstance(light, NearLight) for light in lights_at(lights, start))
        world = lighting.floor is not None or bool({"Z", "P"} & set(output.passes)) or near
        analyser = FrameAnalyser(inputs, compute.device, shared_world=world)
        if lighting.floor is not None:
            analyser.check(lighting.floor, start)
        shot = ShotRenderer(
            inputs, analyser, lights, lighting, output, compute, sinks, resume, phase, delivery
        )
        problems = shot.render(numbers, report)
        if output.save_lights is not None:
            shot.write_lights(start)
    return problems


class ShotRenderer:
    """The frames of a shot, and where they go."""

    def __init__(
        self,
        inputs: ShotInputs,
        analyser: FrameAnalyser,
        lights: list[Light | MovingLight],
        lighting: Lighting,
        output: Output,
        compute: Compute,
        sinks: list[Sink],
        resume: bool,
        phase: Phase,
        delivery: Delivery,
    ) -> None:
        self.delivery = delivery
        self.inputs, self.analyser, self.lights = inputs, analyser, lights
        self.output, self.floor, self.gloss, self.sinks = output, lighting.floor, lighting.gloss, sinks
        self.resume, self.phase = resume, phase
        self.mattes = None if output.save_matte is None else file_of(output.save_matte)
        precision = None if inputs.cache is not None else in_use(compute.device or "cpu")
        self._computed_in = precision, compute.threads
        self.raises = not has_frames(output)  # or reports what is wrong with a frame, and goes on

    def render(self, numbers: FrameRange, report: Report) -> dict[int, str]:
        """Render all frames; return {frame number: error}.

        Raises if no frame of a whole shot could be made.
        """
        made = self._check(numbers, report) if self.resume or self.phase is Phase.finalize else {}
        for sink in self.sinks:
            sink.begin(made)
        if self.resume:
            self._warn_of_replaced(made)
        make = self._expect if self.phase is Phase.finalize else self._make
        problems: dict[int, str] = {}
        for done, number in enumerate(numbers, 1):
            try:
                made[number] = make(number, made.get(number) or self.content_hash(number))
            except (OSError, ValueError) as error:
                if self.raises:
                    raise
                problems[number] = str(error)
            report(done, len(numbers), "Relighting")
        if numbers and len(problems) == len(numbers) and self.phase is not Phase.frames:
            first = f"frame {numbers[0]}: {problems[numbers[0]]}"
            raise ValueError(f"none of {len(numbers)} frames could be made; {first}")
        for sink in self.sinks if self.phase is not Phase.frames else ():
            sink.finish(numbers, made, problems, report)
        return problems

    def content_hash(self, number: int, as_read: bool = False) -> str:
        """Return a hash of all from which a frame is made. `as_read`: see `ShotInputs.content_hash`."""
        return content_hash(
            self.analyser.content_hash(self.source_frame(number), as_read),
            [*by_name(self.lights_at(number)).items()],
            self.output.passes, self.floor, self.gloss, __version__, *weights(), self._computed_in,
        )  # fmt: skip

    def source_frame(self, number: int) -> int:
        """Return the frame of the source that a frame shows."""
        return number

    def subject(self, number: int) -> Any:
        """Return the person of a frame."""
        return self.analyser.at(self.source_frame(number))

    def lights_at(self, number: int) -> list[Light]:
        """Return the lights of a frame, without that of the background."""
        return lights_at(self.lights, number)

    def picture(self, subject: Subject, number: int) -> tuple[Any, Layers, images.Metadata]:
        """Return a frame's picture, its layers, and the metadata for the file's header."""
        lights = self.lights_at(number)
        background = self.inputs.background(number, lights, subject.size)
        lights += self.inputs.background_lights(number, subject.size)
        picture, layers = render_subject(
            subject, lights, background=background, passes=self.output.passes,
            exr_type=self.output.exr_type.value, floor=self.floor, gloss=self.gloss,
        )  # fmt: skip
        return picture, layers, metadata_of(subject, self.output.passes)

    def write_lights(self, start: int) -> None:
        """Write the lights file; with a matched plate it has the light of the background's frame `start`."""
        assert self.output.save_lights is not None
        matching = self.inputs.matching
        size = self.analyser.size(start) if matching.plate else (1, 1)
        lights = [*self.lights, *self.inputs.background_lights(start, size)]
        write_lights(self.output.save_lights, matching.with_sidecar(self.output.save_lights, lights))

    def _check(self, numbers: FrameRange, report: Report) -> dict[int, str]:
        """{frame number: content hash of what it is made from}."""
        made = {}
        for done, number in enumerate(numbers, 1):
            made[number] = self.content_hash(number)
            report(done, len(numbers), "Checking")
        return made

    def _warn_of_replaced(self, made: dict[int, str]) -> None:
        others = sum(any(s.exists(n) and not s.has(n, made[n]) for s in self.sinks) for n in made)
        if others:
            warnings.warn(
                f"resume: {others} of {len(made)} frames were made with other lights, sources, options, "
                "weights or by another version, and are made again",
                stacklevel=4,
            )

    def _expect(self, number: int, made: str) -> str:
        """Raise ValueError if an output lacks the frame."""
        for sink in self.sinks:
            if not sink.has(number, made):
                state = "made with other lights, sources or options" if sink.exists(number) else "not there"
                raise ValueError(f"{sink.path}: the frame is {state}")
        return made

    def _make(self, number: int, made: str) -> str:
        """Write the frame to all outputs that lack it, and its matte; return what it is made from."""
        wanted = [sink for sink in self.sinks if not sink.has(number, made)]
        matte = None if self.mattes is None else self.mattes.path(number)
        if matte is not None and self.resume and images.read_content_hash(matte) == made:
            matte = None
        if not wanted and matte is None:
            return made
        subject = self.subject(number)
        made = self.content_hash(number, as_read=True)
        if wanted:
            picture, layers, own = self.picture(subject, number)
            metadata = {**self.delivery.metadata(self.source_frame(number)), **own}
            for sink in wanted:
                sink.write(number, picture, layers, made, metadata)
        if matte is not None:
            self._write_matte(matte, subject.matte, made)
        return made

    def _write_matte(self, path: Path, matte: Any, made: str) -> None:
        """Write a matte; an .exr has pixels of the plate's shape."""
        metadata: dict[str, Any] = {HASH_ATTRIBUTE: made}
        if is_exr(path) and self.delivery.pixel_aspect != 1:
            matte = self.delivery.squeeze(matte).clip(0, 1)
            metadata["PixelAspectRatio"] = self.delivery.pixel_aspect
        images.write_mask(path, matte, metadata=metadata)


def checked_phase(phase: Phase | str) -> Phase:
    """Return the phase of a name; raises ValueError for other names."""
    if phase not in list(Phase):
        raise ValueError(f"phase: expected one of {', '.join(Phase)}, got {phase!r}")
    return Phase(phase)


def lights_of(lighting: Lighting) -> list[Light | MovingLight]:
    """Return the lights of the objects, the lights file and the texts.

    Raises ValueError if there are none.
    """
    given: Any = lighting.lights
    scene: dict[str, Any] = {
        "camera": lighting.camera,
        "subject_at": lighting.subject_at,
        "allow_external": lighting.allow_external,
    }
    if isinstance(given, tuple):
        for name, value in scene.items():
            if value:
                raise ValueError(f"{name}: expected a USD stage or a glTF scene (--lights), which has it")
    lights = list(given) if isinstance(given, tuple) else read_lights(given, **scene)
    lights += [parse(text) for text in lighting.light]
    lights += [parse(text, EnvironmentLight) for text in lighting.environment]
    if not lights and not lighting.has_lights:
        raise ValueError(
            "lights: expected at least one (--light, --environment, --lights, --match or --match-plate)"
        )
    return lights


def seen_by(source: Source, lighting: Lighting) -> Source:
    """Return the source with the field of view of the scene's camera, unless it states its own."""
    scene: Any = lighting.lights
    if isinstance(scene, tuple) or source.field_of_view is not None or is_cache(source.plate):
        return source
    rig = read_rig(
        scene,
        camera=lighting.camera,
        subject_at=lighting.subject_at,
        allow_external=lighting.allow_external,
    )
    return source if rig.vertical is None else dataclasses.replace(source, field_of_view=rig.vertical)


def frames_of(
    frames: tuple[int, int] | str | FrameRange | None,
    inputs: ShotInputs,
    lights: Iterable[Light | MovingLight],
    output: Output,
) -> FrameRange:
    """Return the numbers of the frames to make, in order; 0 for a still."""
    spans = [light.span for light in lights if isinstance(light, MovingLight) and light.span]
    if not has_frames(output):
        if frames is None and inputs.span is not None:
            raise ValueError(
                f"{output.paths[0]}: expected {FRAME_NUMBER}, as the source has frames; or choose one frame "
                "(--frames 7)"
            )
        moving = [light for light in lights if isinstance(light, MovingLight)]
        if frames is None and moving:
            raise ValueError(
                f"lights: {moving[0].name or 'a light'} moves; choose one frame (--frames 7), or write "
                f"frames: expected {FRAME_NUMBER}"
            )
        numbers = FrameRange((0,)) if frames is None else FrameRange.of(frames)
        if len(numbers) > 1:
            raise ValueError(f"{output.paths[0]}: expected {FRAME_NUMBER}, for {len(numbers)} frames")
        return numbers
    frames = inputs.span if frames is None else frames
    if frames is None and spans:
        frames = math.floor(min(first for first, _ in spans)), math.ceil(max(last for _, last in spans))
    if frames is None:
        raise ValueError("frames: expected (first, last), as neither source nor lights say how many")
    return FrameRange.of(frames)


def _check_arguments(
    source: Source,
    lighting: Lighting,
    output: Output,
    compute: Compute,
    lights: list[Light | MovingLight],
) -> None:
    """Refuse what can be refused before anything is read."""
    read = (
        source.plate, source.mask, source.normals, source.depth, lighting.background, lighting.match,
        lighting.match_mask, lighting.lights, *lights,
    )  # fmt: skip
    matched = output.save_lights if lighting.match_plate else None
    sidecar = None if matched is None else matched.with_name(f"{matched.stem}.{PLATE}.exr")
    check_outputs(output, read, sidecar)
    check_names(output.passes, output.paths)
    if output.rate is not None:
        movies.frame_rate(output.rate)
    checks.device("device", compute.device)
    check_not_analysed(source, compute)


def _check_fits(inputs: ShotInputs, lighting: Lighting, output: Output, lights: list[Light]) -> None:
    """Refuse lights, a floor or a lights file that do not go with the inputs."""
    inputs.check_lights(lights)
    if inputs.matching.plate and output.save_lights is not None and not inputs.background_is_still:
        raise ValueError(
            "save_lights: the light of a background that moves cannot be stored in a lights file"
        )
    if lighting.floor is not None and lighting.floor.feet is not None and inputs.numbers is not None:
        raise ValueError("floor: feet are those of a still; for a moving person expected height or horizon")


def _groups(inputs: ShotInputs, lights: list[Light]) -> list[str]:
    """Return the names of a frame's light groups, including that of the background."""
    background = ["background"] if inputs.has_background else []
    return [*by_name(lights), *([PLATE] if inputs.matching.plate else []), *background]
