"""`relight view`: the page in which one holds the light.

Heavy modules are imported inside the command, so that `relight --help` answers at once.
"""

from pathlib import Path
from typing import Annotated

import typer

from relight.cli.options import (
    ColourSpace,
    Device,
    Look,
    Matte,
    RefineMatte,
    Screen,
    Who,
    console,
    parse_background,
)


def view(
    image: Annotated[str, typer.Argument(help="The photograph: PNG, JPEG, TIFF, OpenEXR...")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The page to write, .html.")],
    light: Annotated[
        list[str] | None, typer.Option(help="A light to begin with, as of `relight apply`. Repeatable.")
    ] = None,
    environment: Annotated[
        list[str] | None, typer.Option(help="Light from a latitude-longitude map, as of `relight apply`.")
    ] = None,
    lights: Annotated[Path | None, typer.Option(help="A lights file, YAML or JSON.")] = None,
    mask: Annotated[str | None, typer.Option(help="The matte, unless the photograph has alpha.")] = None,
    key: Annotated[Screen | None, typer.Option(help="Cut the person out of a screen.")] = None,
    matte: Matte = None,
    refine_matte: RefineMatte = None,
    person: Who = None,
    background: Annotated[
        str | None,
        typer.Option(help="An image, a linear colour such as 0.2/0.2/0.2, or environment."),
    ] = None,
    colour_space: ColourSpace = None,
    depth: Annotated[str | None, typer.Option(help="Use this depth, as of `relight apply`.")] = None,
    height: Annotated[
        float | None, typer.Option(help="Metres of the person that the photograph shows; 1.75 unless given.")
    ] = None,
    field_of_view: Annotated[float, typer.Option(help="Of the camera, vertical, in degrees.")] = 40.0,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    device: Device = None,
) -> None:
    """Write a page in which one holds the light: one HTML file that needs no server and no network."""
    from relight.cutting import Cutting
    from relight.viewer.writing import write_view

    given = light or environment or lights
    options = {
        "--mask": mask,
        "--key": key,
        "--matte": matte,
        "--refine-matte": refine_matte,
        "--person": person,
        "--colour-space": colour_space,
        "--depth": depth,
        "--height": height,
        "--field-of-view": None if field_of_view == 40.0 else field_of_view,
    }
    words = [text for option, value in options.items() if value is not None for text in (option, str(value))]
    with console.status("Reading") as status:
        written = write_view(
            output, image, Look(light, environment, lights).lighting() if given else None, mask=mask, key=key,
            cutting=Cutting.parse(matte, person, refine_matte), background=parse_background(background),
            colour_space=colour_space, depth=depth, height=height, field_of_view=field_of_view,
            command=("relight", "apply", image, *words), device=device, progress=status.update,
        )  # fmt: skip
    console.print(f"{written}")
    if open_:
        typer.launch(str(written))
