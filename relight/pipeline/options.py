"""What a shot is made from: `Source`, `Lighting`, `Output` and `Compute`, which every layer passes on.

Each option is declared here once: its type, its default and its help. The command line is generated from the
fields. Nothing heavy is imported.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, cast

from annotated_types import Ge, Gt, Interval

from relight import quantities
from relight.arguments import About, default, required
from relight.pipeline.option_fields import (
    AddedLights,
    AnyFloor,
    AnyLights,
    BackgroundSource,
    Normals,
    Offset,
    OptionalPath,
    Options,
    Passes,
    Paths,
    Person,
    Photograph,
    Picture,
    Place,
    Preset,
    Size,
    Texts,
)
from relight.quantities import File

if TYPE_CHECKING:
    from relight.lights.light import Light
    from relight.lights.moving import MovingLight
    from relight.scene.usd.read import Rig

MAX_THREADS = 1024
MAX_BAND = 4096  # pixels, of the band in which a matte is refined
TEMPORAL_RADIUS, MAX_TEMPORAL_RADIUS = 2, 8  # frames to each side in the temporal filter


@dataclass(frozen=True)
class Source(Options):
    """The photograph or the frames, and all options that determine the person in them.

    An analysis cache (`shot.relight`, see `relight.analyse_shot`) contains all of this. If it is the plate,
    the other fields keep their defaults.

    Examples
    --------
    >>> source = relight.Source("plate.%04d.exr", mask="matte.%04d.png", height=1.8)
    """

    plate: Annotated[
        Photograph,
        About(
            "A photograph (PNG, JPEG, TIFF, OpenEXR...); a sequence such as plate.%04d.exr or "
            "plate.####.exr; a movie; or an analysis cache, shot.relight, see `relight analyse`.",
            path=True,
            metavar="SOURCE",
        ),
    ]
    mask: Annotated[
        Picture | None,
        About(
            "The matte of the person: a file, a sequence or a movie. Without it, and without alpha, --matte.",
            path=True,
        ),
    ] = None
    key: Annotated[
        Literal["green", "blue"] | None,
        About("Key the person from a screen of this colour. A mask then marks where the person is."),
    ] = None
    matte: Annotated[
        File | None,
        About(
            "How the person is found in a source without a matte: auto, by networks that `relight fetch "
            "person` brings; MODEL.onnx; or a model name of rembg. For a model that is not recognised "
            "add its input format: MODEL.onnx,mean=0/0/0,size=320 (also std, order, fit, output, "
            "sigmoid, family).",
            path=True,
        ),
    ] = "auto"
    refine_matte: Annotated[
        int | None,
        Interval(ge=1, le=MAX_BAND),
        About(
            "Refine the inferred matte, or a rough --mask, in a band this many pixels wide along its edge.",
        ),
    ] = None
    feather: Annotated[
        float,
        Ge(0),
        About(
            "Soften the edge of the person in the picture by a Gaussian of this standard deviation, in "
            "pixels.",
        ),
    ] = 0.0
    person: Annotated[
        Person | None,
        About(
            "Which of several people: 2 is the second largest, X/Y the one nearest to that pixel, "
            "X/Y/RADIUS the one who is found most like that circle, all everybody together.",
        ),
    ] = None
    track: Annotated[
        File | None,
        About(
            "A file that `relight track` wrote: where the person of a shot who is found is in each frame.",
            path=True,
        ),
    ] = None
    size: Annotated[
        Size | None,
        About(
            "Size of the picture: 1920x1080, or background for that of the background. Default: the "
            "source's.",
        ),
    ] = None
    placement: Annotated[
        Literal["fit", "fill", "centre"],
        About("How the source is placed in a picture of another size."),
    ] = "fit"
    scale: Annotated[float, Gt(0), About("Scale of the source, after --placement.")] = 1.0
    offset: Annotated[Offset, About("Shift of the source in pixels: RIGHT/UP. Default: 0/0.")] = (0, 0)
    colour_space: Annotated[
        str | None,
        About("Colour space of the source, in place of what its files state: sRGB, ACEScg, 'ARRI LogC4'..."),
    ] = None
    alpha: Annotated[
        Literal["straight", "premultiplied"] | None,
        About("Alpha of the source if its files state it wrongly: straight or premultiplied."),
    ] = None
    normals: Annotated[
        Normals | None,
        About(
            "Use these camera-space normals: an image, a sequence, or a network (PIFuHD's .pt).",
            path=True,
        ),
    ] = None
    axes: Annotated[
        str | None,
        About("Axes of the channels of those normals. Default: +x+y+z; OpenCV's are +x-y-z."),
    ] = None
    depth: Annotated[
        Picture | None,
        About(
            "Use this depth: an .exr (channel Z, metres), a sequence, or a network (DAViD's .onnx).",
            path=True,
        ),
    ] = None
    height: Annotated[
        quantities.Height | None,
        About("Height in metres of the part of the person that the matte shows. Default: 1.75."),
    ] = None
    field_of_view: Annotated[
        quantities.FieldOfView | None,
        About("Vertical field of view of the camera, in degrees. Default: 40."),
    ] = None
    reference: Annotated[
        int | None,
        About(
            "The frame whose place, size and old light of the person count for all frames. Default: the one "
            "in which they are largest and whole, among the first 24.",
        ),
    ] = None
    temporal_filter: Annotated[
        bool,
        About("Average the analysis of a moving person over time, where frames agree, to reduce flicker."),
    ] = True
    temporal_radius: Annotated[
        int,
        Interval(ge=0, le=MAX_TEMPORAL_RADIUS),
        About("Frames before and after each with which its analysis is averaged; 0: none."),
    ] = TEMPORAL_RADIUS

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.temporal_filter and self.temporal_radius != TEMPORAL_RADIUS:
            raise ValueError("temporal_radius: expected none without the temporal filter, which it widens")


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

    lights: Annotated[
        AnyLights,
        About("A lights file (YAML or JSON), a USD stage, or a glTF scene.", path=True),
    ] = ()
    camera: Annotated[
        str | None,
        About(
            "The camera in that stage or scene: the path of its prim, or the name of its node. Default: "
            "the only one. The plate has its field of view unless --field-of-view is given.",
        ),
    ] = None
    subject_at: Annotated[
        Place | None,
        About(
            "Where the middle of the person is in that stage or scene: the path of a prim or the name of "
            "a node, or x/y/z in its units. Default: on the camera's axis at its focus distance.",
        ),
    ] = None
    allow_external: Annotated[
        bool,
        About("Let that stage read files from outside its own folder.", flags=("--allow-external",)),
    ] = False
    preset: Annotated[
        Preset | None,
        About(
            "Light by name: three-point, rembrandt, butterfly, split, rim, window, overcast, "
            "golden-hour, stage or firelight.",
        ),
    ] = None
    light: Annotated[
        AddedLights,
        About(
            "A light, as in the examples. Also direction=x/y/z, exposure (stops), temperature "
            "(kelvin), locus (planckian, daylight), tint (Duv), source (tungsten, hmi, led...), gel (L201), "
            "angle (degrees; soft shadows), orbit (frames of one turn). Near lights: position=x/y/z "
            "(metres), radius; or toward=x/y/z, width, height; cone (degrees), softness; profile (.ies, "
            ".ldt), angle_scale; at=head, hips, left-hand or right-hand, which they follow. Repeatable.",
            repeatable=True,
        ),
    ] = ()
    environment: Annotated[
        Texts,
        About(
            "Light from a latitude-longitude map, as in the examples. Its centre is at the camera. "
            "Repeatable.",
            repeatable=True,
        ),
    ] = ()
    background: Annotated[
        BackgroundSource | None,
        About(
            "An image, a sequence or a movie, of any size; black, white, #808080 or a linear colour such "
            "as 0.2/0.2/0.2; blur, the photograph itself out of focus; plate, the same in focus; "
            "environment, the camera's view of the environments among the lights; or none. Default: plate "
            "for a source without alpha, but none in an .exr.",
            path=True,
        ),
    ] = None
    background_colour_space: Annotated[
        str | None,
        About("Colour space of the background, in place of what its files state."),
    ] = None
    match_plate: Annotated[
        bool,
        About(
            "Light the person from the background image, as if they stood in it.",
            flags=("--match-plate",),
        ),
    ] = False
    fill: Annotated[
        Literal["background"] | None,
        About(
            "background: the background image, or the photograph's own, fills the shadows of the other "
            "lights.",
        ),
    ] = None
    fill_amount: Annotated[
        quantities.Amount,
        About("Share of the background's light that fills, 0 to 1. Default: 0.3."),
    ] = 0.3
    background_blur: Annotated[
        quantities.Blur,
        About(
            "Blur of the background, as of a lens: the radius as a share of the picture's height, 0 to "
            "0.2. Default: 0; 0.02 for --background blur.",
        ),
    ] = 0.0
    background_light: Annotated[
        quantities.Amount,
        About(
            "Share of the person's new light that reaches the background too, 0 to 1: it darkens and "
            "tints with it. Default: 0.",
        ),
    ] = 0.0
    match: Annotated[
        Photograph | None,
        About(
            "Light the person as the person in this photograph is lit. It needs alpha, --match-mask or "
            "--matte.",
            path=True,
        ),
    ] = None
    match_mask: Annotated[Picture | None, About("The matte of the --match photograph.", path=True)] = None
    paint: Annotated[
        Picture | None,
        About(
            "Paint the light: a picture of strokes on the photograph, red for brighter, blue for darker and "
            "green for as it is; or grey, 128 for as it is. Its lights replace the others, or the "
            "photograph's own.",
            path=True,
        ),
    ] = None
    paint_count: Annotated[
        int, Interval(ge=1, le=32), About("Number of lights at most that --paint makes. Default: 4.")
    ] = 4
    gloss: Annotated[
        quantities.Gloss | None,
        About(
            "Reflection at grazing angles, 0 to 1: a rim on hair, shoulders and arms in light from "
            "behind. Default: that of the preset; otherwise none.",
        ),
    ] = None
    amount: Annotated[
        quantities.Amount,
        About(
            "Share of the new light, 0 to 1: the rest is the photograph's own. 0 is the photograph. "
            "Default: 1.",
        ),
    ] = 1.0
    intensity: Annotated[
        quantities.Intensity,
        About(
            "Intensity of all lights together: 2 is twice the light. Default: 1; a preset leaves the "
            "face as bright as in the photograph.",
        ),
    ] = 1.0
    floor: Annotated[
        AnyFloor | None,
        About(
            "Cast the person's shadow on the ground: height=1.5,horizon=0.45, where height is that of "
            "the camera in metres and horizon is a fraction of the picture from top (0) to bottom (1); "
            "or feet=X/Y/X/Y in pixels.",
        ),
    ] = None

    def __post_init__(self) -> None:
        lights: object = self.lights
        if isinstance(lights, str) and not os.path.exists(lights) and not os.path.splitext(lights)[1]:
            self._set("preset", lights)
            self._set("lights", ())
        super().__post_init__()
        if isinstance(self.background, str) and self.background == quantities.BLUR:
            self._set("background", quantities.PLATE)
            self._set("background_blur", self.background_blur or quantities.STRONG_BLUR)
        if self.fill and self.match_plate:
            raise ValueError("fill: expected none beside match_plate, which is the background's whole light")
        if self.paint is not None and (self.fill or self.match_plate):
            raise ValueError("paint: expected neither fill nor match_plate, whose light cannot be painted")

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
                    raise ValueError(
                        f"{name}: expected a USD stage or a glTF scene (lights=FILE), which has it"
                    )
        rig = Rig([*given]) if isinstance(given, tuple) else read_rig(given, **scene)
        texts = cast("Iterable[str | Light | MovingLight]", self.light)
        added = [parse(each) if isinstance(each, str) else each for each in texts]
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

    @property
    def has_background(self) -> bool:
        """Whether anything behind the person was asked for."""
        return self.background is not None and not self.background_is(quantities.NONE)

    def background_is(self, word: str) -> bool:
        """Return whether the background is a word: "environment", "plate" or "none"."""
        return isinstance(self.background, str) and self.background == word

    @property
    def uses_plate_light(self) -> bool:
        """Whether the background lights the person."""
        return self.match_plate or self.fill is not None

    def check_any(self) -> None:
        """Raise ValueError if there are no lights, not even matched ones."""
        if not self.has_lights:
            raise ValueError(
                "lights: expected at least one (preset, light, environment, lights, match, "
                "match_plate or paint)"
            )

    @property
    def has_lights(self) -> bool:
        """Whether there is any light, set or matched."""
        given = self.lights or self.preset or self.light or self.environment
        found = self.match_plate or self.match is not None or self.paint is not None
        return bool(given) or found


@dataclass(frozen=True)
class Output(Options):
    """The files that a shot is written to.

    Examples
    --------
    >>> output = relight.Output(["relit.exr", "relit.nk"], passes=["albedo", "N"])
    """

    paths: Annotated[
        Paths,
        About(
            "A file to write, a sequence such as relit.%04d.exr, or a movie, .mp4 or .mov. An .exr keeps "
            "each light as a layer; a .nk mixes the .exr in Nuke. Repeatable.",
            path=True,
            flags=("-o", "--output"),
            repeatable=True,
            metavar="<file>",
        ),
    ] = required()
    passes: Annotated[
        Passes,
        About(
            "Further layers of the .exr: albedo, N, Z, P, visibility, shading, gloss, confidence; as "
            "albedo,N."
        ),
    ] = default(())
    exr_type: Annotated[
        Literal["half", "float"],
        About("Type of the .exr channels; float for lights that are too dim for half."),
    ] = "half"
    output_colour_space: Annotated[
        str | None,
        About("Colour space of .exr outputs: ACEScg, ACES2065-1, Rec.2020, P3... Default: linear Rec.709."),
    ] = None
    autocrop: Annotated[
        bool,
        About(
            "Store only the bounding box of the person in an .exr (its data window). Four times as fast.",
            flags=("--autocrop",),
        ),
    ] = False
    view: Annotated[
        str | None,
        About(
            "View transform of display formats (PNG, JPEG, movies), such as aces, from OpenColorIO's "
            "built-in configuration or $OCIO. Default: sRGB with compressed highlights.",
        ),
    ] = None
    exposure: Annotated[quantities.Exposure, About("Exposure of display formats, in stops.")] = 0.0
    white: Annotated[
        float | None,
        Ge(1),
        About(
            "Linear value that display formats show as white; highlights below it are compressed. "
            "Default: 4 for sequences and movies, the brightest pixel for a still.",
        ),
    ] = None
    quality: Annotated[
        int | None,
        Interval(ge=1, le=100),
        About("Quality of .jpg and .webp files, 1 to 100. Default: 98."),
    ] = None
    longest_side: Annotated[
        int | None,
        Interval(ge=16, le=65536),
        About(
            "Reduce pictures in display formats to this many pixels along their longer side; movies, .exr "
            "and .hdr keep their size.",
            unit="pixels",
        ),
    ] = None
    save_matte: Annotated[
        OptionalPath,
        About("Also write the matte, as a grey PNG, TIFF or OpenEXR file or sequence.", path=True),
    ] = default(None)
    plot: Annotated[
        OptionalPath,
        About(
            "Also draw a lighting plot, .svg: person, camera and lights from above and from the side.",
            path=True,
        ),
    ] = default(None)
    save_lights: Annotated[
        OptionalPath,
        About("Also write all lights: YAML or JSON, USD, or glTF.", path=True),
    ] = default(None)
    codec: Annotated[
        Literal["h264", "hevc", "prores", "dnxhr"] | None,
        About(
            "Codec of movies: h264 (.mp4), hevc (10 bits, .mp4), prores (.mov), dnxhr (HQX, 10 bits, without "
            "alpha, .mov). Default: h264 and prores; hevc for --hdr in an .mp4.",
        ),
    ] = None
    hdr: Annotated[
        Literal["hlg", "pq"] | None,
        About("Write movies in HLG or PQ, BT.2020, without compressing highlights. Default: BT.709."),
    ] = None
    report: Annotated[
        OptionalPath,
        About(
            "Also write what each frame is like, .json: certainty and area of the person, jumps of the area, "
            "frames that were averaged, a likely change of person.",
            path=True,
        ),
    ] = default(None)
    rate: Annotated[
        float | None,
        Interval(ge=0.01, le=1000),
        About(
            "Frame rate of movies, in frames per second. Default: the source's, or 24.",
            unit="frames a second",
        ),
    ] = None

    @property
    def needs_all_frames(self) -> bool:
        """Whether there is a file that can only be written once all frames are there."""
        from relight.media import movies  # which loads longer than `--help` may take
        from relight.scene import nuke

        whole = any(movies.is_movie(path) or nuke.is_script(path) for path in self.paths)
        return whole or self.report is not None or self.plot is not None


@dataclass(frozen=True)
class Compute(Options):
    """Where and how the networks run.

    Examples
    --------
    >>> compute = relight.Compute(device="cpu", precision="float32", threads=1)
    """

    device: Annotated[str | None, About("Device of the networks: cpu, cuda, cuda:1... Default: cpu.")] = None
    precision: Annotated[
        Literal["bfloat16", "float32"] | None,
        About("Precision of the networks: bfloat16 or float32. Default: the faster one on this processor."),
    ] = None
    threads: Annotated[
        int | None,
        Interval(ge=1, le=MAX_THREADS),
        About(
            "Number of CPU threads. With equal precision and threads, machines of one kind make "
            "bit-identical frames.",
        ),
    ] = None


GROUPS: dict[str, type[Options]] = {
    "source": Source,
    "lighting": Lighting,
    "output": Output,
    "compute": Compute,
}

# What functions take for options: the object, or the value that stands for it alone, see `Options.of`.
if TYPE_CHECKING:
    GivenSource: TypeAlias = Source | Picture
    GivenLighting: TypeAlias = Lighting | AnyLights
    GivenOutput: TypeAlias = Output | File | Iterable[File]
else:
    GivenSource = GivenLighting = GivenOutput = object
