"""Keeps the analysis of a still or a shot: one file a frame, which is relit without a network."""

from pathlib import Path
from typing import Any

from relight.media.sequences import FrameRange
from relight.pipeline.cache import SUFFIX, check_kind, is_cache
from relight.pipeline.cache_writer import CacheWriter
from relight.pipeline.frame_loop import check_any_made, each_frame
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Compute, Source
from relight.pipeline.shot import Shot


def analyse_shot(
    source: Source | Any,
    output: str | Path,
    *,
    compute: Compute | None = None,
    frames: tuple[int, int] | str | FrameRange | None = None,
    progress: Report | None = None,
) -> dict[int, str]:
    """Analyse the person of a still, or of each frame of a shot, and store the analysis in a folder.

    `render_shot` takes the folder as its source, and relights it without a network as often as the lights
    change. Existing frames that are complete and were made from the same sources, options and weights are
    kept. So an interrupted run continues where it stopped, and several machines can analyse ranges of a shot
    into one folder. Each machine also analyses the neighbouring frames that the temporal filter needs.

    Parameters
    ----------
    source
        Source, or a plate; its size has to be in pixels.
    output
        A folder such as `shot.relight`, which is created. `000101.safetensors` is frame 101,
        `still.safetensors` a still. `relight.analysis.storage` describes the files.
    compute
        Compute: device, precision and threads.
    frames
        Frames of a shot, see `relight.render_shot`; all by default.
    progress
        Called with (frames done, number of frames, name of the step) after every frame.

    Returns
    -------
    dict[int, str]
        {frame number: error} of the frames that could not be analysed. All others exist.

    Raises
    ------
    FileNotFoundError
        No such file or frames.
    OSError
        The folder cannot be created or written.
    TypeError, ValueError
        Bad arguments, or no frame could be analysed.

    Examples
    --------
    >>> relight.analyse_shot("examples/person.png", "person.relight")
    {}
    """
    folder = Path(output)
    if folder.suffix.lower() != SUFFIX:
        raise ValueError(f"{folder}: expected the name of a folder that ends in {SUFFIX}")
    source = Source.of(source)
    if is_cache(source.plate):
        raise ValueError(f"{source.plate}: is analysed already")
    with Shot.open(source, compute=compute) as shot:
        return store_frames(shot, folder, frames, progress)


def store_frames(
    shot: Shot,
    folder: Path,
    frames: tuple[int, int] | str | FrameRange | None = None,
    progress: Report | None = None,
) -> dict[int, str]:
    """Analyse and store the frames of an open shot; `analyse_shot` describes arguments, result and errors."""
    report = progress or (lambda done, total, what: None)
    if frames is not None and shot.is_still:
        raise ValueError("frames: a still has none")
    numbers = FrameRange.of(frames or (shot.numbers[0], shot.numbers[-1]))
    check_kind(folder, shot.is_still)
    folder.mkdir(parents=True, exist_ok=True)
    shot.prepare(report)
    writer = CacheWriter(shot, folder)
    problems = each_frame(numbers, writer.write, report, "Analysing")
    check_any_made(numbers, problems, "analysed")
    writer.warn_of_replaced(len(numbers))
    return problems
