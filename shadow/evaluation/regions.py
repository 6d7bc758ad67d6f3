"""Score normals and cast shadows on faces and on hands, on records with regions."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from shadow import visibility
from shadow.data.photographs import Sample
from shadow.data.records import REGIONS, Records
from shadow.evaluation import metrics
from shadow.evaluation.scores import FRONTAL, normals_of, photographed, table
from shadow.networks.field import Visibility

WHOLE = "whole body"
MIN_REGION_PIXELS = 30  # a view with fewer canvas pixels of a region does not count


class RegionScore(NamedTuple):
    """Scores of one region: the error of normals, a mean over views, and cast shadows over all pixels."""

    angle: float  # degrees
    recall: float  # fraction of cast shadow (N·L > 0, frontal lights) that is in shadow in the maps
    false: float  # fraction of the lit pixels (same lights) that is in shadow in the maps
    views: int


def evaluate(
    paths: Iterable[str | Path],
    *,
    model: str | Path = "field",
    normals_model: str | Path | None = None,
    seed: int = 0,
    limit: int | None = None,
) -> dict[str, RegionScore]:
    """Score normals and cast shadows on faces and hands; each record is photographed once in random light.

    paths: record folders or shards; records without regions (those of scans, and old ones) are skipped.
    model, normals_model: see `scores.evaluate`. limit: use this many records, spread evenly. Returns
    {"whole body", "face", "hands": RegionScore}, without those that no view shows. Raises ValueError if no
    record has regions.
    """
    network, records = visibility.load(model), Records(paths)
    surface = normals_of(network, normals_model)
    angles: dict[str, list[float]] = {}
    counts: dict[str, np.ndarray] = {}
    views = photographed(records, network.size, seed, limit, suited=lambda record: record.regions is not None)
    for _, drawn, rgb in views:
        mask = drawn["mask"][0]
        given = None if surface is network else surface.normals(rgb, mask)
        normals, maps = network.analyse(rgb, mask, given)
        inside = mask > 0.5
        regions = {WHOLE: inside}
        for name, share in zip(REGIONS[1:], drawn["regions"], strict=True):
            regions[name] = inside & (share > 0.5)
        for name, region in regions.items():
            if region.sum() < MIN_REGION_PIXELS:
                continue
            angles.setdefault(name, []).append(
                float(metrics.angular_error(normals, drawn["normals"], region))
            )
            counts[name] = counts.get(name, np.zeros(4)) + count_cast(drawn, maps, region)
    if not angles:
        raise ValueError("records: expected some with regions, found none; render bodies again")
    return {
        name: RegionScore(
            float(np.mean(column)),
            float(counts[name][0] / max(counts[name][1], 1)),
            float(counts[name][2] / max(counts[name][3], 1)),
            len(column),
        )
        for name, column in angles.items()
    }


def count_cast(drawn: Sample, maps: Visibility, place: torch.Tensor) -> np.ndarray:
    """Count cast shadows over the pixels `place` (h, w) that face a frontal light, summed over the lights.

    Returns the number of pixels with found cast shadow, cast shadow, false shadow, and light.
    """
    frontal = drawn["directions"][:, 2] > FRONTAL
    lights, truth = drawn["directions"][frontal], drawn["visibility"][frontal][:, place] > 0.5
    facing = torch.einsum("dc,cp->dp", lights, drawn["normals"][:, place]) > 0
    dark = maps(lights)[:, place] <= 0.5
    shadow, lit = facing & ~truth, facing & truth
    return np.array([float(each.sum()) for each in (dark & shadow, shadow, dark & lit, lit)])


def report(scores: dict[str, RegionScore]) -> str:
    """Format the scores as a Markdown table."""
    return table(
        ["region", "error of normals, degrees ↓", "cast shadow found, % ↑", "false shadow, % ↓", "views"],
        (
            [name, f"{x.angle:.1f}", f"{100 * x.recall:.1f}", f"{100 * x.false:.1f}", str(x.views)]
            for name, x in scores.items()
        ),
    )
