"""Scores of faces and hands by themselves, on records that say where these are."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from rich.progress import track

from shadow import visibility
from shadow.data.photographs import Sample, photograph, sample
from shadow.data.records import REGIONS, Records
from shadow.evaluation import metrics
from shadow.evaluation.scores import FRONTAL, normals_of
from shadow.framing import canvas_size
from shadow.networks.field import Visibility

WHOLE = "whole body"
FEWEST = 30  # canvas pixels of a region, below which a view does not show it


class RegionScore(NamedTuple):
    """Of one region: the normals' mean error over views; cast shadows over all pixels and lights."""

    angle: float  # degrees
    found: float  # share of the cast shadow that the maps have; of the frontal lights, where N·L is above 0
    false: float  # share of the lit pixels there that the maps have in shadow
    views: int


def evaluate(
    paths: Iterable[str | Path],
    *,
    model: str | Path = "field",
    normals_model: str | Path | None = None,
    seed: int = 0,
    limit: int | None = None,
) -> dict[str, RegionScore]:
    """Score normals and cast shadows on faces and hands; each record is photographed once, lit at random.

    paths: record folders or shards; records that do not say where faces and hands are (those of scans, and
    old ones) are passed over. model, normals_model: as of `scores.evaluate`. limit: use this many records,
    spread evenly. Returns {"whole body", "face", "hands": RegionScore}, those that any view shows. Raises
    ValueError if no record says.
    """
    network, found = visibility.load(model), Records(paths)
    surface = normals_of(network, normals_model)
    angles: dict[str, list[float]] = {}
    counts: dict[str, np.ndarray] = {}
    for index in track(found.spread(limit or len(found)), "evaluating"):
        record = found[index]
        if record.regions is None:
            continue
        rng = np.random.default_rng((seed, index))
        drawn = sample(record, rng, canvas_size(network.size), augment=False)
        rgb, mask = photograph(drawn["rgb"], drawn["mask"], rng), drawn["mask"][0]
        given = None if surface is network else surface.normals(rgb, mask)
        normals, maps = network.analyse(rgb, mask, given)
        inside = mask > 0.5
        places = {WHOLE: inside}
        for name, share in zip(REGIONS[1:], drawn["regions"], strict=True):
            places[name] = inside & (share > 0.5)
        for name, place in places.items():
            if place.sum() < FEWEST:
                continue
            angles.setdefault(name, []).append(float(metrics.angular_error(normals, drawn["normals"], place)))
            counts[name] = counts.get(name, np.zeros(4)) + _cast(drawn, maps, place)
    if not angles:
        raise ValueError("records: expected some that say where faces are, found none; render bodies again")
    return {
        name: RegionScore(
            float(np.mean(column)),
            float(counts[name][0] / max(counts[name][1], 1)),
            float(counts[name][2] / max(counts[name][3], 1)),
            len(column),
        )
        for name, column in angles.items()
    }


def _cast(drawn: Sample, maps: Visibility, place: torch.Tensor) -> np.ndarray:
    """Of the pixels (h, w) of a place that face a frontal light: cast shadow found, all of it, false shadow,
    all that is lit; summed over the lights."""
    frontal = drawn["directions"][:, 2] > FRONTAL
    lights, truth = drawn["directions"][frontal], drawn["visibility"][frontal][:, place] > 0.5
    facing = torch.einsum("dc,cp->dp", lights, drawn["normals"][:, place]) > 0
    dark = maps(lights)[:, place] <= 0.5
    shadow, lit = facing & ~truth, facing & truth
    return np.array([float(each.sum()) for each in (dark & shadow, shadow, dark & lit, lit)])


def report(scores: dict[str, RegionScore]) -> str:
    """The scores as a Markdown table."""
    rows = ["| where | normals, degrees off ↓ | cast shadow found, % ↑ | lit but dark, % ↓ | views |"]
    rows.append("|---|---|---|---|---|")
    for name, score in scores.items():
        share = f"{100 * score.found:.1f} | {100 * score.false:.1f}"
        rows.append(f"| {name} | {score.angle:.1f} | {share} | {score.views} |")
    return "\n".join(rows)
