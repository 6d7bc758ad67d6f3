"""The options that commands share, each declared once, and the texts that they are read from."""

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from enum import StrEnum
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, cast, get_type_hints

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

console = Console(stderr=True)

EXAMPLES = """A light: --light key:azimuth=-40,elevation=30,intensity=2,colour=1/0.9/0.8

A lamp in the room: --light lamp:position=-0.6/0.4/0.8,radius=0.1

An environment: --environment studio.exr,rotation=90,intensity=2"""

ColourSpace = Annotated[
    str | None,
    typer.Option(help="The photograph's, if its file does not say: sRGB, lin_rec709, ACEScg, Rec.2020..."),
]
Matte = Annotated[
    str | None,
    typer.Option(
        help="Have a network find the matte: MODEL.onnx, or a name of rembg's. Of an unknown one say "
        "MODEL.onnx,mean=0/0/0,std=1/1/1,size=320 (also order, fit, output, sigmoid, family)."
    ),
]
RefineMatte = Annotated[
    int | None,
    typer.Option(help="Solve the matte anew, or a rough --mask, in a band of so many pixels at its edge."),
]
Who = Annotated[
    str | None, typer.Option(help="Of several people: 2 for the second largest, X/Y for the nearest.")
]
Device = Annotated[
    str | None, typer.Option(help="Where the networks run: cpu, cuda, cuda:1... Default: cpu.")
]
Precision = Annotated[
    str | None,
    typer.Option(help="What the networks run in: bfloat16 or float32. Default: what is fast here."),
]
Threads = Annotated[
    int | None,
    typer.Option(help="Of this process. Machines that agree make frames alike to the bit."),
]


class Fitting(StrEnum):
    fit = "fit"
    fill = "fill"
    centre = "centre"


class ExrType(StrEnum):
    half = "half"
    float = "float"


class Screen(StrEnum):
    green = "green"
    blue = "blue"


