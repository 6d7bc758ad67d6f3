"""Measure implausible albedo: brighter than any paint, or more saturated in shadow than in the light.

Where one light of several is occluded, a photograph has the colour of the others. An albedo that keeps this
colour is wrong, and glows when it is relit.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from shading import diffuse
from shadow import visibility
from shadow.data.lightings import everyday_lighting
from shadow.data.records import Records
from shadow.evaluation.scores import photographed, table
from shadow.networks.backbone import ENCODING

BRIGHTEST_PAINT = 0.9  # albedo of fresh snow or chalk
SATURATION_MARGIN = 0.12  # saturation in [0, 1] that noise and quantisation to 8 bits may add
BINS = 12  # in each channel of the encoded true albedo; pixels in one bin count as one material
MIN_LIT_PIXELS = 40  # of a material, for a comparison
DARK_SHARE, LIT_SHARE = 0.15, 0.5  # of the light on the brightest pixel of the view


class Excess(NamedTuple):
    """Fractions of the subject's pixels, over all views."""

    bright: float  # with an albedo above BRIGHTEST_PAINT
    colourful: float  # in shadow, and more saturated than the median of the same material in light
    compared: float  # in shadow, and of a material that is in light elsewhere, so that it can be compared
    views: int

    @property
    def wrong(self) -> float:
        """The fraction with either of the two errors."""
        return self.bright + self.colourful


@torch.no_grad()
def evaluate(
    paths: Iterable[str | Path],
    *,
    model: str | Path = "shading",
    field_model: str | Path = "field",
    seed: int = 0,
    limit: int | None = None,
) -> dict[str, Excess]:
    """Measure implausible albedo on records.

    Each record is photographed once under `lightings.everyday_lighting`, whose key lights are warmer than
    the sky. paths: record folders or shards. model, field_model: names of shipped weights or .safetensors
    paths. limit: use this many records, spread evenly. Returns {"photograph" or "albedo": Excess}; the
    photograph, scaled to the brightness of the albedo, is the baseline. Raises ValueError if the network
    infers no albedo.
    """
    network, field, records = diffuse.load(model), visibility.load(field_model), Records(paths)
    views = 0
    sums = {name: np.zeros(4) for name in ("photograph", "albedo")}
    for _, drawn, rgb in photographed(records, network.size, seed, limit, lighting=everyday_lighting):
        views += 1
        mask = drawn["mask"][0]
        albedo = network.analyse(rgb, mask, *field.analyse(rgb, mask)).albedo
        if albedo is None:
            raise ValueError(f"model: {model} infers no albedo; expected a shading field")
        inside = mask > 0.5
        light = (drawn["rgb"] / drawn["albedo"].clamp_min(0.01)).mean(dim=0)[inside]
        exposed = rgb * (albedo[:, inside].median() / rgb[:, inside].median().clamp_min(1e-4))
        for name, image in (("photograph", exposed), ("albedo", albedo)):
            sums[name] += count(
                *(x.numpy() for x in (image[:, inside].T, drawn["albedo"][:, inside].T, light))
            )
    shares = {}
    for name, (bright, colourful, compared, total) in sums.items():
        shares[name] = Excess(bright / total, colourful / total, compared / total, views)
    return shares


def count(estimate: np.ndarray, truth: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Count the pixels that are too bright, too saturated, compared, and all pixels.

    estimate, truth: linear albedo (N, 3). light: (N,) light on each pixel, on any scale.
    """
    saturation, true_saturation = _saturation(estimate), _saturation(truth)
    light = light / max(np.percentile(light, 99), 1e-6)
    encoded = np.clip(truth, 0, 1) ** (1 / ENCODING)
    steps = np.minimum((encoded * BINS).astype(int), BINS - 1)
    material = steps @ [BINS * BINS, BINS, 1]
    colourful, compared = np.zeros(len(light), bool), np.zeros(len(light), bool)
    for one in np.unique(material):
        mine = material == one
        lit, dark = mine & (light > LIT_SHARE), mine & (light < DARK_SHARE)
        if lit.sum() < MIN_LIT_PIXELS or not dark.any():
            continue
        compared |= dark
        # The true saturation varies within a bin.
        own = true_saturation - np.median(true_saturation[lit])
        colourful |= dark & (saturation - own > np.median(saturation[lit]) + SATURATION_MARGIN)
    bright = estimate.max(axis=1) > BRIGHTEST_PAINT
    return np.array([bright.sum(), (colourful & ~bright).sum(), compared.sum(), len(light)], float)


def _saturation(linear: np.ndarray) -> np.ndarray:
    """Return the saturation (N,) of colours (N, 3), 0 for grey, 1 for pure, and near 0 for near-black."""
    top = linear.max(axis=1)
    return (top - linear.min(axis=1)) / np.maximum(top, 0.02)


def report(found: dict[str, Excess]) -> str:
    """Format the fractions as a Markdown table."""
    shares = table(
        ["albedo from", "above 0.9, % ↓", "more colourful in shadow, % ↓", "together, % ↓"],
        (
            [name, *(f"{100 * x:.2f}" for x in (each.bright, each.colourful, each.wrong))]
            for name, each in found.items()
        ),
    )
    last = found["albedo"]
    compared = f"{100 * last.compared:.1f} % of the pixels could be compared."
    return f"{shares}\n\n{last.views} photographs; {compared}"
