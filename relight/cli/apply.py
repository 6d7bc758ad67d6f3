"""`relight apply`, also called `relight video`: stills, sequences, movies and analysis caches relit."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from relight.cli.options import (
    Frames,
    OptionsFile,
    console,
    print_written,
    progress_bars,
    report_failures,
    with_options,
)
from relight.pipeline.option_fields import Phase
from relight.pipeline.options import Compute, Lighting, Output, Source

if TYPE_CHECKING:
    from relight.pipeline.many import OneOfMany


@with_options()
def apply(
    source: Source,
    output: Output,
    lighting: Lighting,
    compute: Compute,
    more: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="SOURCE",
            help="Further pictures, or folders of pictures; then -o out/{name}.png, or a folder.",
        ),
    ] = None,
    frames: Frames = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Keep existing frames that were made from the same lights, sources and options.",
        ),
    ] = False,
    phase: Annotated[
        Phase,
        typer.Option(
            metavar="<part>",
            help="frames: write the frames of a chunk, but no movie and no .nk; finalize: write these from "
            "the frames of all chunks.",
        ),
    ] = "all",
    preview: Annotated[
        bool,
        typer.Option(
            "--preview",
            help="An .mp4 in about a tenth of the time: half the size, every fourth frame, a rough matte.",
        ),
    ] = False,
    dask: Annotated[
        str | None,
        typer.Option(help="Render on a Dask cluster: the address of its scheduler, tcp://farm:8786."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Render with this many processes on this machine.")
    ] = None,
    options_file: OptionsFile = None,
) -> None:
    """Relight the person in SOURCE: a still, a sequence, a movie or an analysis cache."""
    from relight.pipeline.early_checks import check_early
    from relight.pipeline.many import make_folders, many

    distributed = dask is not None or workers is not None
    listed = many(source, more or (), output)
    if listed:
        if phase != "all" or distributed:
            raise ValueError("SOURCE: expected one, as --phase, --dask and --workers are given")
        make_folders(listed)
        check_early(None, lighting, listed[0].output)
    else:
        check_early(source, lighting, output)
    from relight.pipeline.render import render_shot

    if phase != "all" and distributed:
        raise ValueError("--phase: expected no --dask and no --workers, which make all frames")
    if preview and (phase != "all" or distributed):
        raise ValueError("--preview: expected no --phase, --dask and --workers: it is made in one run")
    render: Callable[..., dict[int, str]] = partial(render_shot, phase=phase, preview=preview)
    if distributed:
        from relight.distributed.dask_cluster import render_distributed

        render = partial(render_distributed, scheduler=dask, workers=workers)
    if listed:
        _apply_to_many(listed, render, lighting=lighting, compute=compute, frames=frames, resume=resume)
        return
    with progress_bars("the same command with --resume continues") as report:
        problems = render(
            source, lighting, output, compute=compute, frames=frames, resume=resume, progress=report
        )
    further = [path for path in (output.save_matte, output.report, output.plot) if path is not None]
    report_failures(problems, [*output.paths, *further])


def _apply_to_many(
    listed: "list[OneOfMany]", render: Callable[..., dict[int, str]], **options: object
) -> None:
    """Relight pictures one by one, and print what was written and what failed; exit code 1 if any did."""
    from relight.pipeline.many import render_many

    with progress_bars("the same command with --resume continues") as report:
        problems = render_many(listed, render, report, **options)
    for source, output in listed:
        if str(source.plate) not in problems:
            for path in output.paths:
                print_written(path)
    made = len(listed) - len(problems)
    console.print(f"{made} of {len(listed)} pictures made" + ("; not made:" if problems else ""))
    for picture, problem in problems.items():
        line = problem if problem.startswith(picture) else f"{picture}: {problem}"
        console.print(line, soft_wrap=True)
    if problems:
        raise typer.Exit(1)
