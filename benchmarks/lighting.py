"""Measure how the light of a photograph changes the analysis: infer normals and binary visibility from the
same views in soft light, in hard light, without paint and without light. Prints the scores of each.

python benchmarks/lighting.py RECORDS [field.safetensors] [views]

Views and random lightings are those of `relight evaluate`. "Without paint" makes every surface grey. "Without
light" takes the albedo for the photograph, without a simulated camera.

Figures of shipped weights, to compare with, are in docs/history.md.
"""

import sys
from dataclasses import replace

import numpy as np
import torch
from rich.progress import track

from shadow import visibility
from shadow.data.records import Records
from shadow.directions import from_spherical
from shadow.evaluation import metrics
from shadow.evaluation.scores import ScoredView, Tally, best_device


def lightings(directions):
    """Names, and weights (D, 3) over directions (D, 3), or None where they are drawn: lamps have the power 3,
    skies 4."""
    sky = np.full_like(directions, 4 / len(directions))
    key, side = (lamp(directions, azimuth, elevation) for azimuth, elevation in ((-35, 30), (96, 17)))
    return {
        "random": None,
        "sky": sky,
        "key and sky": 0.6 * key + 0.4 * sky,
        "key": key,
        "lamp from the side and sky": 0.6 * side + 0.4 * sky,
        "lamp from the side": side,
        "lamp beside the camera": lamp(directions, 0, 0),
    }


def lamp(directions, azimuth, elevation):
    weights = np.zeros_like(directions)
    weights[np.argmax(directions @ from_spherical(azimuth, elevation))] = 3
    return weights


def photographs(record, seed, height):
    """Names, and Views of the record on a canvas of `height` pixels."""
    lit = lightings(record.directions)
    grey = replace(record, albedo_uint8=np.full_like(record.albedo_uint8, 186))
    views = {name: ScoredView.of(record, seed, height, weights) for name, weights in lit.items()}
    views["key, without paint"] = unpainted = ScoredView.of(grey, seed, height, lit["key"])
    views["without light"] = replace(unpainted, rgb=views["key"].albedo)
    views["without either"] = replace(unpainted, rgb=unpainted.albedo)
    return views


def table(shoot, folder, model="field", views=16):
    """Print how `model` scores on what `shoot(record, seed, height)` returns by name, Views of a record on
    a canvas of `height` pixels, inside their mattes and that of the first."""
    network, records = visibility.load(model, best_device()), Records([folder])
    tallies, angles = {}, {}
    for index in track(records.spread(int(views)), "views"):
        shot = shoot(records[index], (0, index), network.size)
        mask = next(iter(shot.values())).mask
        for name, view in shot.items():
            normals, binary = view.binary(network, None)
            seen = replace(view, mask=torch.minimum(view.mask, mask))
            tallies.setdefault(name, Tally()).add(binary, seen)
            angle = metrics.angular_error(normals, seen.normals, seen.mask > 0.5)
            angles.setdefault(name, []).append(float(angle))
    print("| photograph | normals, degrees | RMSE | Dice |\n|---|---|---|---|")
    for name, tally in tallies.items():
        score = tally.score()
        print(f"| {name} | {np.mean(angles[name]):.1f} | {score.rmse[0]:.3f} | {score.dice[0]:.3f} |")


if __name__ == "__main__":
    table(photographs, *sys.argv[1:])
