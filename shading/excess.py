"""Albedo that no surface has: brighter than paint can be, or more colourful in shadow than where it is lit.

A light that is bluer or warmer than another leaves its colour in what only it reaches. An albedo that takes
this for paint is wrong, and relit it glows.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from rich.progress import track

from shading import diffuse
from shadow import visibility
from shadow.data.photographs import everyday_lighting, photograph, sample
from shadow.data.records import Records
from shadow.framing import canvas_size

BRIGHTEST = 0.9  # of fresh snow, or chalk
MARGIN = 0.12  # of saturation in [0, 1], which noise and eight bits may add
BINS = 12  # steps of each channel of the encoded true albedo: pixels in one bin are of one material
FEWEST = 40  # lit canvas pixels of a material, to compare with
DARK, LIT = 0.15, 0.5  # of the most light that falls on a pixel of the view


class Excess(NamedTuple):
    """Shares of the subject's pixels, over all views."""

    bright: float  # whose albedo is above BRIGHTEST
    colourful: float  # in shadow, more saturated by MARGIN than the median of their material where it is lit
    compared: float  # in shadow, of a material that is also lit: of so many could it be said
    views: int

    @property
    def wrong(self) -> float:
        """The two kinds of mistakes together."""
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
    """Measure the mistakes of the albedo on records, each photographed once in light as of
    `photographs.everyday_lighting`: keys warmer than the sky.

    paths: record folders or shards. model, field_model: names of shipped weights or .safetensors paths.
    limit: use this many records, spread evenly. Returns {"photograph" or "albedo": Excess}; the photograph,
    exposed to the albedo's own brightness, is what one has without an albedo. Raises ValueError if the
    network infers no albedo.
    """
    network, field, found = diffuse.load(model), visibility.load(field_model), Records(paths)
    chosen = found.spread(limit or len(found))
    sums = {name: np.zeros(4) for name in ("photograph", "albedo")}
    for index in track(chosen, "evaluating"):
        record, rng = found[index], np.random.default_rng((seed, index))
        lighting = everyday_lighting(rng, record.directions)
        drawn = sample(record, rng, canvas_size(network.size), augment=False, lighting=lighting)
        rgb, mask = photograph(drawn["rgb"], drawn["mask"], rng), drawn["mask"][0]
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
        shares[name] = Excess(bright / total, colourful / total, compared / total, len(chosen))
    return shares


def count(estimate: np.ndarray, truth: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Pixels that are too bright, too colourful, compared, and all, of linear albedo (N, 3), its truth (N, 3)
    and the light (N,) that falls there, on any scale."""
    saturation, true_saturation = _saturation(estimate), _saturation(truth)
    light = light / max(np.percentile(light, 99), 1e-6)
    encoded = np.clip(truth, 0, 1) ** (1 / 2.2)
    steps = np.minimum((encoded * BINS).astype(int), BINS - 1)
    material = steps @ [BINS * BINS, BINS, 1]
    colourful, compared = np.zeros(len(light), bool), np.zeros(len(light), bool)
    for one in np.unique(material):
        mine = material == one
        lit, dark = mine & (light > LIT), mine & (light < DARK)
        if lit.sum() < FEWEST or not dark.any():
            continue
        compared |= dark
        # Paint itself differs a little within a bin.
        own = true_saturation - np.median(true_saturation[lit])
        colourful |= dark & (saturation - own > np.median(saturation[lit]) + MARGIN)
    bright = estimate.max(axis=1) > BRIGHTEST
    return np.array([bright.sum(), (colourful & ~bright).sum(), compared.sum(), len(light)], float)


def _saturation(linear: np.ndarray) -> np.ndarray:
    """(N,) of colours (N, 3): 0 grey, 1 pure; hardly any of what is almost black."""
    top = linear.max(axis=1)
    return (top - linear.min(axis=1)) / np.maximum(top, 0.02)


def report(found: dict[str, Excess]) -> str:
    """The shares as a Markdown table."""
    rows = ["| taken for the albedo | above 0.9, % ↓ | more colourful in shadow, % ↓ | together, % ↓ |"]
    rows.append("|---|---|---|---|")
    for name, each in found.items():
        shares = " | ".join(f"{100 * x:.2f}" for x in (each.bright, each.colourful, each.wrong))
        rows.append(f"| {name} | {shares} |")
    last = found["albedo"]
    return "\n".join(
        [*rows, "", f"{last.views} photographs; {100 * last.compared:.1f} % of the pixels could be compared."]
    )
