"""Which frames of a shot are made: their numbers, from what is asked for, timecodes, sources and lights."""

import math

from relight.lights.moving import MovingLight
from relight.media.sequences import FrameRange, GivenFrames
from relight.media.timecode import TEXT as TIMECODE
from relight.media.timecode import frames_of, suits_rate
from relight.pipeline import outputs
from relight.pipeline.options import Output
from relight.pipeline.preview import EVERY
from relight.pipeline.shot import Shot


def frames_for(shot: Shot, output: Output, frames: GivenFrames | None) -> FrameRange:
    """Return the numbers of the frames to make, in order; 0 for a single file.

    Raises ValueError if neither `frames` nor source nor lights say which, or the output cannot hold them.
    """
    has_frames = outputs.has_frames(output)
    if frames is None:
        frames = _frames_of_sources(shot, output) if has_frames else _frame_of_still(shot, output)
    numbers = frame_range(shot, frames)
    if not has_frames and len(numbers) > 1:
        raise ValueError(f"{output.paths[0]}: expected {outputs.FRAME_NUMBER}, for {len(numbers)} frames")
    if not has_frames or not shot.is_preview:
        return numbers
    first = (shot.span or numbers)[0]
    kept = FrameRange(number for number in numbers if (number - first) % EVERY == 0)
    if numbers and not kept:
        raise ValueError(
            f"frames: expected some of {first}, {first + EVERY}, {first + 2 * EVERY}..., which a preview "
            f"shows, got {numbers}"
        )
    return kept


def _frames_of_sources(shot: Shot, output: Output) -> tuple[int, int]:
    """Return the first and the last frame that the sources have, or else the keyframes of the lights."""
    if shot.span is not None:
        return shot.span
    spans = [light.span for light in _moving(shot) if light.span]
    if not spans:
        raise ValueError(
            "frames: expected (first, last), as neither source nor lights say how many; "
            f"{output.paths[0]} is a movie, or has a frame number in its name"
        )
    return math.floor(min(first for first, _ in spans)), math.ceil(max(last for _, last in spans))


def _frame_of_still(shot: Shot, output: Output) -> int:
    """Return the number of a still in still light."""
    if shot.span is not None:
        raise ValueError(
            f"{output.paths[0]}: expected {outputs.FRAME_NUMBER}, as the source has frames; or choose one "
            f"frame (frames={shot.span[0]})"
        )
    if moving := _moving(shot):
        raise ValueError(
            f"lights: {moving[0].name or 'a light'} moves; choose one frame (frames=7), or write "
            f"frames: expected {outputs.FRAME_NUMBER}"
        )
    return 0


def _moving(shot: Shot) -> list[MovingLight]:
    return [light for light in shot.lights.given if isinstance(light, MovingLight)]


def frame_range(shot: Shot, frames: GivenFrames) -> FrameRange:
    """Return the numbers of frames, which a text may give as timecodes of the source.

    Raises ValueError for timecodes that the source does not have, and as `FrameRange.of` does.
    """
    if isinstance(frames, str):
        frames = TIMECODE.sub(lambda match: str(_number_at(shot, match[0])), frames)
    return FrameRange.of(frames)


def _number_at(shot: Shot, timecode: str) -> int:
    """Return the number of the frame at a timecode."""
    first, last = (shot.frames.plate_metadata(shot.numbers[n]).timecode for n in (0, -1))
    if first is None or shot.rate is None:
        raise ValueError(f"frames: expected numbers, as {shot.source.plate} states no timecode")
    start, wanted = frames_of(first, shot.rate), frames_of(timecode, shot.rate)
    number = shot.numbers[0] + (wanted or 0) - (start or 0)
    if not suits_rate(timecode, shot.rate) or number not in shot.numbers:
        raise ValueError(f"frames: expected timecodes of the source, {first} to {last}, got {timecode}")
    return number


def start(shot: Shot, numbers: FrameRange) -> int:
    """Return the first of these frames; if there are none, the first of the sources."""
    return numbers[0] if numbers else (shot.span or (0,))[0]


def shown_frame(shot: Shot, frame: object) -> int:
    """Return the frame to show: the given or the first one. Raises ValueError if it does not exist."""
    if frame is None:
        return shot.numbers[0]
    if shot.is_still:
        raise ValueError("frame: a still has none")
    if not isinstance(frame, int) or frame not in shot.numbers:
        first, last = shot.numbers[0], shot.numbers[-1]
        raise ValueError(f"frame: expected a frame of the source, {first} to {last}, got {frame}")
    return frame
