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
    light: Annotated[
        list[str] | None,
        typer.Option(
            help="A light, as key:azimuth=-40,elevation=30,intensity=2,colour=1/0.9/0.8; also "
            "direction=x/y/z, exposure (stops), temperature (kelvin), locus (planckian, daylight), angle "
            "(degrees, soft). Repeatable."
        ),
    ] = None,
    environment: Annotated[
        list[str] | None,
        typer.Option(
            help="Light from a latitude-longitude map, as studio.exr,rotation=90,intensity=2; its centre is "
            "at the camera. Repeatable."
        ),
    ] = None,
    lights: Annotated[Path | None, typer.Option(help="A lights file, YAML or JSON.")] = None,
    save_lights: Annotated[
        Path | None, typer.Option(help="Write all these lights to a lights file, for next time.")
    ] = None,
    mask: Annotated[Path | None, typer.Option(help="The matte, unless the image has alpha.")] = None,
    key: Annotated[
        Screen | None,
        typer.Option(help="Cut the person out of a screen; a mask then says where there is one."),
    ] = None,
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
    colour_space: Annotated[
        str | None,
        typer.Option(
            help="The photograph's, if its file does not say: sRGB, lin_rec709, ACEScg, Rec.2020..."
        ),
    ] = None,
    layers: Annotated[
        str | None,
        typer.Option(help="More layers of the .exr: any of albedo,N,visibility,shading."),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(
            help="View transform of PNG, JPEG and TIFF, e.g. aces, from OpenColorIO's built-in configuration "
            "or $OCIO. Without one they are sRGB, with highlights rolled off."
        ),
    ] = None,
    exposure: Annotated[float, typer.Option(help="Of PNG, JPEG and TIFF, in stops.")] = 0.0,
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
    from relight import image as images
    from relight import nuke
    from relight.colour import find_view
    from relight.composite import render
    from relight.lightfile import write_lights

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
        from relight.matte import key as cut_out

        plate, matte = cut_out(plate, key, mask=matte), None
    backdrop = None if background in (None, ENVIRONMENT) else _background(background)
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
    from relight.environment import EnvironmentLight
    from relight.lightfile import read_lights
    from relight.lights import DirectionalLight

    lighting = [] if path is None else read_lights(path)
    lighting += [DirectionalLight.parse(text) for text in lights or []]
    lighting += [EnvironmentLight.parse(text) for text in environments or []]
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
    from relight.environment import EnvironmentLight

    skies = [light for light in lighting if isinstance(light, EnvironmentLight)]
    if not skies:
        raise ValueError("--background environment: expected an environment among the lights")
    return sum(sky.view(size, field_of_view) for sky in skies)


def _background(text):
    """An image's path, or a colour as r/g/b."""
    from relight import image as images

    try:
        return tuple(map(float, text.split("/")))
    except ValueError:
        return images.read(text)


def _normals(path, axes):
    """Normals that a file holds, or a network in it makes."""
    from relight import image as images
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
    colour_space: Annotated[
        str | None,
        typer.Option(help="The photograph's, if its file does not say: sRGB, lin_rec709, ACEScg..."),
    ] = None,
):
    """Write the person in IMAGE in one light at a time, from 64 directions, and a file of the directions."""
    from relight import image as images
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
def stage(
    records: Annotated[Path, typer.Argument(help="Folder of records, one file a view.")],
    bodies: Annotated[
        str | None, typer.Option(help="Render clothed bodies of these seeds: FIRST:LAST, last exclusive.")
    ] = None,
    split: Annotated[
        str, typer.Option(help="The bodies' split: training, validation or generalisation.")
    ] = "training",
    scan: Annotated[
        list[Path] | None, typer.Option(help="Render this mesh or scan (OBJ, PLY, GLB). Repeatable.")
    ] = None,
    scan_list: Annotated[
        Path | None, typer.Option(help="Render the meshes that this text file names, one a line, beside it.")
    ] = None,
    views: Annotated[int, typer.Option(min=1, help="Views a figure.")] = 9,
    size: Annotated[int, typer.Option(min=16, help="Pixels of the image's side.")] = 512,
    behind: Annotated[bool, typer.Option(help="32 directions behind the subject too.")] = False,
    jitter: Annotated[bool, typer.Option(help="Vary camera height, distance and field of view.")] = False,
    shading: Annotated[
        bool, typer.Option(help="Trace the bounce light too, for path-traced shading.")
    ] = False,
    processes: Annotated[int | None, typer.Option(min=1, help="Default: one a core.")] = None,
    pack: Annotated[
        Path | None, typer.Option(help="Then pack the records into shards of at most 60 MiB in this folder.")
    ] = None,
    sheet: Annotated[Path | None, typer.Option(help="Then draw a contact sheet of them (PNG).")] = None,
):
    """Render training records on the virtual light stage, pack them, or draw them for the eye."""
    from shadow import pictures
    from shadow import records as record_files
    from shadow.lightstage.stage import render_all

    sources = [] if bodies is None else list(_seeds(bodies))
    sources += [str(path) for path in scan or []]
    if scan_list is not None:
        names = scan_list.read_text().split("\n")
        sources += [str(scan_list.parent / name.strip()) for name in names if name.strip()]
    if sources:
        written, on_disk, errors = render_all(
            sources, records, split=split, views=views, size=size, behind=behind, jitter=jitter,
            bounced=shading, processes=processes,
        )  # fmt: skip
        console.print(f"{written} records, {on_disk // max(1, written)} bytes a view")
        for source, error in errors.items():
            console.print(f"{source}: {error}")
        if errors:
            raise typer.Exit(1)
    elif pack is None and sheet is None:
        raise ValueError("nothing to do: expected --bodies, --scan, --scan-list, --pack or --sheet")
    if pack is not None:
        for path in record_files.pack(records, pack):
            console.print(f"{path}: {path.stat().st_size} bytes")
    if sheet is not None:
        pictures.contact_sheet([records], sheet)
        console.print(f"{sheet}")


