"""`relight olat`: one light at a time.

Heavy modules are imported inside the command, so that `relight --help` answers at once.
"""

from pathlib import Path
from typing import Annotated

import typer

from relight.cli.options import ColourSpace, Device, Matte, RefineMatte, Who, by_kind, console, progress_bar


def olat(
    image: Annotated[str, typer.Argument(help="The photograph: PNG, JPEG, TIFF, OpenEXR...")],
    output: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--output",
            help="An .exr, of which each light is a layer, or one a light, such as olat.%04d.exr; and a .nk, "
            "if wanted, to mix them in Nuke.",
        ),
    ],
    mask: Annotated[str | None, typer.Option(help="The matte, unless the image has alpha.")] = None,
    matte: Matte = None,
    refine_matte: RefineMatte = None,
    person: Who = None,
    behind: Annotated[bool, typer.Option(help="32 directions behind the person too.")] = False,
    colour_space: ColourSpace = None,
    device: Device = None,
) -> None:
    """Write the person in IMAGE in one light at a time, from 64 directions, and a file of the directions."""
    from relight.cutting import Cutting
    from relight.olat import write_olat

    pictures, scripts = by_kind(output)
    cutting = Cutting.parse(matte, person, refine_matte)
    if len(pictures) != 1 or len(scripts) > 1:
        raise ValueError("-o: expected one .exr and at most one .nk")
    with progress_bar() as progress:
        task = progress.add_task("Lights", total=None)
        paths = write_olat(
            pictures[0], image, mask, cutting=cutting, colour_space=colour_space, behind=behind,
            device=device, script=next(iter(scripts), None),
            progress=lambda done, total: progress.update(task, completed=done, total=total),
        )  # fmt: skip
    console.print(f"{paths[0]}" if len(paths) < 4 else f"{paths[0]} ... {len(paths)} files")
