"""`relight track`: where the person of a shot is in each frame."""

import re
from pathlib import Path
from typing import Annotated

import typer

from relight.cli.options import print_written, progress_bars, with_options
from relight.pipeline.options import Compute, Source


@with_options()
def track(
    source: Source,
    output: Annotated[Path, typer.Option("-o", "--output", help="The file to write, .json.")],
    compute: Compute,
    correct: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X/Y@FRAME",
            help="The person is at this pixel of a frame; from there on they are followed again. Repeatable.",
        ),
    ] = None,
) -> None:
    """Follow the person who is found in a shot, and keep where they are, for `--track` of other commands.

    Without the file, each command follows them again, from the first frame on."""
    from relight.pipeline.early_checks import check_early

    check_early(source)
    from relight.pipeline.track import write_track

    corrections = dict(map(_correction, correct or ()))
    with progress_bars() as report:
        write_track(source, output, corrections=corrections, compute=compute, progress=report)
    print_written(output)


def _correction(text: str) -> tuple[int, tuple[int, int]]:
    """Parse `640/300@43` as (43, (640, 300))."""
    if not (match := re.fullmatch(r"(\d+)/(\d+)@(-?\d+)", text)):
        raise ValueError(f"--correct: expected X/Y@FRAME, such as 640/300@43, got {text!r}")
    x, y, number = map(int, match.groups())
    return number, (x, y)
