"""What a shot is made from: `Source`, `Lighting`, `Output` and `Compute`, which every layer passes on.

Each option is declared here once: its type, its default and its help. The command line is generated from the
fields. Nothing heavy is imported.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from relight.pipeline.option_fields import (
    Alpha,
    ExrType,
    Filling,
    Fitting,
    Options,
    Screen,
    option,
    parse_background,
    parse_floor,
    parse_offset,
    parse_passes,
    parse_person,
    parse_place,
    parse_size,
)

if TYPE_CHECKING:
    import numpy as np

    from relight.compositing.floor import Floor
    from relight.lights.environment import EnvironmentLight
    from relight.lights.light import Light
    from relight.lights.moving import MovingLight
    from relight.scene.usd.read import Rig

    Picture = np.ndarray | str | Path  # an image in memory, a file, a sequence or a movie
    Normals = np.ndarray | Callable | str | os.PathLike
    BackgroundSource = np.ndarray | tuple[float, ...] | EnvironmentLight | MovingLight | str | Path


@dataclass(frozen=True)
class Source(Options):
    """The photograph or the frames, and all options that determine the person in them.

    An analysis cache (`shot.relight`, see `relight.analyse_shot`) contains all of this. If it is the plate,
    the other fields keep their defaults.

    Examples
    --------
    >>> source = relight.Source("plate.%04d.exr", mask="matte.%04d.png", height=1.8)
    """

    plate: Picture = option(
        "A photograph (PNG, JPEG, TIFF, OpenEXR...); a sequence such as plate.%04d.exr or plate.####.exr; a "
        "movie; or an analysis cache, shot.relight, see `relight analyse`.",
        MISSING,
        path=True,
        metavar="SOURCE",
    )
    mask: Picture | None = option(
        "The matte of the person: a file, a sequence or a movie. Without it, and without alpha, --matte.",
        path=True,
    )
    key: Screen | None = option(
        "Key the person from a screen of this colour. A mask then marks where the person is.", text=Screen
    )
    matte: str | Path | None = option(
        "How the person is found in a source without a matte: auto, by networks that `relight fetch person` "
        "brings; MODEL.onnx; or a model name of rembg. For a model that is not recognised add its input "
        "format: MODEL.onnx,mean=0/0/0,size=320 (also std, order, fit, output, sigmoid, family).",
        "auto",
        path=True,
    )
    refine_matte: int | None = option(
        "Refine the inferred matte, or a rough --mask, in a band this many pixels wide along its edge.",
        text=int,
    )
    feather: float = option(
        "Soften the edge of the person in the picture by a Gaussian of this standard deviation, in pixels.",
        0.0,
        text=float,
    )
    person: int | tuple[int, ...] | str | None = option(
        "Which of several people: 2 is the second largest, X/Y the one nearest to that pixel, X/Y/RADIUS the "
        "one who is found most like that circle, all everybody together.",
        parse=parse_person,
    )
    track: str | Path | None = option(
        "A file that `relight track` wrote: where the person of a shot who is found is in each frame.",
        path=True,
    )
    size: tuple[int, int] | str | None = option(
        "Size of the picture: 1920x1080, or background for that of the background. Default: the source's.",
        parse=parse_size,
    )
    placement: Fitting = option("How the source is placed in a picture of another size.", "fit", text=Fitting)
    scale: float = option("Scale of the source, after --placement.", 1.0, text=float)
    offset: tuple[int, int] = option(
        "Shift of the source in pixels: RIGHT/UP. Default: 0/0.", (0, 0), parse=parse_offset
    )
    colour_space: str | None = option(
        "Colour space of the source, in place of what its files state: sRGB, ACEScg, 'ARRI LogC4'..."
    )
    alpha: Alpha | None = option(
        "Alpha of the source if its files state it wrongly: straight or premultiplied.",
        text=Alpha,
        metavar="<word>",
    )
    normals: Normals | None = option(
        "Use these camera-space normals: an image, a sequence, or a network (PIFuHD's .pt).", path=True
    )
    axes: str | None = option("Axes of the channels of those normals. Default: +x+y+z; OpenCV's are +x-y-z.")
    depth: Picture | None = option(
        "Use this depth: an .exr (channel Z, metres), a sequence, or a network (DAViD's .onnx).", path=True
    )
    height: float | None = option(
        "Height in metres of the part of the person that the matte shows. Default: 1.75.", text=float
    )
    field_of_view: float | None = option(
        "Vertical field of view of the camera, in degrees. Default: 40.", text=float
    )
    temporal_filter: bool = option(
        "Average the analysis of a moving person over 5 frames where they agree, to reduce flicker.",
        True,
        text=bool,
    )


@dataclass(frozen=True)
class Lighting(Options):
    """The lights of a shot, and what is behind the person.

    `lights` are a light, several, the name of a preset, or the path of a lights file; `light` and
    `environment` add lights, objects or texts as the command line spells them. A preset leaves the face as
    bright as in the photograph, and brings its gloss, unless `gloss` is given.

    Examples
    --------
    >>> lighting = relight.Lighting("lights.yaml", background="street.jpg", match_plate=True)
    """

    lights: Light | MovingLight | Iterable[Light | MovingLight] | str | Path = option(
        "A lights file (YAML or JSON), a USD stage, or a glTF scene.", (), path=True
    )
    camera: str | None = option(
        "The camera in that stage or scene: the path of its prim, or the name of its node. Default: the only "
        "one. The plate has its field of view unless --field-of-view is given."
    )
    subject_at: str | tuple[float, ...] | None = option(
        "Where the middle of the person is in that stage or scene: the path of a prim or the name of a node, "
        "or x/y/z in its units. Default: on the camera's axis at its focus distance.",
        parse=parse_place,
    )
    allow_external: bool = option(
        "Let that stage read files from outside its own folder.",
        False,
        text=bool,
        flags=("--allow-external",),
    )
    preset: str | None = option(
        "Light by name: three-point, rembrandt, butterfly, split, rim, window, overcast, golden-hour, stage "
        "or firelight."
    )
    light: Sequence[str | Light | MovingLight] = option(
        "A light, as in the example below. Also direction=x/y/z, exposure (stops), temperature (kelvin), "
        "locus (planckian, daylight), angle (degrees; soft shadows), orbit (frames of one turn). Near "
        "lights: position=x/y/z (metres), radius; or toward=x/y/z, width, height; cone (degrees), softness. "
        "Repeatable.",
        (),
        text=list[str],
    )
    environment: Sequence[str] = option(
        "Light from a latitude-longitude map, as in the example below. Its centre is at the camera. "
        "Repeatable.",
        (),
        text=list[str],
    )
    background: BackgroundSource | None = option(
        "An image, a sequence or a movie, of any size; a linear colour such as 0.2/0.2/0.2; environment, the "
        "camera's view of the environments among the lights; plate, the photograph itself; or none. Default: "
        "plate for a source without alpha in .png, .jpg, .tif and movies, otherwise none.",
        parse=parse_background,
        path=True,
    )
    background_colour_space: str | None = option(
        "Colour space of the background, in place of what its files state."
    )
    match_plate: bool = option(
        "Light the person from the background image, as if they stood in it.",
        False,
        text=bool,
        flags=("--match-plate",),
    )
    fill: Filling | None = option(
        "background: the background image, or the photograph's own, fills the shadows of the other lights.",
        text=Filling,
    )
    fill_amount: float = option(
        "Share of the background's light that fills, 0 to 1. Default: 0.3.",
        0.3,
        text=float,
        min=0,
        max=1,
        metavar="<float>",
    )
    background_light: float = option(
        "Share of the person's new light that reaches the background too, 0 to 1: it darkens and tints with "
        "it. Default: 0.",
        0.0,
        text=float,
        min=0,
        max=1,
        metavar="<float>",
    )
    match: Picture | None = option(
        "Light the person as the person in this photograph is lit. It needs alpha, --match-mask or --matte.",
        path=True,
    )
    match_mask: Picture | None = option("The matte of the --match photograph.", path=True)
    gloss: float | None = option(
        "Reflection at grazing angles, 0 to 1: a rim on hair, shoulders and arms in light from behind. "
        "Default: that of the preset; otherwise none.",
        text=float,
        min=0,
        max=1,
        metavar="<float>",
    )
    amount: float = option(
        "Share of the new light, 0 to 1: the rest is the photograph's own. 0 is the photograph. Default: 1.",
        1.0,
        text=float,
        min=0,
        max=1,
        metavar="<float>",
    )
    intensity: float = option(
        "Intensity of all lights together: 2 is twice the light. Default: 1; a preset leaves the face as "
        "bright as in the photograph.",
        1.0,
        text=float,
        min=0,
        metavar="<float>",
    )
    floor: Floor | None = option(
        "Cast the person's shadow on the ground: height=1.5,horizon=0.45, where height is that of the camera "
        "in metres and horizon is a fraction of the picture from top (0) to bottom (1); or feet=X/Y/X/Y in "
        "pixels.",
        parse=parse_floor,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        lights: Any = self.lights
        if isinstance(lights, str) and not os.path.exists(lights) and not os.path.splitext(lights)[1]:
            self._set("preset", lights)
            self._set("lights", ())
        elif not isinstance(lights, str | os.PathLike):
            from relight.lights.rig import as_rig

            self._set("lights", tuple(as_rig(lights, "lights or the path of a lights file")))
        texts: Any = (
            [self.light] if isinstance(self.light, str) or hasattr(self.light, "name") else self.light
        )
        if any(not isinstance(each, str) for each in texts):
            from relight.lights.rig import as_rig

            as_rig([each for each in texts if not isinstance(each, str)], "texts or lights in `light`")
        self._set("light", tuple(texts))
        if isinstance(self.background, str):
            self._set("background", parse_background(self.background))
        if self.gloss is not None:
            from relight.analysis.gloss import checked_gloss

            self._set("gloss", checked_gloss(self.gloss))
        from relight.arguments import checked_number

        self._set("amount", checked_number("amount", self.amount, 0, 1))
        self._set("background_light", checked_number("background_light", self.background_light, 0, 1))
        self._set("fill_amount", checked_number("fill_amount", self.fill_amount, 0, 1))
        if self.fill and self.match_plate:
            raise ValueError("fill: expected none beside match_plate, which is the background's whole light")
        self._set("intensity", checked_number("intensity", self.intensity, 0))

    def rig(self) -> Rig:
        """Read the lights of the objects, the lights file and the texts, and the camera of a scene.

        Those of the preset are not among them, see `preset_lights`. Raises as `relight.read_lights` does.
        """
        from relight.lights.environment import EnvironmentLight
        from relight.lights.moving import parse
        from relight.scene.lights import read_rig
        from relight.scene.usd.read import Rig

        given: Any = self.lights
        scene: dict[str, Any] = {
            "camera": self.camera,
            "subject_at": self.subject_at,
            "allow_external": self.allow_external,
        }
        if isinstance(given, tuple):
            for name, value in scene.items():
                if value:
                    raise ValueError(f"{name}: expected a USD stage or a glTF scene (--lights), which has it")
        rig = Rig([*given]) if isinstance(given, tuple) else read_rig(given, **scene)
        added = [parse(each) if isinstance(each, str) else each for each in self.light]
        lights = [*rig.lights, *added]
        lights += [parse(text, EnvironmentLight) for text in self.environment]
        return rig._replace(lights=lights)

    @property
    def preset_lights(self) -> list[Light]:
        """The lights of the preset, as bright as it states them."""
        from relight.lights import presets

        return [] if self.preset is None else presets.named(self.preset)

    def with_lights(self, lights: Iterable[Light | MovingLight] | Path) -> Lighting:
        """Return the same options with these lights in place of all that `rig` reads, or their file."""
        return dataclasses.replace(
            self, lights=lights, light=(), environment=(), camera=None, subject_at=None,
            allow_external=False,
        )  # fmt: skip

    @property
    def effective_gloss(self) -> float:
        """The strength of the gloss: the one given, otherwise that of the preset, otherwise 0."""
        if self.gloss is None and self.preset is not None:
            from relight.lights import presets

            return presets.gloss(self.preset)
        return self.gloss or 0.0

    def check_any(self) -> None:
        """Raise ValueError if there are no lights, not even matched ones."""
        if not self.has_lights:
            raise ValueError(
                "lights: expected at least one (--preset, --light, --environment, --lights, --match or "
                "--match-plate)"
            )

    @property
    def has_lights(self) -> bool:
        """Whether there is any light, set or matched."""
        given = self.lights or self.preset or self.light or self.environment
        return bool(given) or self.match_plate or self.match is not None


@dataclass(frozen=True)
class Output(Options):
    """The files that a shot is written to.

    Examples
    --------
    >>> output = relight.Output(["relit.exr", "relit.nk"], passes=["albedo", "N"])
    """

    # A path or several, str or Path, become a tuple of Path.
    paths: Any = option(
        "A file to write, a sequence such as relit.%04d.exr, or a movie, .mp4 or .mov. An .exr keeps each "
        "light as a layer; a .nk mixes the .exr in Nuke. Repeatable.",
        MISSING,
        text=list[Path],
        flags=("-o", "--output"),
        path=True,
        metavar="<file>",
    )
    passes: Sequence[str] = option(
        "Further layers of the .exr: albedo, N, Z, P, visibility, shading, gloss; as albedo,N.",
        (),
        parse=parse_passes,
    )
    exr_type: ExrType = option(
        "Type of the .exr channels; float for lights that are too dim for half.", "half", text=ExrType
    )
    output_colour_space: str | None = option(
        "Colour space of .exr outputs: ACEScg, ACES2065-1, Rec.2020, P3... Default: linear Rec.709."
    )
    autocrop: bool = option(
        "Store only the bounding box of the person in an .exr (its data window). Four times as fast.",
        False,
        text=bool,
        flags=("--autocrop",),
    )
    view: str | None = option(
        "View transform of display formats (PNG, JPEG, movies), such as aces, from OpenColorIO's built-in "
        "configuration or $OCIO. Default: sRGB with compressed highlights."
    )
    exposure: float = option("Exposure of display formats, in stops.", 0.0, text=float)
    white: float | None = option(
        "Linear value that display formats show as white; highlights below it are compressed. Default: 4 for "
        "sequences and movies, the brightest pixel for a still.",
        text=float,
        min=1,
        metavar="<float>",
    )
    save_matte: Path | None = option(
        "Also write the matte, as a grey PNG, TIFF or OpenEXR file or sequence.", path=True
    )
    save_lights: Path | None = option("Also write all lights: YAML or JSON, USD, or glTF.", path=True)
    rate: float | None = option(
        "Frame rate of movies, in frames per second. Default: the source's, or 24.", text=float
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        paths: Any = self.paths
        self._set("paths", tuple(map(Path, [paths] if isinstance(paths, str | os.PathLike) else paths)))
        for name in ("save_matte", "save_lights"):
            if getattr(self, name) is not None:
                self._set(name, Path(getattr(self, name)))
        if isinstance(self.passes, str):
            raise TypeError(f"passes: expected a sequence of names, got {self.passes!r}")
        self._set("passes", tuple(self.passes))


@dataclass(frozen=True)
class Compute(Options):
    """Where and how the networks run.

    Examples
    --------
    >>> compute = relight.Compute(device="cpu", precision="float32", threads=1)
    """

    device: str | None = option("Device of the networks: cpu, cuda, cuda:1... Default: cpu.")
    precision: Literal["bfloat16", "float32"] | None = option(
        "Precision of the networks: bfloat16 or float32. Default: the faster one on this processor."
    )
    threads: int | None = option(
        "Number of CPU threads. With equal precision and threads, machines of one kind make bit-identical "
        "frames.",
        text=int,
    )


GROUPS: dict[str, type[Options]] = {
    "source": Source,
    "lighting": Lighting,
    "output": Output,
    "compute": Compute,
}
