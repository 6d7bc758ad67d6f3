"""`relight olat`: one light at a time."""

from pathlib import Path
from typing import Annotated

import typer

from relight.cli.options import Frame, print_written, progress_bars, with_options
from relight.pipeline.options import Compute, Source


@with_options()
def olat(
    source: Source,
    output: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--output",
            help="An .exr with a layer for each light, or a file for each light, such as olat.%04d.exr; and "
            "a .nk that mixes them in Nuke.",
        ),
    ],
    compute: Compute,
    behind: Annotated[bool, typer.Option("--behind", help="Add 32 directions behind the person.")] = False,
    frame: Frame = None,
) -> None:
    """Write the person in one light at a time, from 64 directions, and a lights file of the directions."""
    from relight.pipeline.early_checks import check_early

    check_early(source)
    from relight.pipeline.olat import write_olat

    with progress_bars() as report:
        paths = write_olat(source, output, behind=behind, frame=frame, compute=compute, progress=report)
    for path in paths:
        print_written(path)