@dataclass(frozen=True)
class Look:
    """What `apply` and `video` share: lights, the photograph's preparation, and what is written."""

    light: Annotated[
        list[str] | None,
        typer.Option(
            help="A light, as in the example below. Also direction=x/y/z, exposure (stops), temperature "
            "(kelvin), locus (planckian, daylight), angle (degrees, soft); in a video orbit (frames of a "
            "turn). In the room: position=x/y/z (metres), radius; or toward=x/y/z, width, height. Repeatable."
        ),
    ] = None
    environment: Annotated[
        list[str] | None,
        typer.Option(
            help="Light from a latitude-longitude map, as in the example below. Its centre is at the camera. "
            "Repeatable."
        ),
    ] = None
    lights: Annotated[Path | None, typer.Option(help="A lights file, YAML or JSON.")] = None
    save_lights: Annotated[
        Path | None, typer.Option(help="Write all these lights to a lights file, for next time.")
    ] = None
    mask: Annotated[
        str | None,
        typer.Option(
            help="The matte, unless the photograph has alpha: a file; in a video also a sequence or movie."
        ),
    ] = None
    key: Annotated[
        Screen | None,
        typer.Option(help="Cut the person out of a screen; a mask then says where there is one."),
    ] = None
    matte: Matte = None
    refine_matte: RefineMatte = None
    person: Who = None
    background: Annotated[
        str | None,
        typer.Option(
            help="An image of any size (in a video also a sequence or movie), a linear colour such as "
            "0.2/0.2/0.2, or environment: what a camera sees of it."
        ),
    ] = None
    field_of_view: Annotated[
        float,
        typer.Option(help="Of the camera, vertical, in degrees: for that, and for lights in the room."),
    ] = 40.0
    match_plate: Annotated[
        bool,
        typer.Option(
            "--match-plate",
            help="Light from the background, an image, as if the person stood there.",
        ),
    ] = False
    match: Annotated[
        str | None,
        typer.Option(
            help="Light as in this photograph of somebody, which has alpha, --match-mask or --matte."
        ),
    ] = None
    match_mask: Annotated[str | None, typer.Option(help="The matte of that photograph.")] = None
    size: Annotated[
        str | None,
        typer.Option(help="The picture's: 1920x1080, or background for its own. Default: the photograph's."),
    ] = None
    placement: Annotated[
        Fitting, typer.Option(help="How the photograph lies in a picture of another size.")
    ] = Fitting.fit
    scale: Annotated[float, typer.Option(help="Of the photograph, on top of that.")] = 1.0
    offset: Annotated[str, typer.Option(help="Of the photograph: RIGHT/UP in pixels.")] = "0/0"
    colour_space: ColourSpace = None
    normals: Annotated[
        str | None,
        typer.Option(help="Use these camera-frame normals: an image, or a network (PIFuHD's .pt)."),
    ] = None
    axes: Annotated[
        str, typer.Option(help="What that image's channels are measured along; OpenCV's are +x-y-z.")
    ] = "+x+y+z"
    depth: Annotated[
        str | None,
        typer.Option(help="Use this depth: an .exr (channel Z, metres), or a network (DAViD's .onnx)."),
    ] = None
    height: Annotated[
        float | None, typer.Option(help="Metres of the person that the photograph shows. Default: 1.75.")
    ] = None
    passes: Annotated[
        str | None, typer.Option(help="More layers of the .exr: any of albedo,N,Z,visibility,shading.")
    ] = None
    exr_type: Annotated[
        ExrType, typer.Option(help="What an .exr holds: float for lights so dim that half loses some.")
    ] = ExrType.half
    autocrop: Annotated[
        bool,
        typer.Option(
            help="Store no more of an .exr than the person's box, its data window: a quarter of the time."
        ),
    ] = False
    layers: Annotated[str | None, typer.Option(hidden=True, help="The former name of --passes.")] = None
    floor: Annotated[
        str | None,
        typer.Option(
            help="Throw the person's shadow on the ground: height=1.5,horizon=0.45, the camera's metres "
            "above it and its horizon from the picture's top (0) to bottom (1); or feet=X/Y/X/Y in pixels."
        ),
    ] = None
    view: Annotated[
        str | None,
        typer.Option(
            help="View transform of what is for display, e.g. aces, from OpenColorIO's built-in "
            "configuration or $OCIO. Without one that is sRGB, with highlights rolled off."
        ),
    ] = None
    exposure: Annotated[float, typer.Option(help="Of what is for display, in stops.")] = 0.0
    save_matte: Annotated[
        str | None,
        typer.Option(help="Write the matte alone, grey: PNG, TIFF or OpenEXR; in a video a sequence."),
    ] = None
    device: Device = None

    def lighting(self) -> list:
        """The lights of the file and of the options."""
        from relight.lights.environment import EnvironmentLight
        from relight.lights.files import read_lights
        from relight.lights.moving import parse

        lighting = [] if self.lights is None else read_lights(self.lights)
        lighting += [parse(text) for text in self.light or []]
        lighting += [parse(text, EnvironmentLight) for text in self.environment or []]
        if not (lighting or self.match_plate or self.match):
            raise ValueError("no light: expected --light, --environment, --lights, --match or --match-plate")
        return lighting

    def settings(self) -> dict[str, Any]:
        """The arguments that `render_still` and `render_video` share."""
        from relight.cutting import Cutting
        from relight.floor import Floor
        from relight.matching import Matching
        from relight.preparation import Placement

        if self.layers is not None:
            console.print("--layers is now called --passes")
        if self.lights and self.save_lights and self.lights.resolve() == self.save_lights.resolve():
            raise ValueError(f"{self.save_lights}: is read as well, and would be overwritten")
        return {
            "mask": self.mask,
            "key": self.key,
            "cutting": Cutting.parse(self.matte, self.person, self.refine_matte),
            "background": parse_background(self.background),
            "field_of_view": self.field_of_view,
            "matching": Matching(self.match_plate, self.match, self.match_mask),
            "placement": Placement(size_of(self.size), self.placement, self.scale, offset_of(self.offset)),
            "colour_space": self.colour_space,
            "normals": self.normals,
            "axes": self.axes,
            "depth": self.depth,
            "height": self.height,
            "passes": _words(self.passes) + _words(self.layers),
            "exr_type": self.exr_type.value,
            "autocrop": self.autocrop,
            "floor": None if self.floor is None else Floor.parse(self.floor),
            "view": self.view,
            "exposure": self.exposure,
            "save_matte": self.save_matte,
            "save_lights": self.save_lights,
            "device": self.device,
        }


