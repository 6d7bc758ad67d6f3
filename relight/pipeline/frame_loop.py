"""The loop over a shot's frames: a frame that cannot be made does not keep the others from being made."""

from collections.abc import Callable

from relight.media.sequences import FrameRange
from relight.pipeline.option_fields import Report


def each_frame(
    numbers: FrameRange, make: Callable[[int], object], report: Report, step: str, raises: bool = False
) -> dict[int, str]:
    """Make frames one by one; return {frame number: error} of those that could not be made.

    OSError and ValueError are collected, or raised if `raises`. `step` is the name that is reported.
    """
    problems: dict[int, str] = {}
    for done, number in enumerate(numbers, 1):
        try:
            make(number)
        except (OSError, ValueError) as error:
            if raises:
                raise
            problems[number] = str(error)
        report(done, len(numbers), step)
    return problems


def check_any_made(numbers: FrameRange, problems: dict[int, str], verb: str = "made") -> None:
    """Raise ValueError if there are frames, and none of them could be made."""
    if numbers and len(problems) == len(numbers):
        first = f"frame {numbers[0]}: {problems[numbers[0]]}"
        raise ValueError(f"none of {len(numbers)} frames could be {verb}; {first}")
