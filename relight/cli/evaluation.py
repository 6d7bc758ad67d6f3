"""`relight evaluate`: networks scored on records that they were not trained on."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from relight.cli.help import EXAMPLES, PlainCommand, PlainGroup
from relight.cli.options import console

evaluate = typer.Typer(
    cls=PlainGroup,
    name="evaluate",
    no_args_is_help=True,
    help=f"Score networks on records that they were not trained on.\n\n{EXAMPLES['evaluate']}",
)


ScoredRecords = Annotated[list[Path], typer.Option(help="Records or shards to score on. Repeatable.")]
NormalsWeights = Annotated[
    str | None,
    typer.Option(help="Normals network: a name, or a file. Default: the tested field's own normals."),
]
LightingSeed = Annotated[int, typer.Option(help="Seed of the random lightings of the photographs.")]
Limit = Annotated[int | None, typer.Option(min=1, help="Score this many records, spread evenly.")]


@evaluate.command("visibility", cls=PlainCommand)
def evaluate_visibility(
    records: ScoredRecords,
    model: Annotated[str, typer.Option(help="Visibility weights: a name, or a file.")] = "field",
    normals: NormalsWeights = None,
    seed: LightingSeed = 0,
    limit: Limit = None,
    light: Annotated[
        Literal["hard", "sky", "any"] | None,
        typer.Option(help="Photograph the records in everyday light of this kind instead of a mixture."),
    ] = None,
) -> None:
    """Print RMSE, PSNR and Dice of the visibility maps (Section 4.1) beside the sign(N·L) baselines."""
    from shadow.evaluation import scores

    found, angle = scores.evaluate(
        records, model=model, normals_model=normals, seed=seed, limit=limit, light=light
    )
    print(scores.report(found, angle))


@evaluate.command("depth", cls=PlainCommand)
def evaluate_depth(
    records: ScoredRecords,
    model: Annotated[str, typer.Option(help="Visibility weights: a name, or a file.")] = "field",
    seed: LightingSeed = 0,
    limit: Limit = None,
) -> None:
    """Print the error of depth, in per cent of the height, and of its order at the borders of limbs."""
    from shadow.evaluation import depth

    print(depth.report(depth.evaluate(records, model=model, seed=seed, limit=limit)))


@evaluate.command("regions", cls=PlainCommand)
def evaluate_regions(
    records: ScoredRecords,
    model: Annotated[str, typer.Option(help="Visibility weights: a name, or a file.")] = "field",
    normals: NormalsWeights = None,
    seed: LightingSeed = 0,
    limit: Limit = None,
) -> None:
    """Print the error of normals and cast shadows on faces and hands, beside that of the whole body."""
    from shadow.evaluation import regions

    print(
        regions.report(regions.evaluate(records, model=model, normals_model=normals, seed=seed, limit=limit))
    )


@evaluate.command("tables", cls=PlainCommand)
def evaluate_tables(
    records: ScoredRecords,
    out: Annotated[Path, typer.Option(help="Folder for report.md, report.json and their pictures.")],
    model: Annotated[
        list[str] | None,
        typer.Option(
            help="A network, as NAME=FILE. Names: ours (instead of the shipped field), without-normals, "
            "mixed, resb3, resb7, resb11, attention, or any other for a further row of Table 2. Repeatable."
        ),
    ] = None,
    soft: Annotated[
        Path | None,
        typer.Option(help="Folder of another method's soft maps, <record>_<light>.png or .npy (Table 5)."),
    ] = None,
    normals: NormalsWeights = None,
    seed: LightingSeed = 0,
    limit: Limit = None,
) -> None:
    """Measure the paper's Tables 2 to 5 and Figures 2 and 4 on these records, beside the paper's values."""
    from shadow.evaluation import report

    path = report.write(
        records, out, models=_named(model), normals_model=normals, soft=soft, seed=seed, limit=limit
    )
    console.print(f"{path}")


@evaluate.command("shading", cls=PlainCommand)
def evaluate_shading(
    records: ScoredRecords,
    model: Annotated[
        list[str] | None,
        typer.Option(
            help="A network, as ROW=FILE. Rows of Table 6: ours (instead of the shipped one), w/o normals, "
            "w/o visibility, w/o both, baseline visibility; or any other. Repeatable."
        ),
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="Also write Figure 6 to this PNG.")] = None,
    normals: NormalsWeights = None,
    field: Annotated[str, typer.Option(help="Visibility weights: a name, or a file.")] = "field",
    seed: LightingSeed = 0,
    limit: Limit = None,
) -> None:
    """Print Table 6 (RMSE and SSIM of the shading, compared with path tracing) and the albedo's errors."""
    from shading import evaluation

    tallies, delights = evaluation.evaluate(
        records, models=_named(model), out=figure, normals_model=normals, field_model=field, seed=seed,
        limit=limit,
    )  # fmt: skip
    print(evaluation.report(tallies, delights))


@evaluate.command("albedo", cls=PlainCommand)
def evaluate_albedo(
    records: ScoredRecords,
    model: Annotated[str, typer.Option(help="Shading weights: a name, or a file.")] = "shading",
    field: Annotated[str, typer.Option(help="Visibility weights: a name, or a file.")] = "field",
    seed: LightingSeed = 0,
    limit: Limit = None,
) -> None:
    """Print the fraction of pixels with an implausible albedo: above 0.9, or more colourful in shadow."""
    from shading import excess

    print(excess.report(excess.evaluate(records, model=model, field_model=field, seed=seed, limit=limit)))


def _named(texts: list[str] | None) -> dict[str, str]:
    """NAME=FILE options as a dictionary."""
    models = {}
    for text in texts or []:
        name, _, file = text.partition("=")
        if not file or name in models:
            raise ValueError(f"--model: expected NAME=FILE, each name once, got {text!r}")
        models[name] = file
    return models
