"""`relight app`: the local web application."""

from pathlib import Path
from typing import Annotated

import typer

from relight.cli import INTERRUPTED
from relight.cli.options import console


def app(
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address without opening a browser.")
    ] = False,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of 127.0.0.1. Default: any free one.")
    ] = 0,
    root: Annotated[
        Path | None, typer.Option(help="A folder of pictures that the page lists and opens.")
    ] = None,
) -> None:
    """Relight photographs in the browser: drop one, outline the person, drag the lights, save the result.

    The page is served on this machine only. Stop the server with Ctrl C.
    """
    try:
        from relight.app.serving import serve
    except ModuleNotFoundError as error:
        from shadow.installing import install_command  # with torch, which --help does without

        raise ModuleNotFoundError(
            f"the application needs {error.name}; install it with: {install_command('app')}"
        ) from error

    def opened(address: str) -> None:
        console.print("The application listens on this machine alone. Stop it by Ctrl C.")
        typer.echo(address)
        if not no_browser:
            typer.launch(address)

    try:
        serve(root, port, opened)
    except KeyboardInterrupt as end:  # as the line says
        raise typer.Exit(INTERRUPTED) from end
