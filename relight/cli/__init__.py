"""The command line. Each command reads its files, calls one public function, and writes what it returns.

Heavy modules are imported inside the commands, so that `relight --help` answers at once.
"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from typer.core import TyperGroup

from relight.cli import training


class _OneLineErrors(TyperGroup):
    """Bad input is one line and exit code 2; anything else is a bug and keeps its trace."""

    def invoke(self, ctx):
        try:
            return super().invoke(ctx)
        except (ImportError, OSError, TypeError, ValueError) as error:
            typer.echo(f"relight: {error}", err=True)
            raise typer.Exit(2) from error


app = typer.Typer(cls=_OneLineErrors, no_args_is_help=True, pretty_exceptions_enable=False)
console = Console(stderr=True)
ENVIRONMENT = "environment"  # as a background


@app.callback()
def main():
    """Relight a photographed person, light by light, in scene-linear colour."""


class Placement(StrEnum):
    fit = "fit"
    fill = "fill"
    centre = "centre"


class Screen(StrEnum):
    green = "green"
    blue = "blue"


LightOption = Annotated[
    list[str] | None,
    typer.Option(
        help="A light, as key:azimuth=-40,elevation=30,intensity=2,colour=1/0.9/0.8; also "
        "direction=x/y/z, exposure (stops), temperature (kelvin), locus (planckian, daylight), angle "
        "(degrees, soft). Repeatable."
    ),
]
EnvironmentOption = Annotated[
    list[str] | None,
    typer.Option(
        help="Light from a latitude-longitude map, as studio.exr,rotation=90,intensity=2; its centre is "
        "at the camera. Repeatable."
    ),
]
LightsOption = Annotated[Path | None, typer.Option(help="A lights file, YAML or JSON.")]
KeyOption = Annotated[
    Screen | None,
    typer.Option(help="Cut the person out of a screen; a mask then says where there is one."),
]
ColourSpaceOption = Annotated[
    str | None,
    typer.Option(help="The photograph's, if its file does not say: sRGB, lin_rec709, ACEScg, Rec.2020..."),
]
LayersOption = Annotated[
    str | None,
    typer.Option(help="More layers of the .exr: any of albedo,N,visibility,shading."),
]
ViewOption = Annotated[
    str | None,
    typer.Option(
        help="View transform of what is for display, e.g. aces, from OpenColorIO's built-in configuration "
        "or $OCIO. Without one that is sRGB, with highlights rolled off."
    ),
]
ExposureOption = Annotated[float, typer.Option(help="Of what is for display, in stops.")]


@app.command()
def apply(
    image: Annotated[Path, typer.Argument(help="The photograph: PNG, JPEG, TIFF, OpenEXR...")],
    output: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--output",
            help="File to write; .exr keeps each light as a layer, .nk rebuilds the mix in Nuke. Repeatable.",
        ),
    ],
    light: LightOption = None,
    environment: EnvironmentOption = None,
    lights: LightsOption = None,
    save_lights: Annotated[
        Path | None, typer.Option(help="Write all these lights to a lights file, for next time.")
    ] = None,
    mask: Annotated[Path | None, typer.Option(help="The matte, unless the image has alpha.")] = None,
    key: KeyOption = None,
    background: Annotated[
        str | None,
        typer.Option(
            help="An image of any size, a linear colour such as 0.2/0.2/0.2, or environment: what a camera "
            "sees of it."
        ),
    ] = None,
    field_of_view: Annotated[
        float, typer.Option(help="Of that camera, vertical, in degrees.", show_default=True)
    ] = 40.0,
    size: Annotated[
        str | None,
        typer.Option(
            help="The picture's, as 1920x1080, or background for its own. Default: the photograph's."
        ),
    ] = None,
    placement: Annotated[
        Placement, typer.Option(help="How the photograph lies in a picture of another size.")
    ] = Placement.fit,
    scale: Annotated[float, typer.Option(help="Of the photograph, on top of that.")] = 1.0,
    offset: Annotated[str, typer.Option(help="Of the photograph: RIGHT/UP in pixels.")] = "0/0",
    colour_space: ColourSpaceOption = None,
    layers: LayersOption = None,
    view: ViewOption = None,
    exposure: ExposureOption = 0.0,
    save_matte: Annotated[
        Path | None, typer.Option(help="Write the matte alone, grey: PNG, TIFF or OpenEXR.")
    ] = None,
    normals: Annotated[
        Path | None,
        typer.Option(help="Use these camera-frame normals: an image, or a network (PIFuHD's .pt)."),
    ] = None,
    axes: Annotated[
        str, typer.Option(help="What that image's channels are measured along; OpenCV's are +x-y-z.")
    ] = "+x+y+z",
):
    """Relight the person in IMAGE and write the picture."""
    from relight.lights.files import write_lights
    from relight.media import images, nuke
    from relight.media.colour import find_view
    from relight.rendering import render

    lighting = _lighting(lights, light, environment)
    pictures, scripts = _by_kind(output)
    if scripts and not any(path.suffix.lower() == ".exr" for path in pictures):
        raise ValueError(f"{scripts[0]}: a Nuke script needs an .exr to read; add one with -o")
    for path in [*pictures, save_matte] if save_matte else pictures:
        images.check_writable(path)
    if view is not None:
        find_view(view)  # before the work, not after it
    if save_lights is not None:
        write_lights(save_lights, lighting)
    plate = images.read(image, colour_space=colour_space)
    matte = None if mask is None else images.read_mask(mask)
    if key is not None:
        from relight.keying import key as cut_out

        plate, matte = cut_out(plate, key, mask=matte), None
    backdrop = None if background in (None, ENVIRONMENT) else _background(background)
    if isinstance(backdrop, str):
        backdrop = images.read(backdrop)
    plate, matte = _placed(plate, matte, size, backdrop, mode=placement, scale=scale, offset=offset)
    if background == ENVIRONMENT:
        backdrop = _seen(lighting, plate.shape[:2], field_of_view)
    surface = None if normals is None else _normals(normals, axes)
    with console.status("Relighting"):
        picture, stack = render(
            plate, lighting, background=backdrop, mask=matte, normals=surface, passes=_words(layers)
        )  # fmt: skip
    for path in pictures:
        with console.status(f"Writing {path}"):
            groups = stack if path.suffix.lower() == ".exr" else None
            images.write(path, picture, layers=groups, view=view, exposure=exposure)
        console.print(f"{path}")
    if save_matte is not None:
        images.write_mask(save_matte, plate[..., 3] if matte is None else matte)
        console.print(f"{save_matte}")
    source = next((path for path in pictures if path.suffix.lower() == ".exr"), None)
    for path in scripts:
        groups = {name.removeprefix("C_"): (source, name) for name in stack if name.startswith("C_")}
        nuke.write_script(path, groups, picture.shape[:2])
        console.print(f"{path}")


def _by_kind(outputs):
    """Pictures, and Nuke scripts."""
    scripts = [path for path in outputs if path.suffix.lower() == ".nk"]
    return [path for path in outputs if path not in scripts], scripts


def _words(text):
    """`albedo,N` as a list."""
    return [word.strip() for word in (text or "").split(",") if word.strip()]


def _lighting(path, lights, environments):
    """The lights of a file and of the options."""
    from relight.lights.environment import EnvironmentLight
    from relight.lights.files import read_lights
    from relight.lights.moving import parse

    lighting = [] if path is None else read_lights(path)
    lighting += [parse(text) for text in lights or []]
    lighting += [parse(text, EnvironmentLight) for text in environments or []]
    if not lighting:
        raise ValueError("no light: expected --light, --environment or --lights")
    return lighting


def _placed(plate, matte, size, background, *, mode, scale, offset):
    """Photograph and matte in the frame that the options ask for."""
    from relight.composite import place

    try:
        moved = tuple(map(int, offset.split("/")))
    except ValueError as error:
        raise ValueError(f"--offset: expected RIGHT/UP in pixels, such as 120/-40, got {offset!r}") from error
    if size is None and scale == 1 and moved == (0, 0):
        return plate, matte
    frame = plate.shape[:2]
    if size == "background":
        if getattr(background, "ndim", 0) != 3:
            raise ValueError("--size background: expected --background with an image")
        frame = background.shape[:2]
    elif size is not None:
        try:
            width, height = map(int, size.lower().split("x"))
        except ValueError as error:
            raise ValueError(f"--size: expected WIDTHxHEIGHT or background, got {size!r}") from error
        frame = height, width
    moves = {"mode": mode, "scale": scale, "offset": moved}
    return place(plate, frame, **moves), None if matte is None else place(matte, frame, **moves)


def _seen(lighting, size, field_of_view):
    """What a camera sees of the environments among the lights."""
    from relight.lights.environment import EnvironmentLight

    skies = [light for light in lighting if isinstance(light, EnvironmentLight)]
    if not skies:
        raise ValueError("--background environment: expected an environment among the lights")
    return sum(sky.view(size, field_of_view) for sky in skies)


def _background(text):
    """A colour as r/g/b, or the text as it is: a file's path."""
    try:
        return tuple(map(float, text.split("/")))
    except ValueError:
        return text


