"""The commands for those who train: records from the virtual light stage, training, evaluation.

Heavy modules are imported inside the commands, so that `relight --help` answers at once.
"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

console = Console(stderr=True)


def stage(
    records: Annotated[Path, typer.Argument(help="Folder of records, one file a view.")],
    bodies: Annotated[
        str | None, typer.Option(help="Render clothed bodies of these seeds: FIRST:LAST, last exclusive.")
    ] = None,
    pairs: Annotated[
        str | None, typer.Option(help="Render two people in touch, of these seeds: FIRST:LAST.")
    ] = None,
    split: Annotated[
        str, typer.Option(help="The bodies' and pairs' split: training, validation or generalisation.")
    ] = "training",
    scan: Annotated[
        list[Path] | None, typer.Option(help="Render this mesh or scan (OBJ, PLY, GLB). Repeatable.")
    ] = None,
    scan_list: Annotated[
        Path | None, typer.Option(help="Render the meshes that this text file names, one a line, beside it.")
    ] = None,
    variants: Annotated[
        str | None, typer.Option(help="Instead of each scan these of its variants: FIRST:LAST.")
    ] = None,
    views: Annotated[int, typer.Option(min=1, help="Views a figure.")] = 9,
    size: Annotated[int, typer.Option(min=16, help="Pixels of the image's side.")] = 512,
    behind: Annotated[bool, typer.Option(help="32 directions behind the subject too.")] = False,
    jitter: Annotated[bool, typer.Option(help="Vary camera height, distance and field of view.")] = False,
    portrait: Annotated[
        bool, typer.Option("--portrait", help="Jitter, and come close: the frame cuts the figure.")
    ] = False,
    shading: Annotated[
        bool, typer.Option(help="Trace the bounce light too, for path-traced shading.")
    ] = False,
    relief: Annotated[
        bool, typer.Option("--relief", help="Raise the folds that are only painted on a scan.")
    ] = False,
    processes: Annotated[int | None, typer.Option(min=1, help="Default: one a core.")] = None,
    pack: Annotated[
        Path | None, typer.Option(help="Then pack the records into shards of at most 60 MiB in this folder.")
    ] = None,
    sheet: Annotated[Path | None, typer.Option(help="Then draw a contact sheet of them (PNG).")] = None,
):
    """Render training records on the virtual light stage, pack them, or draw them for the eye."""
    from shadow.data import records as record_files
    from shadow.evaluation import pictures
    from shadow.lightstage.stage import Source, render_all

    if relief and (bodies is not None or pairs is not None):
        raise ValueError(
            "--relief: expected scans alone, since folds of --bodies and --pairs are not painted"
        )
    sources = [Source.body(seed, split) for seed in _seeds("--bodies", bodies)]
    sources += [Source.pair(seed, split) for seed in _seeds("--pairs", pairs)]
    meshes = list(scan or [])
    if scan_list is not None:
        names = scan_list.read_text().split("\n")
        meshes += [scan_list.parent / name.strip() for name in names if name.strip()]
    if variants is None:
        sources += [Source.scan(path) for path in meshes]
    elif meshes:
        sources += [Source.variant(path, n) for path in meshes for n in _seeds("--variants", variants)]
    else:
        raise ValueError("--variants: expected --scan or --scan-list with it, to make variants of")
    if sources:
        written, on_disk, errors = render_all(
            sources, records, views=views, size=size, behind=behind, jitter=jitter,
            portrait=portrait, bounced=shading, raised=relief, processes=processes,
        )  # fmt: skip
        console.print(f"{written} records, {on_disk // max(1, written)} bytes a view")
        for source, error in errors.items():
            console.print(f"{source}: {error}")
        if errors:
            raise typer.Exit(1)
    elif pack is None and sheet is None:
        raise ValueError("nothing to do: expected --bodies, --pairs, --scan, --scan-list, --pack or --sheet")
    if pack is not None:
        for path in record_files.pack(records, pack):
            console.print(f"{path}: {path.stat().st_size} bytes")
    if sheet is not None:
        pictures.contact_sheet([records], sheet)
        console.print(f"{sheet}")


def _seeds(option, text):
    if text is None:
        return range(0)
    first, _, last = text.partition(":")
    try:
        return range(int(first), int(last))
    except ValueError as error:
        raise ValueError(f"{option}: expected FIRST:LAST, e.g. 0:100, got {text!r}") from error


class Network(StrEnum):
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
        Path | None,
        typer.Option(help="Weights to start from: the same network's, maybe less deep, or another backbone."),
    ] = None,
    normals: Annotated[
        str | None,
        typer.Option(
            help="Normals to learn with: a field, a PIFuHD checkpoint; true: the records' own [shadow: its "
            "own; shading and per-light networks: those of --visibility]."
        ),
    ] = None,
    visibility: Annotated[
        str,
        typer.Option(
            help="The field that shading and per-light networks take their input from; baseline: sign(N·L); "
            "none (Table 6)."
        ),
    ] = "field",
    validation: Annotated[
        list[Path] | None, typer.Option(help="Records to score at each checkpoint. Repeatable.")
    ] = None,
    workers: Annotated[int | None, typer.Option(min=0, help="Processes that make photographs.")] = None,
    minutes: Annotated[float, typer.Option(min=0, help="Between checkpoints.")] = 5,
):
    """Train a network, or go on with a run that was interrupted."""
    from shadow.training import loop

    task = _task(network, model, not no_normals, visibility)
    recipe = loop.preset(
        preset, task, records, steps=steps, size=size, batch=batch, lights=lights,
        learning_rate=learning_rate, seed=seed,
    )  # fmt: skip
    path = loop.fit(
        task, recipe, records, out, validation=validation, init=init, estimator=normals,
        visibility="field" if visibility in ABLATIONS else visibility, workers=workers,
        checkpoint_minutes=minutes,
    )  # fmt: skip
    console.print(f"{path}")


def _task(network, model, with_normals, visibility):
    """What `train` trains."""
    from shading.tasks import per_light_task, shading_task
    from shadow.training.tasks import SHADOW, per_light

    one_pass = model is Model.field
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


def shrink(
    weights: Annotated[Path, typer.Argument(help="Weights that `train` wrote.")],
    out: Annotated[Path, typer.Argument(help="File to write, half as large.")],
):
    """Store a network's weights in 8 bits, to ship them."""
    from shadow.networks.checkpoints import shrink

    console.print(f"{out} sha256 {shrink(weights, out)}")


