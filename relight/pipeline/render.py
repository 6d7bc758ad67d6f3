"""Renders a shot from files to files: a still, a sequence or a movie. A still is a shot of one frame."""

from typing import get_args

from relight.arguments import checks_arguments
from relight.media.sequences import FrameRange, GivenFrames
from relight.pipeline import outputs
from relight.pipeline.delivery import Delivery
from relight.pipeline.frame_numbers import frames_for, start
from relight.pipeline.option_fields import Phase, Report
from relight.pipeline.options import (
    Compute,
    GivenLighting,
    GivenOutput,
    GivenSource,
    Output,
)
from relight.pipeline.preview import check_outputs as check_preview
from relight.pipeline.rendered_frame import render_frame
from relight.pipeline.run import Job, Problems, run
from relight.pipeline.shot import Shot
from relight.pipeline.sinks import open_sinks
from shadow.torch_settings import isolated


@isolated
@checks_arguments
def render_shot(
    source: GivenSource,
    lighting: GivenLighting,
    output: GivenOutput,
    *,
    compute: Compute | None = None,
    frames: GivenFrames | None = None,
    resume: bool = False,
    phase: Phase = "all",
    preview: bool = False,
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
        lights, the mask or the background determine their number. All but .exr show a source without alpha
        behind the person, unless there is another background, which may be "none".
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
    preview
        Whether to write an .mp4 that is made fast: half the size, every fourth frame, a rough matte where the
        person is found, each frame by itself, no sound.
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
    job = Relighting(Output.of(output), resume=resume, phase=phase)
    with Shot.open(source, lighting, compute, is_preview=preview) as shot:
        return run(job, shot, frames, progress)


class Relighting(Job[Problems]):
    """Writes the relit frames of a shot to files; a frame that exists is recognised by its hash.

    `resume`: whether to keep existing frames that were made from the same inputs. `phase`: "finalize" only
    checks that the frames exist; see `render_shot`.
    """

    step = "Relighting"

    def __init__(self, output: Output, *, resume: bool = False, phase: Phase = "all") -> None:
        super().__init__()
        if phase not in get_args(Phase):
            raise ValueError(f"phase: expected one of {', '.join(get_args(Phase))}, got {phase!r}")
        self._output, self._resume, self._phase = output, resume, phase
        self.needs_a_frame = phase != "frames"
        self._hashes: dict[int, str] = {}  # {frame number: content hash of what it is made from}

    def check(self, shot: Shot, frames: GivenFrames | None) -> FrameRange:
        """Refuse outputs, frames, lights and backgrounds that do not go together."""
        output = self._output
        shot.lighting.check_any()
        if output.report is not None and self._phase == "frames":
            raise ValueError("report: is of all frames; give it to the last phase (phase=finalize)")
        if shot.is_preview:
            check_preview(output.paths)
        shot.check_outputs(output)
        self.collects_errors = outputs.has_frames(output)
        numbers = frames_for(shot, output, frames)
        self._display = outputs.check_display(output, moving=self.collects_errors)
        self._start = start(shot, numbers)
        shot.backgrounds.check_plate()
        outputs.check_form(output, shot.picture_size, shot.frames.plates)
        self._keeps_plate = outputs.shows_backgrounds(output) and shot.backgrounds.keeps_plate
        self._made_with = output.passes, self._keeps_plate  # beside what the shot reads
        outputs.check_alpha(output, transparent=not (shot.lighting.has_background or self._keeps_plate))
        shot.check_lights(self._start)
        return numbers

    def prepare(self, shot: Shot, numbers: FrameRange, report: Report) -> None:
        """Open the outputs, and find out which frames exist already."""
        groups = shot.lights.groups(self._start)
        self._delivery = Delivery(shot, self._output.rate, outputs.form_of(self._output))
        self._sinks = open_sinks(
            self._output, self._display, moving=self.collects_errors, resume=self._resume, phase=self._phase,
            delivery=self._delivery, groups=groups,
        )  # fmt: skip
        shot.check_floor(self._start)
        if self._resume or self._phase == "finalize":
            for done, number in enumerate(numbers, 1):
                self._hashes[number] = shot.content_hash(number, *self._made_with)
                report(done, len(numbers), "Checking")
        self._sinks.begin(self._hashes)

    def frame(self, shot: Shot, number: int) -> None:
        """Write the frame, and what is written of its person, where it is lacking.

        Raises OSError or ValueError.
        """
        sinks, made = self._sinks, self._hashes.get(number) or shot.content_hash(number, *self._made_with)
        lacking = [sink for sink in sinks.frames if not sink.has(number, made)]
        if lacking and self._phase == "finalize":
            state = "made with other lights, sources or options" if lacking[0].exists(number) else "not there"
            raise ValueError(f"{lacking[0].path}: the frame is {state}")
        if lacking or not all(sink.has(number, made) for sink in sinks.of_persons):
            person = shot.found_person(number)
            made = shot.content_hash(number, *self._made_with, as_read=True)
            if lacking:
                frame = render_frame(shot, number, person.subject, self._output, self._keeps_plate)
                metadata = {**self._delivery.metadata(number), **frame.rendering.metadata}
                for sink in lacking:
                    sink.write(number, frame, made, metadata)
            for each in sinks.of_persons:
                if not each.has(number, made):
                    each.write(number, person, made)
        self._hashes[number] = made

    def finish(self, shot: Shot, numbers: FrameRange, problems: Problems, report: Report) -> Problems:
        """Write movies and scripts, which need all frames, the lights file and the plot."""
        output, is_last = self._output, self._phase != "frames"
        if is_last:
            self._sinks.assemble(numbers, self._hashes, problems, report)
        if output.save_lights is not None:
            shot.write_lights(output.save_lights, self._start)
        if output.plot is not None and is_last:
            shot.write_plot(output.plot, self._start)
        return problems
