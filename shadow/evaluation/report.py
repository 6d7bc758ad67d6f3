"""The paper's tables and figures on any records, as a Markdown report beside its figures in JSON."""

import json
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch
from torch import nn

from shadow import visibility
from shadow.data.records import Records
from shadow.evaluation import plots, scores
from shadow.evaluation.scores import ESTIMATED, TRUE, Score, View
from shadow.files import replacing
from shadow.framing import canvas_size
from shadow.networks import checkpoints
from shadow.networks.unet import LATENTS, PerLight
from shadow.training.loop import TRUE_NORMALS

LEVELS = 10 ** np.arange(-6, 2.1, 0.5)  # of Figure 4: from all black, in 8 bits, to all white
LEVELS_VIEWS = 20  # that Figure 4 looks at, each at every level
REPEATS = 5  # of what is timed

Row = dict[str, Any]  # of a table, as JSON holds it

# What the paper prints, measured on its own data and an RTX 2080.
BASELINE, OURS = Score((0.432, 0.056), (0.834, 0.049)), Score((0.313, 0.051), (0.881, 0.041))
WITHOUT_NORMALS, MIXED = Score((0.334, 0.054), (0.867, 0.045)), Score((0.352, 0.053), (0.862, 0.044))
LATENT = {  # milliseconds, millions of parameters, score
    "resb3": (11.9, 24.8, Score((0.318, 0.053), (0.879, 0.042))),
    "resb7": (14.2, 45.8, OURS),
    "resb11": (15.7, 83.5, Score((0.315, 0.052), (0.879, 0.041))),
    "attention": (15.9, 39.0, Score((0.322, 0.053), (0.876, 0.042))),
}
RELIGHTING4D = {  # theirs (Relighting4D), ours, on subjects of the People Snapshot Dataset
    "f1c": (Score((0.404, 0.086), (0.849, 0.095)), Score((0.423, 0.088), (0.815, 0.114))),
    "f3c": (Score((0.401, 0.093), (0.854, 0.095)), Score((0.434, 0.096), (0.812, 0.120))),
    "f4c": (Score((0.403, 0.087), (0.848, 0.096)), Score((0.425, 0.094), (0.812, 0.124))),
    "m5s": (Score((0.429, 0.102), (0.824, 0.119)), Score((0.466, 0.096), (0.777, 0.136))),
}


def write(
    paths: Iterable[str | Path],
    out: str | Path,
    *,
    models: Mapping[str, str | Path] | None = None,
    normals_model: str | Path | None = None,
    soft: str | Path | None = None,
    seed: int = 0,
    limit: int | None = None,
) -> Path:
    """Write `out`/report.md, report.json, figure-2.png and figure-4.png.

    Parameters
    ----------
    paths: record folders or shards.
    out: folder, made if it is not there.
    models: {name: shipped name or .safetensors path}. "ours" (the shipped field unless given) is the network
        of Tables 2, 3 and 5 and of the figures; "without-normals" and "mixed" are the rows of Table 3;
        "resb3", "resb7", "resb11", "attention" those of Table 4; any other name is a row more of Table 2.
    normals_model: whose normals all of them are tested with, see `evaluation.normals_of`; those of "ours" if
        None.
    soft: folder of another method's soft maps for Table 5, see `evaluation.against_soft_maps`.
    seed: of the lightings the records are photographed under. limit: use this many records, spread evenly.

    Returns
    -------
    The path of report.md.

    Raises
    ------
    FileNotFoundError, ValueError: no records, damaged weights, a network that is not what its row says, soft
        maps that fit no record.
    """
    models = {"ours": "field", **(models or {})}
    records = Records(paths)
    networks = {name: visibility.load(model) for name, model in models.items()}
    for name, network in networks.items():
        _check(name, network, models[name])
    ours, out = networks["ours"], Path(out)
    surface = scores.normals_of(ours, normals_model)
    out.mkdir(parents=True, exist_ok=True)

    table_5 = _table_5(records, soft, ours, surface, seed, limit) if soft else []  # bad maps show at once
    tallies, angle = scores.compare(records, networks, surface, seed=seed, limit=limit)
    scored = {name: tally.score() for name, tally in tallies.items()}
    figures = {
        "records": [str(path) for path in paths],
        "views": len(records.spread(limit or len(records))),
        "maps": len(tallies["ours"].rmse),
        "seed": seed,
        "canvas": canvas_size(ours.size),
        "models": {name: str(model) for name, model in models.items()},
        "normals": str(normals_model or surface.origin.name),
        "normals_error": angle,  # degrees
        "device": torch.cuda.get_device_name() if torch.cuda.is_available() else "a CPU",
        "threads": torch.get_num_threads(),
        "table2": _table_2(scored),
        "table3": _table_3(scored),
        "table4": _table_4(scored, networks, View.of(records[0], (seed, 0), ours.size)),
        "table5": table_5,
        "figure2": _figure_2(out / "figure-2.png", tallies["ours"]),
        "figure4": _figure_4(out / "figure-4.png", records, ours, surface, seed, limit),
    }
    texts = {
        "report.json": json.dumps(figures, indent=1, ensure_ascii=False) + "\n",
        "report.md": _markdown(figures),
    }
    for name, text in texts.items():
        with replacing(out / name) as beside:
            beside.write_text(text)
    return out / "report.md"


