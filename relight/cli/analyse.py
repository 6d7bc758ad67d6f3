"""`relight analyse`: the analysis of a still or a shot, kept to be relit later."""

from pathlib import Path
from typing import Annotated

import typer

from relight.cli.options import Frames, OptionsFile, progress_bars, report_failures, with_options
from relight.pipeline.options import Compute, Source


@with_options()
def analyse(
    source: Source,
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", help="Folder of the analysis, shot.relight, with a file for each frame."
        ),
    ],
    compute: Compute,
    frames: Frames = None,
    options_file: OptionsFile = None,
) -> None:
    """Analyse a person, and store the analysis: `relight apply shot.relight` relights it without a network.

    Existing frames that are complete and were made from the same sources and options are kept, so the same
    command continues after an interruption."""
    from relight.pipeline.early_checks import check_early

    check_early(source)
    from relight.pipeline.analyse import analyse_shot

    with progress_bars("the same command continues") as report:
        problems = analyse_shot(source, output, compute=compute, frames=frames, progress=report)
    report_failures(problems, [output])
