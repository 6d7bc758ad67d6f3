"""`relight fetch`: bring files that are not part of the package."""

from pathlib import Path
from typing import Annotated

import typer

from relight.cli.options import console, progress_bars

fetch = typer.Typer(help="Bring networks that are not part of the package, once.", no_args_is_help=True)

MEGABYTE = 1_000_000


@fetch.callback()
def main() -> None:
    """Make `person` a command of its own."""


@fetch.command("person")
def person(
    wheel: Annotated[
        Path | None,
        typer.Option(help="Take them from this wheel of mediapipe 0.10.14 instead of downloading it."),
    ] = None,
) -> None:
    """Bring the two networks that find the person in a photograph, and keep them in your cache folder.

    They are MediaPipe's pose networks (Apache-2.0), 9.4 MB. Pip downloads the package that holds them, of 36
    MB, to a temporary folder. Nothing of it is installed.
    """
    from relight.matting import person_files

    console.print(person_files.ABOUT, soft_wrap=True)
    with progress_bars() as report:

        def told(done: int, total: int, what: str) -> None:
            report(done // MEGABYTE, total // MEGABYTE or None, f"{what}, MB")

        kept = person_files.fetch(wheel, told)
    console.print(f"{kept}", soft_wrap=True)
