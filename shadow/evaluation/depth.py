"""Score the depth that a visibility field infers, on records with the true depth."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from shadow import visibility
from shadow.data.records import Records
from shadow.evaluation import metrics
from shadow.evaluation.scores import photographed


class DepthScore(NamedTuple):
    """Mean scores over views."""

    error: float  # per cent of the subject's height, see `metrics.depth_error`
    flat: float  # the same error for a constant depth, as a baseline
    order: float  # fraction of pixel pairs across limb borders in the true order, see `metrics.depth_order`
    views: int


def evaluate(
    paths: Iterable[str | Path], *, model: str | Path = "field", seed: int = 0, limit: int | None = None
) -> DepthScore:
    """Score the depth of a field on records, each photographed once under a random lighting.

    paths: record folders or shards; records without depth are skipped. model: a name of shipped weights or a
    .safetensors path. limit: use this many records, spread evenly. Raises ValueError if the network infers no
    depth, or no record has any.
    """
    network, records = visibility.load(model), Records(paths)
    if not getattr(network, "depth", False):
        raise ValueError(f"model: {model} infers no depth; expected a field that was trained with it")
    scores = []
    views = photographed(
        records, network.size, seed, limit, suited=lambda record: record.depth is not None, lights=1
    )
    for _, drawn, rgb in views:
        mask, truth = drawn["mask"][0], drawn["depth"][0]
        estimate, inside = network.analyse(rgb, mask)[1].depth, mask > 0.5
        errors = (metrics.depth_error(depth, truth, inside) for depth in (estimate, torch.zeros_like(truth)))
        scores.append([*map(float, errors), float(metrics.depth_order(estimate, truth, inside))])
    if not scores:
        raise ValueError("records: expected some with depth, found none; render them again")
    error, flat, order = map(float, np.nanmean(scores, axis=0))
    return DepthScore(error, flat, order, len(scores))


def report(score: DepthScore) -> str:
    """Format the score as a sentence."""
    return (
        f"Depth: mean error {score.error:.2f} % of the height ({score.flat:.2f} % for a flat person), "
        f"correct order across {100 * score.order:.1f} % of the borders of limbs, on {score.views} views."
    )