def with_options(options: type) -> Callable:
    """Lets a command take the fields of a dataclass as options of its own: its last parameter, `look`, gets
    them as one object."""
    hints, keyword = get_type_hints(options, include_extras=True), inspect.Parameter.KEYWORD_ONLY

    def decorate(command: Callable) -> Callable:
        own = inspect.signature(command)
        shared = [
            inspect.Parameter(
                field.name,
                keyword,
                default=field.default,
                annotation=hints[field.name],
            )
            for field in fields(options)
        ]

        @wraps(command)
        def run(**arguments: Any) -> Any:
            look = options(**{field.name: arguments.pop(field.name) for field in fields(options)})
            return command(**arguments, look=look)

        kept = [
            parameter.replace(kind=keyword)
            for parameter in own.parameters.values()
            if parameter.name != "look"
        ]
        run.__signature__ = own.replace(parameters=[*kept, *shared])  # type: ignore[attr-defined]  # for typer
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in (*kept, *shared)}
        return run

    return decorate


def progress_bar() -> Progress:
    """A bar with the time left."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=console)


def tell(problems: Mapping[int, str], outputs: Iterable[Path]) -> None:
    """Say which frames could not be made, and what was written; exit code 1 if there are any."""
    for number, problem in problems.items():
        console.print(f"frame {number}: {problem}")
    for path in outputs:
        console.print(f"{path}")
    if problems:
        raise typer.Exit(1)


def by_kind(outputs: list[Path]) -> tuple[list[Path], list[Path]]:
    """Pictures, and Nuke scripts."""
    scripts = [path for path in outputs if path.suffix.lower() == ".nk"]
    return [path for path in outputs if path not in scripts], scripts


def _words(text: str | None) -> list[str]:
    """`albedo,N` as a list."""
    return [word.strip() for word in (text or "").split(",") if word.strip()]


def size_of(text: str | None) -> tuple[int, int] | str | None:
    """`1920x1080` as (height, width); `background` as it is."""
    if text is None or text == "background":
        return text
    try:
        width, height = map(int, text.lower().split("x"))
    except ValueError as error:
        raise ValueError(f"--size: expected WIDTHxHEIGHT or background, got {text!r}") from error
    return height, width


def offset_of(text: str) -> tuple[int, int]:
    """`120/-40` as (right, up)."""
    try:
        return cast(tuple[int, int], tuple(map(int, text.split("/"))))  # `Placement` counts them
    except ValueError as error:
        raise ValueError(f"--offset: expected RIGHT/UP in pixels, such as 120/-40, got {text!r}") from error


def parse_background(text: str | None) -> tuple[float, ...] | str | None:
    """A colour `0.2/0.2/0.2`, or the text as it is: a file's path, or environment."""
    if text is None:
        return None
    if re.fullmatch("#[0-9a-fA-F]{3,8}", text) or (text.count(",") == 2 and not Path(text).exists()):
        raise ValueError(f"--background: expected a linear colour as 0.2/0.2/0.2, or a file, got {text!r}")
    try:
        return tuple(map(float, text.split("/")))
    except ValueError:
        return text
