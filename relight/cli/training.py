"""`relight train` and `relight shrink`: networks from records and cutouts."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from relight.cli.help import TRAIN
from relight.cli.options import console, with_options

if TYPE_CHECKING:
    from shadow.data.composites import PoseMask
    from shadow.training.recipes import Task


LEVELS = 5  # of the backbone that the one-pass networks share
ABLATIONS = {"baseline": "baseline", "none": None}  # --visibility, of Table 6


Network = Literal["shadow", "shading", "matting"]
Model = Literal["field", "resb3", "resb7", "resb11", "attention"]


@with_options(TRAIN)
def train(
    network: Network,
    records: Annotated[
        list[Path],
        typer.Option(help="Records or shards to train on; for matting, folders of cutouts. Repeatable."),
    ],
    out: Annotated[Path, typer.Option(help="Folder of the run; an existing run is resumed.")],
    model: Annotated[
        Model,
        typer.Option(
            metavar="<name>",
            help="field, our one-pass network, or the paper's per-light one by its latent: resb3, resb7, "
            "resb11, attention.",
        ),
    ] = "field",
    no_normals: Annotated[
        bool,
        typer.Option(
            "--no-normals", help="Train a per-light network without normals as input (Tables 3 and 6)."
        ),
    ] = False,
    no_depth: Annotated[
        bool,
        typer.Option("--no-depth", help="Train a field without the depth output (benchmarks/ablations.py)."),
    ] = False,
    blocks: Annotated[
        str | None,
        typer.Option(
            metavar="N,N,N,N,N",
            help="Residual blocks of each encoder level of a one-pass network, from half the resolution down "
            "(1,1,2,4,6). Blocks that --init lacks start as the identity.",
        ),
    ] = None,
    preset: Annotated[
        Literal["fast", "paper"],
        typer.Option(help="Defaults of the options under Recipe: our recipe, or the paper's."),
    ] = "fast",
    steps: Annotated[
        int | None, typer.Option(min=1, help="Mini-batches; with --preset paper, 31 epochs.")
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(min=0, help="Minutes of training, instead of --steps; the rate follows the clock."),
    ] = None,
    size: Annotated[
        int | None, typer.Option(help="Height of the canvas in pixels, a multiple of 128 (256; paper: 512).")
    ] = None,
    batch: Annotated[
        int | None, typer.Option(min=1, help="Photographs in a mini-batch (8; per-light: 2; paper: 1).")
    ] = None,
    lights: Annotated[
        int | None,
        typer.Option(min=1, help="Lights for each photograph (field: 20; per-light: 4; paper: 1)."),
    ] = None,
    learning_rate: Annotated[
        float | None, typer.Option(help="Peak learning rate (1e-3; per-light: 5e-4; paper: 5e-6).")
    ] = None,
    borders: Annotated[
        float | None,
        typer.Option(
            min=1,
            help="How much more often the losses sample pixels near borders of cast shadows (1).",
        ),
    ] = None,
    faces: Annotated[
        float | None,
        typer.Option(min=1, help="How much more often they sample pixels of faces and hands (1)."),
    ] = None,
    angles: Annotated[
        float | None, typer.Option(min=0, max=1, help="Share of the angle in the loss of the normals (0).")
    ] = None,
    average: Annotated[
        float | None,
        typer.Option(min=0, max=1, help="Decay of the moving average of the weights, per step (0.999)."),
    ] = None,
    warm_up: Annotated[
        int | None, typer.Option(min=0, help="Steps in which the rate rises to its peak (200; paper: 0).")
    ] = None,
    distil: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=1,
            help="Share of a field's loss that compares one pass with the mean of a photograph and of its "
            "mirror image by the field of --visibility (0).",
        ),
    ] = None,
    backdrops: Annotated[
        Path | None, typer.Option(help="Folder of photographs (JPEG) that are behind the cutouts of matting.")
    ] = None,
    pose_masks: Annotated[
        bool,
        typer.Option(
            "--pose-masks",
            help="Use the masks of the pose network of `relight fetch person` for most pictures of matting.",
        ),
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of photographs and weights.")] = 0,
    init: Annotated[
        Path | None,
        typer.Option(
            help="Weights to start from: of the same network, which may be less deep, or of another backbone."
        ),
    ] = None,
    normals: Annotated[
        str | None,
        typer.Option(
            help="Normals to train with: a field, a PIFuHD checkpoint, or true for those of the records "
            "(shadow: its own; shading and per-light networks: those of --visibility)."
        ),
    ] = None,
    visibility: Annotated[
        str,
        typer.Option(
            help="The field that shading and per-light networks take their input from; for per-light "
            "networks also baseline, sign(N·L), or none (Table 6)."
        ),
    ] = "field",
    validation: Annotated[
        list[Path] | None, typer.Option(help="Records or cutouts to score at each checkpoint. Repeatable.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Number of processes that make photographs.")
    ] = None,
    minutes: Annotated[float, typer.Option(min=0, help="Minutes between checkpoints.")] = 5,
) -> None:
    """Train a network, or continue a run that was interrupted."""
    from shadow.training.loop import fit
    from shadow.training.recipes import preset as recipe_of

    if (network == "matting") != (backdrops is not None):
        raise ValueError("--backdrops: expected with `train matting`, and only there")
    if pose_masks and backdrops is None:
        raise ValueError("--pose-masks: expected only with `train matting`")
    task = _task(network, model, not no_normals, visibility, not no_depth)
    for name, times, without in (("borders", borders, 1), ("faces", faces, 1), ("distil", distil, 0)):
        if times not in (None, without) and model != "field":
            raise ValueError(f"--{name}: expected a one-pass network (--model field), got {model}")
    if blocks is not None:
        if model != "field":
            raise ValueError(f"--blocks: expected a one-pass network (--model field), got {model}")
        task = replace(task, config=task.config | {"encoder": _levels(blocks)})
    recipe = recipe_of(
        preset, task, records, steps=steps, duration=duration, size=size, batch=batch, lights=lights,
        learning_rate=learning_rate, warm_up=warm_up, borders=borders, faces=faces, angles=angles,
        distil=distil, average=average, seed=seed,
    )  # fmt: skip
    if backdrops is not None:
        from shadow.training import matting

        scored = None if validation is None else matting.Sources(validation, backdrops)
        sources = matting.Sources(records, backdrops)
        path = matting.fit(
            recipe, sources, out, validation=scored, init=init,
            pose_mask=_pose_mask() if pose_masks else None,
            workers=1 if workers is None else workers, checkpoint_minutes=minutes,
        )  # fmt: skip
        console.print(f"{path}")
        return
    path = fit(
        task, recipe, records, out, validation=validation, init=init, estimator=normals,
        visibility="field" if visibility in ABLATIONS else visibility, workers=workers,
        checkpoint_minutes=minutes,
    )  # fmt: skip
    console.print(f"{path}")


def _pose_mask() -> "PoseMask":
    from relight.matting.people import files, pose_mask

    files.fetched()  # before the processes that compose pictures
    return pose_mask.mask_around


def _task(network: Network, model: Model, with_normals: bool, visibility: str, with_depth: bool) -> "Task":
    """Return the task of a training command."""
    from shading.tasks import SHADING, per_light_task
    from shadow.training.tasks import SHADOW, per_light

    one_pass = model == "field"
    if network == "matting":
        from shadow.training.matting import TASK

        if one_pass and with_normals and with_depth:
            return TASK
        raise ValueError("--model, --no-normals, --no-depth: expected none with `train matting`")
    if not with_depth:
        if network == "shadow" and one_pass and with_normals:
            return replace(SHADOW, config={"depth": False})
        raise ValueError(
            "--no-depth: expected `train shadow --model field`, the one network that infers depth"
        )
    if network == "shading":
        if not one_pass:
            return per_light_task(model, with_normals, ABLATIONS.get(visibility, "inferred"))
        if with_normals and visibility not in ABLATIONS:
            return SHADING
        raise ValueError("--no-normals, --visibility: Table 6 expects a per-light network (--model resb7)")
    if not one_pass:
        return per_light(model, with_normals)
    if with_normals:
        return SHADOW
    raise ValueError("--no-normals: expected a per-light network (--model), since a field infers normals")


def _levels(text: str) -> list[int]:
    """Parse the number of residual blocks of each level of a backbone."""
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