def _seeds(text):
    first, _, last = text.partition(":")
    try:
        return range(int(first), int(last))
    except ValueError as error:
        raise ValueError(f"--bodies: expected FIRST:LAST, e.g. 0:100, got {text!r}") from error


class Network(StrEnum):
    normals = "normals"
    shadow = "shadow"
    shading = "shading"


ABLATIONS = {"baseline": "baseline", "none": None}  # --visibility, of Table 6


class Model(StrEnum):
    field = "field"
    resb3 = "resb3"
    resb7 = "resb7"
    resb11 = "resb11"
    attention = "attention"


class Preset(StrEnum):
    fast = "fast"
    paper = "paper"


@app.command()
def train(
    network: Network,
    records: Annotated[list[Path], typer.Option(help="Records or shards to train on. Repeatable.")],
    out: Annotated[Path, typer.Option(help="Folder of the run; a run found there is resumed.")],
    model: Annotated[
        Model, typer.Option(help="Our one-pass field, or the paper's per-light network by latent.")
    ] = Model.field,
    no_normals: Annotated[
        bool, typer.Option("--no-normals", help="A network that sees no normals (Tables 3 and 6).")
    ] = False,
    preset: Annotated[
        Preset, typer.Option(help="Where the options below start from: our recipe, or the paper's.")
    ] = Preset.fast,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Mini-batches in all; --preset paper: 31 epochs.")
    ] = None,
    size: Annotated[
        int | None, typer.Option(help="Height of the canvas in pixels, a multiple of 128 [256; paper: 512].")
    ] = None,
    batch: Annotated[
        int | None, typer.Option(min=1, help="Photographs a mini-batch [8; per-light: 2; paper: 1].")
    ] = None,
    lights: Annotated[
        int | None, typer.Option(min=1, help="Lights a photograph [field: 20; per-light: 4; paper: 1].")
    ] = None,
    learning_rate: Annotated[
        float | None, typer.Option(help="At its peak [1e-3; per-light: 5e-4; paper: 5e-6].")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of photographs and weights.")] = 0,
    init: Annotated[
        Path | None, typer.Option(help="Weights to start from: the same network's, or another's backbone.")
    ] = None,
    normals: Annotated[
        str,
        typer.Option(
            help="The normals network that shadow and shading take their input from; true: the records' own."
        ),
    ] = "normals",
    visibility: Annotated[
        str,
        typer.Option(
            help="The field that shading takes its input from; baseline: sign(N·L); none (Table 6)."
        ),
    ] = "field",
    validation: Annotated[
        list[Path] | None, typer.Option(help="Records to score at each checkpoint. Repeatable.")
    ] = None,
    workers: Annotated[int | None, typer.Option(min=0, help="Processes that make photographs.")] = None,
    minutes: Annotated[float, typer.Option(min=0, help="Between checkpoints.")] = 5,
):
    """Train a network, or go on with a run that was interrupted."""
    from shadow import training

    task = _task(network, model, not no_normals, visibility)
    recipe = training.preset(
        preset, task, records, steps=steps, size=size, batch=batch, lights=lights,
        learning_rate=learning_rate, seed=seed,
    )  # fmt: skip
    path = training.fit(
        task, recipe, records, out, validation=validation, init=init, estimator=normals,
        visibility="field" if visibility in ABLATIONS else visibility, workers=workers,
        checkpoint_minutes=minutes,
    )  # fmt: skip
    console.print(f"{path}")


