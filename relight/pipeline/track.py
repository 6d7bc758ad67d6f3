"""Follows the person who is found in a shot, and keeps where they are in each frame."""

from collections.abc import Mapping

from relight import quantities
from relight.arguments import checks_arguments
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Compute, GivenSource
from relight.pipeline.shot import Shot
from shadow.torch_settings import isolated


@isolated
@checks_arguments
def write_track(
    source: GivenSource,
    path: quantities.File,
    *,
    corrections: Mapping[int, tuple[int, int]] | None = None,
    compute: Compute | None = None,
    progress: Report | None = None,
) -> None:
    """Follow the person who is found in a shot, and write where they are in each frame.

    `Source(track=path)` takes the file: frames are then the same whoever makes them, in any order, and none
    looks for the person again.

    Parameters
    ----------
    source
        Source, or a plate: a sequence or a movie without a matte.
    path
        The file to write, .json: for each frame the circle around the person (x, y and radius in pixels) and
        the certainty that somebody is there; null where they are not.
    corrections
        {frame: (x, y)}: a point on the person in a frame, in pixels from the top left, from which on they are
        followed again.
    compute
        Compute: threads.
    progress
        Called with (frames done, number of frames, name of the step).

    Raises
    ------
    FileNotFoundError
        No such plates.
    ImportError, relight.errors.MissingNetworksError
        OpenVINO or the networks that find people are missing.
    OSError
        The file cannot be written.
    ValueError
        A still, a source with a matte, everybody (`person="all"`), or corrections of frames that are not
        there.

    Examples
    --------
    >>> relight.write_track("walk.mp4", "walk.track.json")  # doctest: +SKIP
    >>> source = relight.Source("walk.mp4", track="walk.track.json")
    """
    with Shot.open(source, compute=compute) as shot:
        for number in corrections or {}:
            if number not in shot.numbers:
                raise ValueError(f"corrections: the shot has no frame {number}")
        track = shot.frames.track(corrections)
        if track is None:
            raise ValueError(
                "source: expected a sequence or a movie whose person is found, without alpha, mask or key"
            )
        report = progress or (lambda done, total, what: None)
        track.write(path, lambda done, total: report(done, total, "Following the person"))
