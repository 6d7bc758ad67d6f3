"""Keeps the analysis of a still or a shot: one file a frame, which is relit without a network."""

import warnings
from pathlib import Path

from relight import quantities
from relight.arguments import checks_arguments
from relight.media.content_hash import content_hash
from relight.media.sequences import FrameRange, GivenFrames
from relight.pipeline.cache import SUFFIX, check_kind, frame_file, is_cache, is_made_from
from relight.pipeline.frame_numbers import frame_range
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Compute, GivenSource, Source
from relight.pipeline.plate_metadata import VERSION, relative_path
from relight.pipeline.run import Job, Problems, run
from relight.pipeline.shot import Shot
from relight.version import __version__
from shadow.torch_settings import isolated


@isolated
@checks_arguments
def analyse_shot(
    source: GivenSource,
    output: quantities.File,
    *,
    compute: Compute | None = None,
    frames: GivenFrames | None = None,
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
    job, source = Analysing(Path(output)), Source.of(source)
    if is_cache(source.plate):
        raise ValueError(f"{source.plate}: is analysed already")
    with Shot.open(source, compute=compute) as shot:
        return run(job, shot, frames, progress)


class Analysing(Job[Problems]):
    """Writes the frames of a shot to its analysis cache, but for those that are up to date."""

    step, made, collects_errors = "Analysing", "analysed", True

    def __init__(self, folder: Path) -> None:
        super().__init__()
        if folder.suffix.lower() != SUFFIX:
            raise ValueError(f"{folder}: expected the name of a folder that ends in {SUFFIX}")
        self._folder = folder
        self._replaced = 0  # frames

    def check(self, shot: Shot, frames: GivenFrames | None) -> FrameRange:
        """Refuse frames of a still, and folders of another kind or that cannot be made."""
        if frames is not None and shot.is_still:
            raise ValueError("frames: a still has none")
        numbers = frame_range(shot, frames or (shot.numbers[0], shot.numbers[-1]))
        check_kind(self._folder, shot.is_still)
        self._folder.mkdir(parents=True, exist_ok=True)
        return numbers

    def prepare(self, shot: Shot, numbers: FrameRange, report: Report) -> None:
        """Collect what the files of all frames state."""
        precision, threads = shot.computed_in
        self._provenance: dict[str, object] = {
            "options": content_hash(shot.frames.options_hash, __version__),
            "version": __version__,
            "rate": None if shot.rate is None else str(shot.rate),
            "field_of_view": shot.frames.field_of_view,
            "pixel_aspect": shot.frames.pixel_aspect,
            "precision": precision,
            "threads": threads,
            "reference": shot.reference,
        }

    def frame(self, shot: Shot, number: int) -> None:
        """Analyse and store a frame, unless it is up to date. Raises OSError or ValueError."""
        path = frame_file(self._folder, None if shot.is_still else number)
        there = path.exists()
        if there and is_made_from(path, content_hash(shot.person_hash(number), VERSION)):
            return
        person = shot.person(number)
        files = shot.records(number)
        made = {
            "content_hash": content_hash(shot.person_hash(number, as_read=True), VERSION),
            "sources": [file._asdict() | {"path": relative_path(file.path, self._folder)} for file in files],
            "plate_metadata": shot.frames.plate_metadata(number).to_json(self._folder),
        }
        person.save(path, provenance=self._provenance | made)
        self._replaced += there

    def finish(self, shot: Shot, numbers: FrameRange, problems: Problems, report: Report) -> Problems:
        """Warn if frames were there, and were analysed again."""
        if self._replaced:
            warnings.warn(
                f"{self._folder}: {self._replaced} of {len(numbers)} frames were damaged, or made from other "
                "plates, with other options or weights or by another version, and were analysed again",
                stacklevel=4,
            )
        return problems