def _task(network, model, with_normals, visibility):
    """What `train` trains."""
    from shading.training import per_light_task, shading_task
    from shadow.training import NORMALS, SHADOW, per_light

    one_pass = model is Model.field
    if network is Network.normals and one_pass and with_normals:
        return NORMALS
    if network is Network.shading and one_pass:
        return shading_task(with_normals, ABLATIONS.get(visibility, "inferred"))
    if network is Network.shading and with_normals and visibility not in ABLATIONS:
        return per_light_task(model.value)
    if network is Network.shadow and one_pass and with_normals:
        return SHADOW
    if network is Network.shadow and not one_pass:
        return per_light(model.value, with_normals)
    raise ValueError(
        f"train {network}: there is no such network with these of --model, --no-normals and --visibility"
    )


evaluate = typer.Typer(no_args_is_help=True, help="Score networks on records that they were not trained on.")
app.add_typer(evaluate, name="evaluate")

ScoredRecords = Annotated[list[Path], typer.Option(help="Records or shards to score on. Repeatable.")]
NormalsWeights = Annotated[str, typer.Option(help="Normals weights: a name, or a file.")]
LightingSeed = Annotated[int, typer.Option(help="Of the lightings the records are photographed under.")]
Limit = Annotated[int | None, typer.Option(min=1, help="Score this many records, spread evenly.")]


@evaluate.command("visibility")
def evaluate_visibility(
    records: ScoredRecords,
    model: Annotated[str, typer.Option(help="Visibility weights: a name, or a file.")] = "field",
    normals: NormalsWeights = "normals",
    seed: LightingSeed = 0,
    limit: Limit = None,
):
    """Print RMSE, PSNR and Dice of the visibility maps (Section 4.1) beside the sign(N·L) baselines."""
    from shadow import evaluation

    scores, angle = evaluation.evaluate(
        records, model=model, normals_model=normals, seed=seed, limit=limit
    )  # fmt: skip
    print(evaluation.report(scores, angle))


@evaluate.command("tables")
def evaluate_tables(
    records: ScoredRecords,
    out: Annotated[Path, typer.Option(help="Folder for report.md, report.json and their pictures.")],
    model: Annotated[
        list[str] | None,
        typer.Option(
            help="A network, as NAME=FILE. Names: ours (instead of the shipped field), without-normals, "
            "mixed, resb3, resb7, resb11, attention, or any other for a row more of Table 2. Repeatable."
        ),
    ] = None,
    soft: Annotated[
        Path | None,
        typer.Option(help="Folder of another method's soft maps, <record>_<light>.png or .npy (Table 5)."),
    ] = None,
    normals: NormalsWeights = "normals",
    seed: LightingSeed = 0,
    limit: Limit = None,
):
    """Write the paper's Tables 2 to 5 and Figures 2 and 4, measured on these records, beside its figures."""
    from shadow import report

    path = report.write(
        records, out, models=_named(model), normals_model=normals, soft=soft, seed=seed, limit=limit
    )
    console.print(f"{path}")


@evaluate.command("shading")
def evaluate_shading(
    records: ScoredRecords,
    model: Annotated[
        list[str] | None,
        typer.Option(
            help="A network, as ROW=FILE. Rows of Table 6: ours (instead of the shipped one), w/o normals, "
            "w/o visibility, w/o both, baseline visibility; or any other. Repeatable."
        ),
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="PNG to draw Figure 6 into.")] = None,
    normals: NormalsWeights = "normals",
    field: Annotated[str, typer.Option(help="Visibility weights: a name, or a file.")] = "field",
    seed: LightingSeed = 0,
    limit: Limit = None,
):
    """Print Table 6: RMSE and SSIM of the shading against path-traced truth; and the albedo's errors."""
    from shading import evaluation

    tallies, delights = evaluation.evaluate(
        records, models=_named(model), out=figure, normals_model=normals, field_model=field, seed=seed,
        limit=limit,
    )  # fmt: skip
    print(evaluation.report(tallies, delights))


def _named(texts):
    """NAME=FILE options as a dictionary."""
    models = {}
    for text in texts or []:
        name, _, file = text.partition("=")
        if not file or name in models:
            raise ValueError(f"--model: expected NAME=FILE, each name once, got {text!r}")
        models[name] = file
    return models


if __name__ == "__main__":
    app()
