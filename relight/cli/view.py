"""`relight view`: the interactive page."""

from pathlib import Path
from typing import Annotated

import typer

from relight.cli.options import Frame, given_words, print_written, progress_bars, with_options
from relight.pipeline.options import Compute, Lighting, Source


@with_options(
    lighting=(
        "preset",
        "lights",
        "camera",
        "subject_at",
        "light",
        "environment",
        "background",
        "background_blur",
        "background_light",
        "fill",
        "fill_amount",
        "gloss",
        "amount",
        "intensity",
    )
)
def view(
    context: typer.Context,
    source: Source,
    output: Annotated[Path, typer.Option("-o", "--output", help="The page to write, .html.")],
    lighting: Lighting,
    compute: Compute,
    frame: Frame = None,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """Write an interactive page for relighting: one HTML file that needs no server and no network."""
    from relight.pipeline.early_checks import check_early
    from relight.viewer import SUFFIXES
    from shadow.files import check_writable

    check_writable(output, SUFFIXES)
    check_early(source, lighting)
    from relight.viewer.write_view import write_view

    command = ("relight", "apply", str(source.plate), *given_words(context, Source))
    with progress_bars() as report:
        written = write_view(
            output, source, lighting, frame=frame, command=command, compute=compute,
            progress=report,
        )  # fmt: skip
    print_written(written)
    if open_:
        typer.launch(str(written))