def _check(name: str, network: nn.Module, model: str | Path) -> None:
    """Refuse a network whose file says that it is not what its row claims."""
    if name in LATENTS:
        fits = isinstance(network, PerLight) and network.latent == name and network.normals
    elif name == "without-normals":
        fits = isinstance(network, PerLight) and not network.normals
    elif name == "mixed":
        path = str(model)
        metadata = checkpoints.read(path)[1] if path.endswith(".safetensors") else {}
        fits = json.loads(metadata.get("recipe", "{}")).get("normals") == TRUE_NORMALS
    else:
        fits = True
    if not fits:
        raise ValueError(f"model: {model} was not trained as {name!r} says")


def _plain(score: Score | None) -> dict[str, Any] | None:
    """A Score for JSON; None if there is none."""
    return None if score is None else {"rmse": score.rmse, "psnr": score.psnr, "dice": score.dice}


def _row(variant: str, score: Score | None, paper: Score | None = None, **cells: Any) -> Row:
    return {"variant": variant, **cells, "measured": _plain(score), "paper": _plain(paper)}


def _table_2(scored: dict[str, Score]) -> list[Row]:
    own_rows = {"ours", "without-normals", "mixed", ESTIMATED, TRUE, *LATENTS}
    return [
        _row("baseline: " + ESTIMATED, scored[ESTIMATED], BASELINE),
        _row("baseline: " + TRUE, scored[TRUE]),
        _row("ours", scored["ours"], OURS),
        *(_row(name, score) for name, score in scored.items() if name not in own_rows),
    ]


def _table_3(scored: dict[str, Score]) -> list[Row]:
    return [
        _row("w/o normals", scored.get("without-normals"), WITHOUT_NORMALS, training="–", inference="–"),
        _row("mixed", scored.get("mixed"), MIXED, training="true", inference="estimated"),
        _row("ours", scored["ours"], OURS, training="estimated", inference="estimated"),
    ]


def _table_4(scored: dict[str, Score], networks: dict[str, nn.Module], view: View) -> list[Row]:
    """Time and size of each latent, trained or not, and of ours: the network alone, on one canvas."""
    candidates = {name: networks.get(name) or PerLight(latent=name).eval() for name in LATENTS}
    rows = []
    for name, network in (candidates | {"ours": networks["ours"]}).items():
        paper_milliseconds, paper_millions, paper = LATENT.get(name, (None, None, None))
        cells = {
            "milliseconds": _milliseconds(network, view, view.lights[:1]),
            "millions": sum(parameter.numel() for parameter in network.parameters()) / 1e6,
            "paper_milliseconds": paper_milliseconds,
            "paper_millions": paper_millions,
        }
        rows.append(_row(name, scored.get(name), paper, **cells))
    rows[-1]["milliseconds_all"] = _milliseconds(networks["ours"], view, view.lights)
    return rows


def _table_5(
    records: Records,
    folder: str | Path,
    network: nn.Module,
    surface: Any,
    seed: int,
    limit: int | None,
) -> list[Row]:
    pairs = scores.against_soft_maps(records, folder, network, surface, seed=seed, limit=limit)
    return [
        {"subject": subject, "theirs": _plain(theirs.score()), "ours": _plain(ours.score())}
        for subject, (theirs, ours) in pairs.items()
    ]


def _figure_2(path: Path, tally: scores.Tally) -> Row:
    lights, mean, deviation = tally.by_light()
    plots.hemispheres(path, lights, {"mean RMSE": mean, "standard deviation": deviation})
    return {"lights": lights.tolist(), "mean": mean.tolist(), "deviation": deviation.tolist()}


def _figure_4(path: Path, records: Records, network: Any, surface: Any, seed: int, limit: int | None) -> Row:
    views = min(limit or len(records), LEVELS_VIEWS, len(records))
    tallies = scores.intensity_sweep(records, network, surface, LEVELS, seed=seed, limit=views)
    names, columns = ("ours", ESTIMATED), zip(*tallies, strict=True)
    dice = {name: [t.score().dice for t in column] for name, column in zip(names, columns, strict=True)}
    series = {name: (np.array(pairs)[:, 0], np.array(pairs)[:, 1]) for name, pairs in dice.items()}
    plots.curves(path, LEVELS, series, "intensity of the input (1: a normal exposure)", "Dice")
    return {"views": views, "levels": LEVELS.tolist(), "dice": dice}