def _normals(path, axes):
    """Normals that a file holds, or a network in it makes."""
    from relight.media import images
    from shadow.normals import load

    if path.suffix in (".pt", ".safetensors"):
        return load(path, axes=axes)
    return load(images.read_normals(path, axes=axes))


@app.command()
def olat(
    image: Annotated[Path, typer.Argument(help="The photograph: PNG, JPEG, TIFF, OpenEXR...")],
    output: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--output",
            help="An .exr, of which each light is a layer, or one a light, such as olat.%04d.exr; and a .nk, "
            "if wanted, to mix them in Nuke.",
        ),
    ],
    mask: Annotated[Path | None, typer.Option(help="The matte, unless the image has alpha.")] = None,
    behind: Annotated[bool, typer.Option(help="32 directions behind the person too.")] = False,
    colour_space: ColourSpaceOption = None,
):
    """Write the person in IMAGE in one light at a time, from 64 directions, and a file of the directions."""
    from relight.media import images
    from relight.olat import write_olat

    pictures, scripts = _by_kind(output)
    if len(pictures) != 1 or len(scripts) > 1:
        raise ValueError("-o: expected one .exr and at most one .nk")
    plate = images.read(image, colour_space=colour_space)
    matte = None if mask is None else images.read_mask(mask)
    with _progress() as progress:
        task = progress.add_task("Lights", total=None)
        paths = write_olat(
            pictures[0], plate, matte, behind=behind, script=next(iter(scripts), None),
            progress=lambda done, total: progress.update(task, completed=done, total=total),
        )  # fmt: skip
    console.print(f"{paths[0]}" if len(paths) < 4 else f"{paths[0]} ... {len(paths)} files")


