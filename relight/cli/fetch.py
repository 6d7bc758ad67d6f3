"""`relight fetch`: bring files that are not part of the package."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from relight.cli.help import PlainCommand, PlainGroup
from relight.cli.options import console, progress_bars

fetch = typer.Typer(
    cls=PlainGroup,
    name="fetch",
    help="Bring networks that are not part of the package, once.",
    no_args_is_help=True,
)

MEGABYTE = 1_000_000


@fetch.command("person", cls=PlainCommand)
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
    from relight.matting.people import files as person_files

    console.print(person_files.ABOUT, soft_wrap=True)
    with _megabytes() as told:
        kept = person_files.fetch(wheel, told)
    console.print(f"{kept}", soft_wrap=True)


@fetch.command("silhouette", cls=PlainCommand)
def silhouette(
    package: Annotated[
        Path | None,
        typer.Option(
            "--from", help="Take it from this imgly-background-removal-data-1.4.5.tgz instead of downloading."
        ),
    ] = None,
) -> None:
    """Bring the network that cuts the person out, with their hair, hands and what they hold.

    It is IS-Net (Qin et al., 2022), 88 MB, in pieces out of a package for npm. Npm downloads the package, of
    136 MB, to a temporary folder; without npm the pieces come over HTTPS. Nothing of it is installed. Whether
    its weights may be used commercially is not settled: see docs/compositing.md, and decide.
    """
    from relight.matting import silhouette_files

    console.print(f"{silhouette_files.ABOUT}: {silhouette_files.LICENCE}", soft_wrap=True)
    with _megabytes() as told:
        kept = silhouette_files.fetch(package, told)
    console.print(f"{kept}", soft_wrap=True)


@contextmanager
def _megabytes() -> Iterator[Callable[[int, int, str], None]]:
    """Show the progress of a download, told in bytes."""
    with progress_bars() as report:
        yield lambda done, total, what: report(done // MEGABYTE, total // MEGABYTE or None, f"{what}, MB")
