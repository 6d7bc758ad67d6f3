"""Measure whether the analysis is as sure of its shadows as it should be, on bodies that no network has seen.

python benchmarks/confidence.py [bodies] [first seed] [--figure FILE.png]

Body number k has the seed k; it is ray-traced with the true visibility of 96 directions, photographed in
everyday light, and analysed. A pixel is wrong in a light if it is said to be lit and is not, or the reverse.
The first table has pixels by their stated confidence over all directions; the second, pixels in one light
each. The expected calibration error is the mean difference of stated and measured, weighted by the pixels.
Below are correlations with the true error, of the confidence and of what else was tried: the slope of the
attached shadow's edge, and the differences between the maps of the photograph and of its mirror image. A
constant has the correlation 0, and its squared error is the variance of the true error. --figure draws the
reliability diagram (Guo et al., ICML 2017), for which it needs matplotlib.

Figures to compare with are in docs/conventions.md.
"""

import argparse

import numpy as np
import torch
from rich.progress import track

import relight
from relight.analysis import confidence
from relight.analysis.light_field import LightField
from shadow.analysis import load
from shadow.data import lightings, photographs
from shadow.directions import olat
from shadow.framing import Framed
from shadow.lightstage import stage
from shadow.lightstage.people.generate import bodies
from shadow.networks.mirror import MIRROR

SIZE = 320
STEP = 7  # of the pixels, one in so many is taken
BINS = 10


def rendered(first, count):
    """Records of rendered bodies, with their seeds."""
    directions = olat(behind=True)
    for seed in track(range(first, first + count), "bodies"):
        figure = bodies.body(seed, "generalisation")
        view = stage.views(1, figure, np.random.default_rng(seed))[0]
        yield seed, stage.render(figure, view, SIZE, directions, bounced=True)


def measured(seed, record, network):
    """True errors (N,) of visibility and normals, predictors {name: (N,)}; and the stated and the true
    correctness in each light (96, N)."""
    directions = record.directions
    weights = lightings.everyday_lighting(np.random.default_rng(seed), directions)
    photo = record.image(photographs.light(record, weights))
    photo *= 0.2 / photo[:, torch.from_numpy(record.mask)].mean()
    subject = relight.Subject(photo.permute(1, 2, 0).numpy(), record.mask.astype(np.float32))
    maps = subject.record.maps
    field: LightField = maps.field
    framed = Framed.of(photo, torch.from_numpy(record.mask.astype(np.float32)), maps.known.shape[0])
    true = torch.cat([record.image(record.normals), record.image(record.visibility.astype(np.float32))])
    crop = framed.framing.crop(torch.cat([true, torch.from_numpy(record.mask.astype(np.float32))[None]]))
    take = field.silhouette.take
    inside = (take(crop[-1:])[0] > 0.98).nonzero()[::STEP, 0]
    normals = torch.nn.functional.normalize(take(crop[:3]), dim=0)[:, inside]
    seen, lit = (
        take(maps.visibility(torch.from_numpy(directions)))[:, inside],
        take(crop[3:-1])[:, inside] > 0.5,
    )
    own, mirrored = both_sides(network, framed, field)
    stated = 1 - take(confidence.Doubt(maps.visibility)(torch.from_numpy(directions)))[:, inside]
    right = (seen > 0.5) == lit
    errors = {
        "visibility": 1 - right.float().mean(dim=0),
        "normals": degrees(field.normals[:, inside], normals),
    }
    predictors = {
        "confidence": take(maps.confidence())[0, inside],
        "slope of the attached shadow's edge": field.sharpness[0, inside],
        "mirror image, visibility": -(own[1] - mirrored[1]).abs().mean(dim=0)[inside],
        "mirror image, normals": -degrees(own[0], mirrored[0])[inside],
    }
    return errors, predictors, (stated, right)


