"""Renders a shot from files to files: a still, a sequence or a movie. A still is a shot of one frame."""

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

from relight.media import images, movies
from relight.media.content_hash import HASH_ATTRIBUTE, content_hash
from relight.media.sequences import FrameRange
from relight.pipeline.delivery import Delivery
from relight.pipeline.option_fields import Phase, Report
from relight.pipeline.options import Compute, Lighting, Output, Source
from relight.pipeline.outputs import has_frames, is_exr
from relight.pipeline.shot import Shot
from relight.pipeline.sinks import Sinks, file_of, open_sinks
from relight.rendering import check_names, metadata_of, render_subject


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
        lights, the mask or the background determine their number. A .jpg or .hdr made of one has the
        photograph itself behind the person, unless there is another background.
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
    lighting, output, phase = Lighting.of(lighting), Output.of(output), checked_phase(phase)
    report = progress or (lambda done, total, what: None)
    lighting.check_any()
    lighting = _before_itself(Source.of(source), lighting, output)
    with Shot.open(source, lighting, compute) as shot:
        moving = _check_output(shot, output)
        numbers = shot.frames_for(output, frames)
        start = shot.start(numbers)
        shot.check_lights(start)
        shot.prepare(report)
        delivery = Delivery(shot, output.rate)
        sinks = open_sinks(
            output, moving=moving, transparent=not shot.has_background, resume=resume, phase=phase,
            delivery=delivery, groups=shot.light_groups(start),
        )  # fmt: skip
        shot.check_floor(start)
        problems = _FrameWriter(shot, output, sinks, delivery, resume).write(numbers, phase, report)
        if output.save_lights is not None:
            shot.write_lights(output.save_lights, start)
    return problems


def checked_phase(phase: Phase | str) -> Phase:
    """Return the phase of a name; raises ValueError for other names."""
    if phase not in list(Phase):
        raise ValueError(f"phase: expected one of {', '.join(Phase)}, got {phase!r}")
    return Phase(phase)


def _before_itself(source: Source, lighting: Lighting, output: Output) -> Lighting:
    """Return lighting whose background is the photograph itself if a file without alpha is made of one.

    A person who is placed elsewhere needs another background, and so does a source with alpha.
    """
    plate: Any = source.plate
    placed = {"size", "placement", "scale", "offset"} & set(source.given())
    opaque = [path for path in output.paths if path.suffix.lower() in images.OPAQUE_SUFFIXES]
    if lighting.background is not None or not opaque or placed or not isinstance(plate, str | Path):
        return lighting
    if Path(plate).suffix.lower() not in images.OPAQUE_SUFFIXES:
        return lighting
    return replace(lighting, background=plate, background_colour_space=source.colour_space)


def _check_output(shot: Shot, output: Output) -> bool:
    """Refuse what can be refused before a picture is read; return whether the output has frames."""
    shot.check_outputs(output)
    check_names(output.passes, output.paths)
    if output.rate is not None:
        movies.frame_rate(output.rate)
    return has_frames(output)


class _FrameWriter:
    """Writes the frames of a shot to its outputs."""

    def __init__(self, shot: Shot, output: Output, sinks: Sinks, delivery: Delivery, resume: bool) -> None:
        self._shot, self._output, self._sinks = shot, output, sinks
        self._delivery, self._resume = delivery, resume
        self._mattes = None if output.save_matte is None else file_of(output.save_matte)
        self._raises = not has_frames(output)  # or reports what is wrong with a frame, and goes on

    def write(self, numbers: FrameRange, phase: Phase, report: Report) -> dict[int, str]:
        """Write all frames; return {frame number: error}.

        Raises if no frame of a whole shot could be made.
        """
        made = self._check(numbers, report) if self._resume or phase is Phase.finalize else {}
        self._sinks.begin(made)
        if self._resume:
            self._warn_of_replaced(made)
        make = self._expect if phase is Phase.finalize else self._make
        problems: dict[int, str] = {}
        for done, number in enumerate(numbers, 1):
            try:
                made[number] = make(number, made.get(number) or self._content_hash(number))
            except (OSError, ValueError) as error:
                if self._raises:
                    raise
                problems[number] = str(error)
            report(done, len(numbers), "Relighting")
        if numbers and len(problems) == len(numbers) and phase is not Phase.frames:
            first = f"frame {numbers[0]}: {problems[numbers[0]]}"
            raise ValueError(f"none of {len(numbers)} frames could be made; {first}")
        if phase is not Phase.frames:
            self._sinks.finish(numbers, made, problems, report)
        return problems

    def _content_hash(self, number: int, as_read: bool = False) -> str:
        """Return a hash of all from which a frame is made. `as_read`: see `Shot.content_hash`."""
        shot = self._shot
        lighting = shot.lighting
        return content_hash(
            shot.content_hash(number, as_read), self._output.passes, lighting.floor, lighting.gloss
        )

    def _check(self, numbers: FrameRange, report: Report) -> dict[int, str]:
        """{frame number: content hash of what it is made from}."""
        made = {}
        for done, number in enumerate(numbers, 1):
            made[number] = self._content_hash(number)
            report(done, len(numbers), "Checking")
        return made

    def _warn_of_replaced(self, made: dict[int, str]) -> None:
        sinks = self._sinks.frames
        others = sum(any(s.exists(n) and not s.has(n, made[n]) for s in sinks) for n in made)
        if others:
            warnings.warn(
                f"resume: {others} of {len(made)} frames were made with other lights, sources, options, "
                "weights or by another version, and are made again",
                stacklevel=4,
            )

    def _expect(self, number: int, made: str) -> str:
        """Raise ValueError if an output lacks the frame."""
        for sink in self._sinks.frames:
            if not sink.has(number, made):
                state = "made with other lights, sources or options" if sink.exists(number) else "not there"
                raise ValueError(f"{sink.path}: the frame is {state}")
        return made

    def _make(self, number: int, made: str) -> str:
        """Write the frame to all outputs that lack it, and its matte; return what it is made from."""
        wanted = [sink for sink in self._sinks.frames if not sink.has(number, made)]
        matte = None if self._mattes is None else self._mattes.path(number)
        if matte is not None and self._resume and images.read_content_hash(matte) == made:
            matte = None
        if not wanted and matte is None:
            return made
        person = self._shot.person(number)
        made = self._content_hash(number, as_read=True)
        if wanted:
            shot, output, size = self._shot, self._output, person.size
            picture, layers = render_subject(
                person, [*shot.lights(number), *shot.background_lights(number, size)],
                background=shot.background(number, size), passes=output.passes,
                exr_type=output.exr_type.value, floor=shot.lighting.floor, gloss=shot.lighting.gloss,
            )  # fmt: skip
            metadata = {**self._delivery.metadata(number), **metadata_of(person, output.passes)}
            for sink in wanted:
                sink.write(number, picture, layers, made, metadata)
        if matte is not None:
            self._write_matte(matte, person.matte, made)
        return made

    def _write_matte(self, path: Path, matte: Any, made: str) -> None:
        """Write a matte; an .exr has pixels of the plate's shape."""
        metadata: dict[str, Any] = {HASH_ATTRIBUTE: made}
        if is_exr(path) and self._delivery.pixel_aspect != 1:
            matte = self._delivery.squeeze(matte).clip(0, 1)
            metadata["PixelAspectRatio"] = self._delivery.pixel_aspect
        images.write_mask(path, matte, metadata=metadata)
