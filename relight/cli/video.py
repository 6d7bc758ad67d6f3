"""`relight video`: a sequence or a movie.

Heavy modules are imported inside the command, so that `relight --help` answers at once.
"""

from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from relight.cli.options import Look, Precision, Threads, console, progress_bar, with_options


class Part(StrEnum):
    all = "all"
    frames = "frames"
    end = "end"


@with_options(Look)
def video(
    source: Annotated[
        str,
        typer.Argument(
            help="A photograph; a sequence such as plate.%04d.exr or plate.####.exr; a movie; or what "
            "`relight analyse` kept of one, shot.relight."
        ),
    ],
    output: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--output",
            help="A sequence such as relit.%04d.exr (.exr keeps each light as a layer); a movie, .mp4 "
            "or .mov; a .nk, to mix the .exr in Nuke. Repeatable.",
        ),
    ],
    look: Look,
    frames: Annotated[
        str | None,
        typer.Option(
            help="1-100, 1-100x2 or 1-10,20,30-40. Default: the source's, or from first to last keyframe of "
            "the lights."
        ),
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Frames a second. Default: the source's, or 24.")] = None,
    steady: Annotated[
        bool, typer.Option(help="Average what is found of a moving person over frames, where it is alike.")
    ] = True,
    white: Annotated[
        float, typer.Option(min=1, help="Light that shows as white in all frames; what is below rolls off.")
    ] = 4.0,
    precision: Precision = None,
    threads: Threads = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Keep the frames that are there and were made with the same lights, plates and options.",
        ),
    ] = False,
    part: Annotated[
        Part,
        typer.Option(
            help="frames: of a chunk of a shot, no movie and no .nk; end: these, of all its frames."
        ),
    ] = Part.all,
    dask: Annotated[
        str | None, typer.Option(help="Have a Dask cluster make the frames: the scheduler, tcp://farm:8786.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Have so many processes on this machine make the frames.")
    ] = None,
) -> None:
    """Relight a person frame by frame: lights that move (orbit=200, or a lights file), a person that does."""
    from relight.cluster import render_distributed
    from relight.video import render_video

    if part != Part.all and (dask or workers):
        raise ValueError("--part: expected no --dask and no --workers, which make all frames")
    render = partial(render_distributed, scheduler=dask, workers=workers) if dask or workers else render_video
    settings: dict[str, Any] = {"precision": precision} | ({} if threads is None else {"threads": threads})
    settings |= {} if dask or workers else {"part": part.value}
    with progress_bar() as progress:
        tasks: dict = {}

        def report(done: int, total: int, what: str) -> None:
            if what not in tasks:
                tasks[what] = progress.add_task(what, total=total)
            progress.update(tasks[what], completed=done)

        try:
            problems = render(
                source, look.lighting(), output, **look.settings(), **settings, frames=frames, steady=steady,
                rate=rate, white=white, resume=resume, progress=report,
            )  # fmt: skip
        except KeyboardInterrupt as interruption:
            console.print("interrupted; the same command with --resume goes on")
            raise typer.Exit(130) from interruption
    for number, problem in problems.items():
        console.print(f"frame {number}: {problem}")
    for path in output:
        console.print(f"{path}")
    if problems:
        raise typer.Exit(1)
