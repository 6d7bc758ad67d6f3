"""What all machines that share a shot take alike: the camera, the person who is followed, the reference."""

import warnings
from dataclasses import replace
from pathlib import Path

from relight.errors import MissingNetworksError
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Source
from relight.pipeline.shot import Shot

FOLLOWING = "Following the person"


def shared_source(shot: Shot, track: Path, report: Report | None = None, *, keep: bool = False) -> Source:
    """Return the source of a shot with all that each machine would otherwise find out by itself.

    Where the person is found, they are followed through the shot now, half a second a frame, and the file
    `track` says where they are. `keep`: whether a file that is there already is taken. Without the networks
    that find people a warning says that each machine looks by itself.
    """
    source = shot.stated_source
    if shot.is_analysed:
        return source
    if source.track is None:
        try:
            followed = shot.frames.track()
        except (ImportError, MissingNetworksError) as error:
            warnings.warn(f"{error}. Each machine follows the person by itself.", stacklevel=3)
            return source
        if followed is not None:
            if not (keep and track.is_file()):
                followed.write(
                    track, lambda done, total: None if report is None else report(done, total, FOLLOWING)
                )
            source = replace(source, track=track)
    return replace(source, reference=shot.likely_reference)
