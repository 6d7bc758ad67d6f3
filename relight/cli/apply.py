"""`relight apply`: a still.

Heavy modules are imported inside the command, so that `relight --help` answers at once.
"""

from pathlib import Path
from typing import Annotated

import typer

from relight.cli.options import Look, console, with_options


@with_options(Look)
def apply(
    image: Annotated[str, typer.Argument(help="The photograph: PNG, JPEG, TIFF, OpenEXR...")],
    output: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--output",
            help="File to write; .exr keeps each light as a layer, .nk rebuilds the mix in Nuke. Repeatable.",
        ),
    ],
    look: Look,
) -> None:
    """Relight the person in IMAGE and write the picture."""
    from relight.stills import render_still

    with console.status("Reading") as status:
        written = render_still(image, look.lighting(), output, **look.settings(), progress=status.update)
    for path in written:
        console.print(f"{path}")
