"""`relight export`: the person as a mesh for other 3D programs, or as a Nuke script."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from relight.cli.options import Frames, print_written, progress_bars, with_options
from relight.pipeline.options import Compute, Lighting, Source


@with_options(
    lighting=(
        "preset",
        "light",
        "environment",
        "lights",
        "camera",
        "subject_at",
        "allow_external",
        "gloss",
        "amount",
        "intensity",
    )
)
def export(
    source: Source,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="File to write: .glb, .usda, .usdc, .usdz or .nk.")
    ],
    lighting: Lighting,
    compute: Compute,
    frames: Frames = None,
    triangles: Annotated[int, typer.Option(help="Largest number of triangles, at least 1000.")] = 120_000,
    texture: Annotated[
        Literal["albedo", "photograph"],
        typer.Option(help="albedo: a matte surface for new light; photograph: an unlit surface."),
    ] = "albedo",
) -> None:
    """Write the person for other programs: a textured mesh with camera and lights, or a Nuke script."""
    from relight.pipeline.early_checks import check_early

    check_early(source, lighting)
    from relight.pipeline.export import export_person

    with progress_bars() as report:
        written = export_person(
            output, source, lighting, frames=frames, triangles=triangles, texture=texture,
            compute=compute, progress=report,
        )  # fmt: skip
    print_written(written)