def both_sides(network, framed, field):
    """Normals (3, N) and visibility (96, N) from the photograph and from its mirror image."""
    anchors = network.anchors
    sides = []
    for flip in (False, True):
        rgb, mask = (each.flip(-1) if flip else each for each in (framed.rgb, framed.mask))
        found, visible = network.analyse(rgb, mask, None, passes=1)
        lights = anchors * MIRROR if flip else anchors
        maps = [found * MIRROR[:, None, None] if flip else found, visible(lights)]
        sides.append([field.silhouette.take(each.flip(-1) if flip else each) for each in maps])
    return sides


def degrees(one, other):
    return torch.rad2deg(torch.acos((one * other).sum(dim=0).clamp(-1, 1)))


class Reliability:
    """Stated and measured shares of right pixels, in bins between `edges`."""

    def __init__(self, stated, right, edges):
        place = np.clip(np.searchsorted(edges, stated, side="right") - 1, 0, len(edges) - 2)
        counts = np.bincount(place, minlength=len(edges) - 1)
        there = counts > 0
        sums = [np.bincount(place, values, len(counts))[there] for values in (stated, right)]
        self.stated, self.measured = (values / counts[there] for values in sums)
        self.pixels = counts[there] / counts.sum()

    @property
    def error(self):
        """The expected calibration error."""
        return float(self.pixels @ np.abs(self.stated - self.measured))

    def report(self):
        print("| stated | measured | pixels |\n|---|---|---|")
        for stated, right, pixels in zip(self.stated, self.measured, self.pixels, strict=True):
            print(f"| {stated:.3f} | {right:.3f} | {100 * pixels:.0f} % |")
        print(f"\nExpected calibration error {self.error:.4f}\n")


def draw(path, diagrams):
    """Draw reliability diagrams {title: Reliability}, with the pixels in each bin below."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4.2), layout="constrained", dpi=100)
    columns = figure.subplots(2, len(diagrams), height_ratios=(3, 1), sharex="col").T
    for (curve, bars), (title, one) in zip(columns, diagrams.items(), strict=True):
        low = min(one.stated.min(), one.measured.min()) - 0.01
        curve.plot([low, 1], [low, 1], color="#999999", linestyle="--", label="calibrated")
        curve.plot(one.stated, one.measured, marker="o", color="#1565c0", label="measured")
        curve.set(title=f"{title}: error {one.error:.3f}", ylabel="measured", ylim=(low, 1.005))
        curve.legend(frameon=False)
        width = (1 - low) / 40
        bars.bar(one.stated, 100 * one.pixels, width=width, color="#90a4ae")
        bars.set(xlabel="stated confidence", ylabel="% of pixels", xlim=(low, 1.005))
    figure.savefig(path)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("bodies", nargs="?", type=int, default=12)
    parser.add_argument("first", nargs="?", type=int, default=200)
    parser.add_argument("--figure")
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    network = load()
    found = [measured(seed, record, network) for seed, record in rendered(chosen.first, chosen.bodies)]
    errors = {name: np.concatenate([each[0][name] for each in found]) for name in found[0][0]}
    predictors = {name: np.concatenate([each[1][name] for each in found]) for name in found[0][1]}
    sure = predictors["confidence"]
    stated, right = (np.concatenate([each[2][k].numpy().ravel() for each in found]) for k in (0, 1))
    tenths = np.quantile(sure, np.linspace(0, 1, BINS + 1))
    diagrams = {
        "All directions": Reliability(sure, 1 - errors["visibility"], tenths),
        "One light": Reliability(stated, right, np.linspace(0.5, 1, BINS + 1)),
    }
    for title, one in diagrams.items():
        print(f"\n{title}\n")
        one.report()
    if chosen.figure:
        draw(chosen.figure, diagrams)
    left = ((1 - sure - errors["visibility"]) ** 2).mean() / errors["visibility"].var()
    print(f"Squared error of the stated error, over that of the best constant: {left:.2f}\n")
    print("| correlation with the true error of | visibility | normals |\n|---|---|---|")
    for name, values in predictors.items():
        row = [-np.corrcoef(values, errors[of])[0, 1] for of in ("visibility", "normals")]
        print(f"| {name} | {row[0]:.2f} | {row[1]:.2f} |")


if __name__ == "__main__":
    main()