def _milliseconds(network: Any, view: View, lights: torch.Tensor) -> float:
    network.to(view.rgb.device, memory_format=torch.channels_last)
    times = []
    for _ in range(1 + REPEATS):  # the first allocates
        start = time.perf_counter()
        network.analyse(view.rgb, view.mask, view.normals)[1](lights).sum().item()  # waits for a GPU
        times.append(1000 * (time.perf_counter() - start))
    return median(times[1:])


def _cells(score: dict[str, Any] | None, psnr: bool = False, none: str = "–") -> list[str]:
    """The cells of a score, or of none."""
    if score is None:
        return [none, *["–"] * (1 + psnr)]
    rmse, dice = ("{:.3f} ({:.3f})".format(*score[metric]) for metric in ("rmse", "dice"))
    return [rmse, f"{score['psnr']:.2f}", dice] if psnr else [rmse, dice]


def _scores(row: Row, psnr: bool = False) -> list[str]:
    return [*_cells(row["measured"], psnr, none="not trained"), *_cells(row["paper"], psnr)]


def _table(header: list[str], rows: Iterable[list[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _lines_of_table_4(rows: list[Row]) -> Iterator[list[str]]:
    for row in rows:
        own, paper = (
            ["–" if row[key] is None else f"{row[key]:.1f}" for key in keys]
            for keys in (("milliseconds", "millions"), ("paper_milliseconds", "paper_millions"))
        )
        measured = _cells(row["measured"], none="not trained")
        yield [row["variant"], *own, *measured, *paper, *_cells(row["paper"])]


def _lines_of_table_5(rows: list[Row]) -> Iterator[list[str]]:
    paper = [
        {"subject": f"paper: {subject}", "theirs": _plain(theirs), "ours": _plain(ours)}
        for subject, (theirs, ours) in RELIGHTING4D.items()
    ]
    for row in [*rows, *paper]:
        theirs, ours = _cells(row["theirs"]), _cells(row["ours"])
        yield [row["subject"], theirs[0], ours[0], theirs[1], ours[1]]


def _tables(figures: Row) -> tuple[str, str, str, str]:
    """Tables 2 to 5 as Markdown."""
    header = ["ms ↓", "params, M ↓", "RMSE ↓", "Dice ↑"]
    paper = ["paper: ms", "paper: params, M", "paper: RMSE", "paper: Dice"]
    return (
        _table(
            ["variant", "RMSE ↓", "PSNR ↑", "Dice ↑", "paper: RMSE", "paper: PSNR", "paper: Dice"],
            [[row["variant"], *_scores(row, psnr=True)] for row in figures["table2"]],
        ),
        _table(
            ["variant", "training", "inference", "RMSE ↓", "Dice ↑", "paper: RMSE", "paper: Dice"],
            [[row["variant"], row["training"], row["inference"], *_scores(row)] for row in figures["table3"]],
        ),
        _table(["variant", *header, *paper], _lines_of_table_4(figures["table4"])),
        _table(
            ["subject", "RMSE ↓, theirs", "RMSE ↓, ours", "Dice ↑, theirs", "Dice ↑, ours"],
            _lines_of_table_5(figures["table5"]),
        ),
    )


def _markdown(figures: Row) -> str:
    """The report, of what report.json holds alone."""
    table_2, table_3, table_4, table_5 = _tables(figures)
    models = ", ".join(f"{name} is `{model}`" for name, model in figures["models"].items())
    height, width = figures["canvas"]
    soft = "Theirs made binary by Otsu's threshold." if figures["table5"] else "No soft maps were given."
    return f"""# Self-shadow maps, scored as in the paper

{figures["views"]} views of {", ".join(figures["records"])}, each photographed once under a random lighting
(seed {figures["seed"]}) and asked for its frontal lights: {figures["maps"]} maps on a canvas of
{height} × {width}. Here {models}. Estimated normals are those of `{figures["normals"]}`, off by
{figures["normals_error"]:.1f} degrees. Maps are binary, metrics masked (Section 4.1), figures the mean
(standard deviation) over maps. The paper's columns are what it prints for its own data, which is not public.
All figures are in [report.json](report.json).

## Table 2: against the baseline

{table_2}

## Table 3: surface normals

{table_3}

## Table 4: latent transformations

{table_4}

Time: one light on that canvas, the network alone, on {figures["device"]} (threads: {figures["threads"]});
the paper's is for 512 × 512 on an RTX 2080. Ours answers for all {len(figures["figure2"]["lights"])} lights
in {figures["table4"][-1]["milliseconds_all"]:.1f} ms.

## Figure 2: error over the frontal hemisphere

![Mean and standard deviation of the RMSE for each light direction](figure-2.png)

Seen from the camera, x right and y up: the centre is a light at the camera, the rim one from the side.

## Figure 4: Dice against the intensity of the input

![Dice of ours and of the baseline, from a black image to a white one](figure-4.png)

Bands are one standard deviation. {figures["figure4"]["views"]} views, through a camera of 8 bits that clips
at white; normals are estimated anew at each level.

## Table 5: against soft maps of another method

{soft} The paper's other method is Relighting4D, on real people.

{table_5}
"""
