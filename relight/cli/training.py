"""`relight train` and `relight shrink`: networks from records.

Heavy modules are imported inside the command, so that `relight --help` answers at once.
"""

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from relight.cli.options import console

if TYPE_CHECKING:
    from shadow.training.recipes import Task


class Network(StrEnum):
    shadow = "shadow"
    shading = "shading"


LEVELS = 5  # of the backbone that the one-pass networks share
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
    no_depth: Annotated[
        bool, typer.Option("--no-depth", help="A field that says nothing of depth (benchmarks/ablations.py).")
    ] = False,
    blocks: Annotated[
        str | None,
        typer.Option(
            metavar="N,N,N,N,N",
            help="Residual blocks of a one-pass network's levels on the way down, half the resolution first "
            "[1,1,2,4,6]. Those that --init lacks begin as the identity.",
        ),
    ] = None,
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
    borders: Annotated[
        float | None,
        typer.Option(min=1, help="Times as often the losses look at pixels near borders of cast shadow [1]."),
    ] = None,
    faces: Annotated[
        float | None, typer.Option(min=1, help="Times as often they look at pixels of faces and hands [1].")
    ] = None,
    angles: Annotated[
        float | None, typer.Option(min=0, max=1, help="Share of the normals' loss that is their angle [0].")
    ] = None,
    average: Annotated[
        float | None, typer.Option(min=0, max=1, help="Decay a step of the average of the weights [0.999].")
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
) -> None:
    """Train a network, or go on with a run that was interrupted."""
    from shadow.training.loop import fit
    from shadow.training.recipes import preset as recipe_of

    task = _task(network, model, not no_normals, visibility, not no_depth)
    if blocks is not None:
        if model is not Model.field:
            raise ValueError(f"--blocks: expected a one-pass network (--model field), got {model}")
        task = replace(task, config=task.config | {"encoder": _levels(blocks)})
    recipe = recipe_of(
        preset, task, records, steps=steps, size=size, batch=batch, lights=lights,
        learning_rate=learning_rate, borders=borders, faces=faces, angles=angles, average=average, seed=seed,
    )  # fmt: skip
    path = fit(
        task, recipe, records, out, validation=validation, init=init, estimator=normals,
        visibility="field" if visibility in ABLATIONS else visibility, workers=workers,
        checkpoint_minutes=minutes,
    )  # fmt: skip
    console.print(f"{path}")


def _task(
    network: Network, model: Model, with_normals: bool, visibility: str, with_depth: bool = True
) -> "Task":
    """What `train` trains."""
    from shading.tasks import per_light_task, shading_task
    from shadow.training.tasks import SHADOW, per_light

    one_pass = model is Model.field
    if not with_depth:
        if network is Network.shadow and one_pass and with_normals:
            return replace(SHADOW, config={"depth": False})
        raise ValueError(
            "--no-depth: expected `train shadow --model field`, the one network that infers depth"
        )
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


def _levels(text: str) -> list[int]:
    """The residual blocks of each level of a backbone, of an option's text."""
    parts = text.split(",")
    if len(parts) != LEVELS or not all(part.strip().isdecimal() and int(part) > 0 for part in parts):
        raise ValueError(f"--blocks: expected {LEVELS} numbers above 0, such as 1,1,2,4,6, got {text!r}")
    return [int(part) for part in parts]


def shrink(
    weights: Annotated[Path, typer.Argument(help="Weights that `train` wrote.")],
    out: Annotated[Path, typer.Argument(help="File to write, half as large.")],
) -> None:
    """Store a network's weights in 8 bits, to ship them."""
    from shadow.networks.checkpoints import shrink

    console.print(f"{out} sha256 {shrink(weights, out)}")
