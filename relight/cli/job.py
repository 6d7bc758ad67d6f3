"""`relight job`: a shot as a job for a farm."""

from pathlib import Path
from typing import Annotated

import typer

from relight.cli.options import Frames, print_written, with_options
from relight.pipeline.options import Compute, Lighting, Output, Source


@with_options()
def job(
    source: Source,
    output: Output,
    lighting: Lighting,
    compute: Compute,
    frames: Frames = None,
    chunk_size: Annotated[int, typer.Option(min=1, help="Number of frames in a task.")] = 10,
    analysis: Annotated[
        Path | None, typer.Option(help="Folder of the analysis. Default: beside the job, plate.relight.")
    ] = None,
) -> None:
    """Write what `relight apply` would do as a job for a farm, in Open Job Description.

    One of the outputs is the job, a .json or .yaml file."""
    from relight.pipeline.early_checks import check_early

    check_early(source, lighting)
    from dataclasses import replace

    from relight.distributed.openjd import SUFFIXES, write_job

    jobs = [path for path in output.paths if path.suffix.lower() in SUFFIXES]
    if len(jobs) != 1:
        raise ValueError(f"output: expected one job, {', '.join(SUFFIXES)}, got {len(jobs)}")
    paths = tuple(path for path in output.paths if path not in jobs)
    write_job(
        jobs[0], source, lighting, replace(output, paths=paths), frames=frames, analysis=analysis,
        chunk=chunk_size, compute=compute,
    )  # fmt: skip
    print_written(jobs[0])
