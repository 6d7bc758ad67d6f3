"""Renders a shot from files to files: a still, a sequence or a movie. A still is a shot of one frame."""

from typing import Any, get_args

from relight.media.sequences import FrameRange
from relight.pipeline import outputs
from relight.pipeline.delivery import Delivery
from relight.pipeline.frame_loop import check_any_made, each_frame
from relight.pipeline.frame_writer import FrameWriter
from relight.pipeline.option_fields import Phase, Report
from relight.pipeline.options import Compute, Lighting, Output, Source
from relight.pipeline.shot import Shot
from relight.pipeline.sinks import open_sinks
from shadow.torch_settings import isolated


@isolated
def render_shot(
    source: Source | Any,
    lighting: Lighting | Any,
    output: Output | Any,
    *,
    compute: Compute | None = None,
    frames: tuple[int, int] | str | FrameRange | None = None,
    resume: bool = False,
    phase: Phase = "all",
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
    source, output = Source.of(source), Output.of(output)
    if phase not in get_args(Phase):
        raise ValueError(f"phase: expected one of {', '.join(get_args(Phase))}, got {phase!r}")
    lighting = Lighting.of(lighting)
    lighting.check_any()
    with Shot.open(source, lighting, compute) as shot:
        return render_frames(shot, output, frames, resume=resume, phase=phase, progress=progress)


def render_frames(
    shot: Shot,
    output: Output,
    frames: tuple[int, int] | str | FrameRange | None = None,
    *,
    resume: bool = False,
    phase: Phase = "all",
    progress: Report | None = None,
) -> dict[int, str]:
    """Relight the frames of an open shot; `render_shot` describes arguments, result and errors."""
    report = progress or (lambda done, total, what: None)
    shot.check_outputs(output)
    moving, numbers = outputs.has_frames(output), shot.frames_for(output, frames)
    display = outputs.check_display(output, moving=moving)
    start = shot.start(numbers)
    shot.check_lights(start)
    shot.check_background()
    keeps_plate = outputs.shows_backgrounds(output) and shot.keeps_plate
    outputs.check_alpha(output, transparent=not (shot.has_background or keeps_plate))
    shot.prepare(report)
    delivery = Delivery(shot, output.rate, keeps_plate)
    sinks = open_sinks(
        output, display, moving=moving, resume=resume, phase=phase, delivery=delivery,
        groups=shot.light_groups(start),
    )  # fmt: skip
    shot.check_floor(start)
    writer = FrameWriter(shot, output, sinks, delivery, phase, resume)
    writer.begin(numbers, report)
    problems = each_frame(numbers, writer.write, report, "Relighting", raises=not moving)
    if phase != "frames":
        check_any_made(numbers, problems)
        sinks.finish(numbers, writer.hashes, problems, report)
    if output.save_lights is not None:
        shot.write_lights(output.save_lights, start)
    return problems
