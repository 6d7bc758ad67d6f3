"""`relight app`: the local web application."""

import io
from pathlib import Path
from typing import Annotated

import typer

from relight.cli import INTERRUPTED
from relight.cli.options import console

OPEN = (
    "Whoever is in the same network and has the address, whose last part is secret, can open the "
    "application, see and add photographs, and read the folder of --root. The connection is not "
    "encrypted: use it in a network that you trust."
)


def _code(address: str) -> str:
    """Return a QR code of an address for the terminal; a hint where the library for it is missing."""
    try:
        import segno
    except ModuleNotFoundError:
        from shadow.installing import install_command

        return f"A QR code for phones needs segno; install it with: {install_command('qr')}"
    text = io.StringIO()
    segno.make(address, micro=False).terminal(text, compact=True, border=2)
    return text.getvalue()


def app(
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address without opening a browser.")
    ] = False,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of that address. Default: any free one.")
    ] = 0,
    host: Annotated[
        str,
        typer.Option(
            help="Address to listen on. 0.0.0.0 lets phones in the same network in, without encryption. "
            "Default: 127.0.0.1, this machine alone."
        ),
    ] = "127.0.0.1",
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before others are let in.")] = False,
    root: Annotated[
        Path | None, typer.Option(help="A folder of pictures that the page lists and opens.")
    ] = None,
) -> None:
    """Relight photographs in the browser: drop one, outline the person, drag the lights, save the result.

    The page is served on this machine only, unless --host says otherwise. Stop the server with Ctrl C.
    """
    try:
        from relight.app.serving import address_of, is_private, serve
    except ModuleNotFoundError as error:
        from shadow.installing import install_command  # with torch, which --help does without

        raise ModuleNotFoundError(
            f"the application needs {error.name}; install it with: {install_command('app')}"
        ) from error

    private = is_private(address_of(host))
    if not private:
        console.print(OPEN)
        if not yes:
            typer.confirm("Let them in?", abort=True, err=True)

    def opened(address: str) -> None:
        console.print(
            "The application listens on this machine alone. Stop it by Ctrl C."
            if private
            else "The application listens in this machine's network. Stop it by Ctrl C."
        )
        typer.echo(address)
        if not private:
            console.print(_code(address), highlight=False)
        if not no_browser:
            typer.launch(address)

    try:
        serve(root, port, opened, host)
    except KeyboardInterrupt as end:  # as the line says
        raise typer.Exit(INTERRUPTED) from end