def _progress():
    """A bar with the time left."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=console)


@app.command()
def video(
    source: Annotated[
        str,
        typer.Argument(help="A photograph; a sequence such as plate.%04d.exr or plate.####.exr; a movie."),
    ],
    output: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--output",
            help="A sequence such as relit.%04d.exr (.exr keeps each light as a layer); a movie, .mp4 "
            "or .mov; a .nk, to mix the .exr in Nuke. Repeatable.",
        ),
    ],
    light: LightOption = None,
    environment: EnvironmentOption = None,
    lights: LightsOption = None,
    frames: Annotated[
        str | None,
        typer.Option(help="FIRST-LAST. Default: the source's, or from first to last keyframe of the lights."),
    ] = None,
    mask: Annotated[
        str | None, typer.Option(help="The matte, unless the source has alpha: a file, sequence or movie.")
    ] = None,
    key: KeyOption = None,
    background: Annotated[
        str | None,
        typer.Option(
            help="A file, sequence or movie; a linear colour such as 0.2/0.2/0.2; or environment: what a "
            "camera sees of it."
        ),
    ] = None,
    colour_space: ColourSpaceOption = None,
    layers: LayersOption = None,
    rate: Annotated[float | None, typer.Option(help="Frames a second. Default: the source's, or 24.")] = None,
    steady: Annotated[
        bool, typer.Option(help="Average what is found of a moving person over frames, where it is alike.")
    ] = True,
    view: ViewOption = None,
    exposure: ExposureOption = 0.0,
    white: Annotated[
        float, typer.Option(min=1, help="Light that shows as white in all frames; what is below rolls off.")
    ] = 4.0,
    resume: Annotated[bool, typer.Option("--resume", help="Keep the frames that are there.")] = False,
):
    """Relight a person frame by frame: lights that move (orbit=200, or a lights file), a person that does."""
    from relight.video import render_video

    lighting = _lighting(lights, light, environment)
    with _progress() as progress:
        tasks = {}

        def report(done, total, what):
            if what not in tasks:
                tasks[what] = progress.add_task(what, total=total)
            progress.update(tasks[what], completed=done)

        try:
            problems = render_video(
                source, lighting, output, frames=_span(frames), mask=mask, key=key,
                background=_backdrop(background, lighting), colour_space=colour_space, passes=_words(layers),
                steady=steady, rate=rate, view=view, exposure=exposure, white=white, resume=resume,
                progress=report,
            )  # fmt: skip
        except KeyboardInterrupt as interruption:
            console.print("interrupted; the same command with --resume goes on")
            raise typer.Exit(130) from interruption
    for number, problem in problems.items():
        console.print(f"frame {number}: {problem}")
    for path in output:
        console.print(f"{path}")
    if problems:
        raise typer.Exit(1)


def _span(text):
    """`1-200` as (1, 200)."""
    if text is None:
        return None
    first, _, last = text.partition("-")
    try:
        return int(first), int(last or first)
    except ValueError as error:
        raise ValueError(f"--frames: expected FIRST-LAST, such as 1-200, got {text!r}") from error


def _backdrop(text, lighting):
    """A file's path, a colour as r/g/b, or the environment among the lights."""
    if text == ENVIRONMENT:
        skies = [light for light in lighting if hasattr(getattr(light, "kind", light), "view")]
        if len(skies) != 1:
            raise ValueError(f"--background environment: expected one among the lights, got {len(skies)}")
        return skies[0]
    return None if text is None else _background(text)


app.command()(training.stage)
app.command()(training.train)
app.command()(training.shrink)
app.add_typer(training.evaluate, name="evaluate")
