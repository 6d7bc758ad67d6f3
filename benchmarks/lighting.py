"""What the light of a photograph costs: normals and binary visibility inferred from the same views in soft
and in hard light, without paint and without light.

python benchmarks/lighting.py RECORDS [field.safetensors] [views]

Views are scored on the canvas, visibility for their frontal lights. Random lightings are those of `relight
evaluate`; without paint all is grey, without light the photograph is the albedo.
"""

import sys
from dataclasses import replace

import numpy as np
import torch
import torch.nn.functional as F
from rich.progress import track

from shadow import metrics, visibility
from shadow.directions import from_spherical
from shadow.evaluation import FRONTAL, Tally, View
from shadow.framing import Framing
from shadow.records import Records, light, random_lighting


def lightings(directions, seed):
    """Names, and weights (D, 3) over directions (D, 3): lamps have the power 3, skies 4."""
    sky = np.full_like(directions, 4 / len(directions))
    key, side = (lamp(directions, azimuth, elevation) for azimuth, elevation in ((-35, 30), (96, 17)))
    return {
        "random": random_lighting(np.random.default_rng(seed), directions),
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


def photographs(record, seed):
    """Names, and linear colours (N, 3) of the record's pixels."""
    lit = lightings(record.directions, seed)
    grey = replace(record, albedo_uint8=np.full_like(record.albedo_uint8, 186))
    found = {name: light(record, weights) for name, weights in lit.items()}
    found["key, without paint"] = light(grey, lit["key"])
    return found | {"without light": record.albedo, "without either": grey.albedo}


def framed(record, colour, height):
    """The View of the record in these colours (N, 3) on a canvas of `height` pixels."""
    frontal = record.directions[:, 2] > FRONTAL
    mask = torch.from_numpy(record.mask).float()[None]
    image = record.image(np.concatenate([colour, record.normals, record.visibility[:, frontal]], axis=1))
    planes = Framing.around(mask[0], height).crop(torch.cat([mask, image]))
    straight = planes[1:] / planes[:1].clamp_min(0.02)
    rgb, normals, visible = straight.split([3, 3, int(frontal.sum())])
    lights = torch.from_numpy(record.directions[frontal])
    return View(rgb, rgb, planes[0], F.normalize(normals, dim=0), lights, (visible > 0.5).float())


def main(folder, model="field", views=16):
    network, records = visibility.load(model), Records([folder])
    tallies, angles = {}, {}
    for index in track(records.spread(int(views)), "views"):
        for name, colour in photographs(records[index], (0, index)).items():
            view = framed(records[index], colour, network.size)
            normals, binary = view.binary(network, None)
            tallies.setdefault(name, Tally()).add(binary, view)
            angle = metrics.angular_error(normals, view.normals, view.mask > 0.5)
            angles.setdefault(name, []).append(float(angle))
    print("| light | normals, degrees | RMSE | Dice |\n|---|---|---|---|")
    for name, tally in tallies.items():
        score = tally.score()
        print(f"| {name} | {np.mean(angles[name]):.1f} | {score.rmse[0]:.3f} | {score.dice[0]:.3f} |")


if __name__ == "__main__":
    main(*sys.argv[1:])
