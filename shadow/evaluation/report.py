"""Reproduce the paper's tables and figures on any records, as a Markdown report and as JSON."""

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
from shadow.analysis import VisibilityNetwork
from shadow.data.records import Records
from shadow.evaluation import plots, scores
from shadow.evaluation.scores import ESTIMATED, TRUE, Score, ScoredView
from shadow.files import replacing
from shadow.framing import canvas_size
from shadow.networks import checkpoints
from shadow.networks.unet import LATENTS, PerLight
from shadow.normals import NormalsSource
from shadow.training.loop import TRUE_NORMALS

LEVELS = 10 ** np.arange(-6, 2.1, 0.5)  # intensities of Figure 4, from a black 8-bit image to a white one
LEVELS_VIEWS = 20  # views of Figure 4, each at every level
REPEATS = 5  # repetitions of a timed call

Row = dict[str, Any]  # a row of a table, in the types of JSON

# The paper's values, measured on its own data and an RTX 2080.
BASELINE, OURS = Score((0.432, 0.056), (0.834, 0.049)), Score((0.313, 0.051), (0.881, 0.041))
WITHOUT_NORMALS, MIXED = Score((0.334, 0.054), (0.867, 0.045)), Score((0.352, 0.053), (0.862, 0.044))
LATENT = {  # milliseconds, millions of parameters, score
    "resb3": (11.9, 24.8, Score((0.318, 0.053), (0.879, 0.042))),
    "resb7": (14.2, 45.8, OURS),
    "resb11": (15.7, 83.5, Score((0.315, 0.052), (0.879, 0.041))),
    "attention": (15.9, 39.0, Score((0.322, 0.053), (0.876, 0.042))),
}
RELIGHTING4D = {  # (Relighting4D, the paper), on subjects of the People Snapshot Dataset
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
    """Write `out`/report.md, report.json, figure-2.png and figure-4.png; return the path of report.md.

    The paths are of record folders or shards. `models`: {name: shipped name or .safetensors path}. "ours"
    (the shipped field unless given) is the network of Tables 2, 3 and 5 and of the figures. "without-normals"
    and "mixed" are rows of Table 3. "resb3", "resb7", "resb11" and "attention" are rows of Table 4. Any other
    name is an additional row of Table 2. `normals_model`: source of the normals for all networks, see
    `scores.normals_of`; "ours" if None. `soft`: folder of another method's soft maps for Table 5, see
    `scores.against_soft_maps`. `limit`: use this many records, spread evenly.

    Raises FileNotFoundError or ValueError if there are no records, weights are damaged, a network does not
    match its row, or no soft map belongs to a record.
    """
    models = {"ours": "field", **(models or {})}
    records = Records(paths)
    networks = {name: visibility.load(model, scores.best_device()) for name, model in models.items()}
    for name, network in networks.items():
        _check(name, network, models[name])
    ours, out = networks["ours"], Path(out)
    surface = scores.normals_of(ours, normals_model)
    out.mkdir(parents=True, exist_ok=True)

    table_5 = _table_5(records, soft, ours, surface, seed, limit) if soft else []  # first, to fail early
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
        "table4": _table_4(scored, networks, ScoredView.of(records[0], (seed, 0), ours.size)),
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
    """Raise ValueError if the architecture or training of a network is not that of its row."""
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
        raise ValueError(f"model: {model} is not a network for the row {name!r}")


def _plain(score: Score | None) -> dict[str, object] | None:
    """Convert a Score for JSON; None stays None."""
    return None if score is None else {"rmse": score.rmse, "psnr": score.psnr, "dice": score.dice}


def _row(variant: str, score: Score | None, paper: Score | None = None, **cells: object) -> Row:
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


def _table_4(
    scored: dict[str, Score], networks: Mapping[str, VisibilityNetwork], view: ScoredView
) -> list[Row]:
    """Measure time and size of each latent, trained or not, and of ours, without pre- and postprocessing."""
    placement: Any = {"device": view.rgb.device, "memory_format": torch.channels_last}
    candidates: dict[str, VisibilityNetwork] = {
        name: networks.get(name) or PerLight(latent=name).eval().to(**placement) for name in LATENTS
    }
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
    network: VisibilityNetwork,
    surface: NormalsSource,
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


def _figure_4(
    path: Path,
    records: Records,
    network: VisibilityNetwork,
    surface: NormalsSource,
    seed: int,
    limit: int | None,
) -> Row:
    views = min(limit or len(records), LEVELS_VIEWS, len(records))
    tallies = scores.intensity_sweep(records, network, surface, LEVELS, seed=seed, limit=views)
    names, columns = ("ours", ESTIMATED), zip(*tallies, strict=True)
    dice = {name: [t.score().dice for t in column] for name, column in zip(names, columns, strict=True)}
    series = {name: (np.array(pairs)[:, 0], np.array(pairs)[:, 1]) for name, pairs in dice.items()}
    plots.curves(path, LEVELS, series, "intensity of the input (1: a normal exposure)", "Dice")
    return {"views": views, "levels": LEVELS.tolist(), "dice": dice}


def _milliseconds(network: VisibilityNetwork, view: ScoredView, lights: torch.Tensor) -> float:
    times = []
    for _ in range(1 + REPEATS):  # the first call allocates memory and is not counted
        start = time.perf_counter()
        network.analyse(view.rgb, view.mask, view.normals)[1](lights).sum().item()  # item() waits for a GPU
        times.append(1000 * (time.perf_counter() - start))
    return median(times[1:])


def _cells(score: Row | None, psnr: bool = False, none: str = "–") -> list[str]:
    """Format the cells of a score, or of a missing one."""
    if score is None:
        return [none, *["–"] * (1 + psnr)]
    rmse, dice = ("{:.3f} ({:.3f})".format(*score[metric]) for metric in ("rmse", "dice"))
    return [rmse, f"{score['psnr']:.2f}", dice] if psnr else [rmse, dice]


def _scores(row: Row, psnr: bool = False) -> list[str]:
    return [*_cells(row["measured"], psnr, none="not given"), *_cells(row["paper"], psnr)]


def _lines_of_table_4(rows: list[Row]) -> Iterator[list[str]]:
    for row in rows:
        own, paper = (
            ["–" if row[key] is None else f"{row[key]:.1f}" for key in keys]
            for keys in (("milliseconds", "millions"), ("paper_milliseconds", "paper_millions"))
        )
        measured = _cells(row["measured"], none="not given")
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
    """Format Tables 2 to 5 as Markdown."""
    header = ["ms ↓", "params, M ↓", "RMSE ↓", "Dice ↑"]
    paper = ["paper: ms", "paper: params, M", "paper: RMSE", "paper: Dice"]
    return (
        scores.table(
            ["variant", "RMSE ↓", "PSNR ↑", "Dice ↑", "paper: RMSE", "paper: PSNR", "paper: Dice"],
            [[row["variant"], *_scores(row, psnr=True)] for row in figures["table2"]],
        ),
        scores.table(
            ["variant", "training", "inference", "RMSE ↓", "Dice ↑", "paper: RMSE", "paper: Dice"],
            [[row["variant"], row["training"], row["inference"], *_scores(row)] for row in figures["table3"]],
        ),
        scores.table(["variant", *header, *paper], _lines_of_table_4(figures["table4"])),
        scores.table(
            ["subject", "RMSE ↓, theirs", "RMSE ↓, ours", "Dice ↑, theirs", "Dice ↑, ours"],
            _lines_of_table_5(figures["table5"]),
        ),
    )


def _markdown(figures: Row) -> str:
    """Format the report from the content of report.json."""
    table_2, table_3, table_4, table_5 = _tables(figures)
    models = ", ".join(f"{name} is `{model}`" for name, model in figures["models"].items())
    height, width = figures["canvas"]
    soft = "Their maps are thresholded by Otsu's method." if figures["table5"] else "No soft maps were given."
    return f"""# Self-shadow maps, scored as in the paper

{figures["views"]} views of {", ".join(figures["records"])}, each photographed once under a random lighting
(seed {figures["seed"]}) and evaluated for its frontal lights: {figures["maps"]} maps on a canvas of
{height} × {width}. Networks: {models}. Estimated normals are those of `{figures["normals"]}`, with a mean
error of {figures["normals_error"]:.1f} degrees. Maps are binary, and metrics are measured inside the mask
(Section 4.1). Values are means (standard deviations) over maps. The paper's columns are its own values for
its own data, which is not public. All values are in [report.json](report.json).

## Table 2: against the baseline

{table_2}

## Table 3: surface normals

{table_3}

## Table 4: latent transformations

{table_4}

Times are those of the network alone, for one light on that canvas, on {figures["device"]} (threads:
{figures["threads"]}); the paper's times are for 512 × 512 on an RTX 2080. Ours infers all
{len(figures["figure2"]["lights"])} lights in {figures["table4"][-1]["milliseconds_all"]:.1f} ms.

## Figure 2: error over the frontal hemisphere

![Mean and standard deviation of the RMSE for each light direction](figure-2.png)

Seen from the camera, x right and y up: the centre is a light at the camera, the rim is a light at the side.

## Figure 4: Dice against the intensity of the input

![Dice of ours and of the baseline, from a black image to a white one](figure-4.png)

Bands are one standard deviation. {figures["figure4"]["views"]} views, seen by an 8-bit camera that clips at
white; normals are estimated at each level.

## Table 5: against soft maps of another method

{soft} The paper's other method is Relighting4D, on real people.

{table_5}
"""
