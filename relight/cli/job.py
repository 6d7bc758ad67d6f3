"""`relight job`: a shot as a job for a farm.

Heavy modules are imported inside the command, so that `relight --help` answers at once.
"""

from pathlib import Path
from typing import Annotated, Any

import typer

from relight.cli.options import Look, Precision, Threads, console, with_options

OWN = ("source", "output", "frames", "chunk_size", "analysis", "precision", "threads")
LIGHTS = ("light", "environment", "lights", "save_lights")


@with_options(Look)
def job(
    context: typer.Context,
    source: Annotated[
        str,
        typer.Argument(help="A photograph, a sequence, a movie, or what `relight analyse` kept of one."),
    ],
    output: Annotated[
        list[Path],
        typer.Option("-o", "--output", help="As of `relight video`; and the job, a .json or .yaml."),
    ],
    look: Look,
    frames: Annotated[
        str | None, typer.Option(help="1-100, 1-100x2 or 1-10,20,30-40. Default: the source's.")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Frames a second. Default: the source's, or 24.")] = None,
    steady: Annotated[
        bool, typer.Option(help="Average what is found of a moving person over frames, where it is alike.")
    ] = True,
    white: Annotated[
        float, typer.Option(min=1, help="Light that shows as white in all frames; what is below rolls off.")
    ] = 4.0,
    chunk_size: Annotated[int, typer.Option(min=1, help="Frames of a task.")] = 10,
    analysis: Annotated[
        Path | None, typer.Option(help="Where the analysis is kept. Default: beside the job, plate.relight.")
    ] = None,
    precision: Precision = None,
    threads: Threads = None,
) -> None:
    """Write what `relight video` would do as a job for a farm, in Open Job Description."""
    from relight.farm import SUFFIXES, write_job

    jobs = [path for path in output if path.suffix.lower() in SUFFIXES]
    if len(jobs) != 1:
        raise ValueError(f"output: expected one job, {', '.join(SUFFIXES)}, got {len(jobs)}")
    look.settings()  # says what is wrong with the texts
    given = {name: value for name, value in context.params.items() if _given(context, name)}
    lights: Any = look.lights if {*LIGHTS} & {*given} == {"lights"} else look.lighting()
    write_job(
        jobs[0], source, lights, [path for path in output if path not in jobs], frames=frames,
        analysis=analysis, save_lights=look.save_lights, chunk=chunk_size, precision=precision,
        threads=threads,
        options={name: value for name, value in given.items() if name not in (*OWN, *LIGHTS)},
    )  # fmt: skip
    console.print(f"{jobs[0]}")


def _given(context: typer.Context, name: str) -> bool:
    """Whether an option stands on the command line."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"
