"""A run over the frames of a shot: to render, analyse, export or view them are jobs, which say what differs.

The order of a run is stated here alone: first everything that can be refused is refused, then come the long
steps, then the frames one by one, then what needs all of them.
"""

from abc import ABC, abstractmethod
from contextlib import ExitStack
from typing import Generic, TypeVar

from relight.media.sequences import FrameRange, GivenFrames
from relight.pipeline.option_fields import Report
from relight.pipeline.shot import Shot

Problems = dict[int, str]  # {frame number: error} of the frames that could not be made
Result = TypeVar("Result")


class Job(ABC, Generic[Result]):
    """What is made of the frames of a shot. `run` calls its methods, once each but for `frame`.

    `step`: what progress calls a frame. `collects_errors`: whether a frame that cannot be made, because of an
    OSError or a ValueError, keeps no other from being made. `needs_a_frame`: whether the run fails where none
    could be made; `made`: the error's word for it. `opened`: what is closed when the run ends.
    """

    step: str
    collects_errors = False
    needs_a_frame = True
    made = "made"

    def __init__(self) -> None:
        self.opened = ExitStack()

    @abstractmethod
    def check(self, shot: Shot, frames: GivenFrames | None) -> FrameRange:
        """Raise for what can be refused before any work; return the numbers of the frames to make."""

    def prepare(self, shot: Shot, numbers: FrameRange, report: Report) -> None:
        """Do what comes before the first frame, once the shot's lights are known."""

    @abstractmethod
    def frame(self, shot: Shot, number: int) -> None:
        """Make a frame."""

    @abstractmethod
    def finish(self, shot: Shot, numbers: FrameRange, problems: Problems, report: Report) -> Result:
        """Do what comes after the last frame; return the result of the run."""


def run(
    job: Job[Result], shot: Shot, frames: GivenFrames | None = None, progress: Report | None = None
) -> Result:
    """Do a job on the frames of an open shot, and return its result.

    `frames`: which ones; the job says what None means. `progress` is called with (frames done, number of
    frames, name of the step). Raises what the methods of the job and `Shot.prepare` raise.
    """
    report = progress or (lambda done, total, what: None)
    numbers = job.check(shot, frames)
    shot.prepare(report)
    problems: Problems = {}
    with job.opened:
        job.prepare(shot, numbers, report)
        for done, number in enumerate(numbers, 1):
            try:
                job.frame(shot, number)
            except (OSError, ValueError) as error:
                if not job.collects_errors:
                    raise
                problems[number] = str(error)
            report(done, len(numbers), job.step)
        if job.needs_a_frame and numbers and len(problems) == len(numbers):
            first = f"frame {numbers[0]}: {problems[numbers[0]]}"
            raise ValueError(f"none of {len(numbers)} frames could be {job.made}; {first}")
        return job.finish(shot, numbers, problems, report)