evaluate = typer.Typer(no_args_is_help=True, help="Score networks on records that they were not trained on.")

ScoredRecords = Annotated[list[Path], typer.Option(help="Records or shards to score on. Repeatable.")]
NormalsWeights = Annotated[
    str | None,
    typer.Option(help="Whose normals, if not the tested field's own: a name, or a file."),
]
LightingSeed = Annotated[int, typer.Option(help="Of the lightings the records are photographed under.")]
Limit = Annotated[int | None, typer.Option(min=1, help="Score this many records, spread evenly.")]


@evaluate.command("visibility")
def evaluate_visibility(
    records: ScoredRecords,
    model: Annotated[str, typer.Option(help="Visibility weights: a name, or a file.")] = "field",
    normals: NormalsWeights = None,
    seed: LightingSeed = 0,
    limit: Limit = None,
):
    """Print RMSE, PSNR and Dice of the visibility maps (Section 4.1) beside the sign(N·L) baselines."""
    from shadow.evaluation import scores

    found, angle = scores.evaluate(
        records, model=model, normals_model=normals, seed=seed, limit=limit
    )  # fmt: skip
    print(scores.report(found, angle))


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
    normals: NormalsWeights = None,
    seed: LightingSeed = 0,
    limit: Limit = None,
):
    """Write the paper's Tables 2 to 5 and Figures 2 and 4, measured on these records, beside its figures."""
    from shadow.evaluation import report

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
    normals: NormalsWeights = None,
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
