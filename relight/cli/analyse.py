"""`relight analyse`: what the networks find of a photograph or a shot, kept to be relit later.

Heavy modules are imported inside the command, so that `relight --help` answers at once.
"""

from pathlib import Path
from typing import Annotated

import typer

from relight.cli.options import (
    ColourSpace,
    Device,
    Fitting,
    Matte,
    Precision,
    RefineMatte,
    Screen,
    Threads,
    Who,
    console,
    offset_of,
    progress_bar,
    size_of,
    tell,
)


def analyse(
    source: Annotated[
        str,
        typer.Argument(help="A photograph; a sequence such as plate.%04d.exr or plate.####.exr; a movie."),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="A folder, shot.relight: a file a frame goes into it.")
    ],
    frames: Annotated[
        str | None, typer.Option(help="1-100, 1-100x2 or 1-10,20,30-40. Default: the source's.")
    ] = None,
    mask: Annotated[
        str | None, typer.Option(help="The matte, unless the source has alpha: a file, sequence or movie.")
    ] = None,
    key: Annotated[
        Screen | None,
        typer.Option(help="Cut the person out of a screen; a mask then says where there is one."),
    ] = None,
    matte: Matte = None,
    refine_matte: RefineMatte = None,
    person: Who = None,
    size: Annotated[
        str | None, typer.Option(help="The picture's, 1920x1080. Default: the photograph's.")
    ] = None,
    placement: Annotated[
        Fitting, typer.Option(help="How the photograph lies in a picture of another size.")
    ] = Fitting.fit,
    scale: Annotated[float, typer.Option(help="Of the photograph, on top of that.")] = 1.0,
    offset: Annotated[str, typer.Option(help="Of the photograph: RIGHT/UP in pixels.")] = "0/0",
    colour_space: ColourSpace = None,
    normals: Annotated[
        str | None,
        typer.Option(help="Use these camera-frame normals: an image, or a network (PIFuHD's .pt)."),
    ] = None,
    axes: Annotated[
        str, typer.Option(help="What that image's channels are measured along; OpenCV's are +x-y-z.")
    ] = "+x+y+z",
    depth: Annotated[
        str | None,
        typer.Option(help="Use this depth: an .exr (channel Z, metres), or a network (DAViD's .onnx)."),
    ] = None,
    height: Annotated[
        float | None, typer.Option(help="Metres of the person that the matte shows. Default: 1.75.")
    ] = None,
    field_of_view: Annotated[float, typer.Option(help="Of the camera, vertical, in degrees.")] = 40.0,
    steady: Annotated[
        bool, typer.Option(help="Average what is found of a moving person over frames, where it is alike.")
    ] = True,
    device: Device = None,
    precision: Precision = None,
    threads: Threads = None,
) -> None:
    """Analyse a person, and keep that: `relight video shot.relight` relights it without a network.

    Frames that are there, whole and made of just that, stay; so the same command goes on after an
    interruption."""
    from relight.analysing import analyse_shot
    from relight.cutting import Cutting
    from relight.preparation import Placement

    with progress_bar() as progress:
        task = progress.add_task("Analysing", total=None)
        try:
            problems = analyse_shot(
                source, output, frames=frames, mask=mask, key=key,
                cutting=Cutting.parse(matte, person, refine_matte),
                placement=Placement(size_of(size), placement, scale, offset_of(offset)),
                colour_space=colour_space, normals=normals, axes=axes, depth=depth, height=height,
                field_of_view=field_of_view, steady=steady, device=device,
                precision=precision, threads=threads,
                progress=lambda done, total, what: progress.update(task, completed=done, total=total),
            )  # fmt: skip
        except KeyboardInterrupt as interruption:
            console.print("interrupted; the same command goes on")
            raise typer.Exit(130) from interruption
    tell(problems, [output])
