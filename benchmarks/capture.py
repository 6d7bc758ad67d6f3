"""What cameras, files and mattes cost: normals and binary visibility inferred from the same photographs as
they are and as they might have been.

python benchmarks/capture.py RECORDS [field.safetensors] [views]

Views and lightings are those of `relight evaluate`; scores are of what both mattes show.
"""

import sys
from dataclasses import replace

import numpy as np
import torch
import torch.nn.functional as F
from rich.progress import track

from shadow import metrics, visibility
from shadow.evaluation import Tally, View
from shadow.records import LUMINANCE, Records, compress, rough_matte, sharpen


def grey(rgb):
    return torch.einsum("chw,c->hw", rgb, torch.from_numpy(LUMINANCE)).expand(3, -1, -1)


def shrunk(rgb, factor):
    """The image (3, H, W) brought down by `factor` and up again."""
    small = F.avg_pool2d(rgb[None], factor)
    return F.interpolate(small, rgb.shape[1:], mode="bilinear")[0]


def tinted(rgb, red, blue):
    return rgb * torch.tensor([red, 1, blue]).view(3, 1, 1)


def photographs(view, rng):
    """Names, and the View photographed worse."""
    rgb = view.rgb.cpu()
    worse = {
        "as it is": rgb,
        "JPEG, quality 50": compress(rgb, 50),
        "JPEG, quality 20": compress(rgb, 20),
        "blurred": sharpen(rgb, 0),
        "sharpened": sharpen(rgb, 4),
        "half the resolution": shrunk(rgb, 2),
        "a quarter of it": shrunk(rgb, 4),
        "white balance of daylight under a bulb": tinted(rgb, 1.5, 0.5),
        "black and white": grey(rgb),
    }
    views = {name: replace(view, rgb=image.to(view.rgb)) for name, image in worse.items()}
    views["rough matte"] = replace(view, mask=rough_matte(view.mask.cpu()[None], rng)[0].to(view.mask))
    return views


def main(folder, model="field", views=16):
    network, records = visibility.load(model), Records([folder])
    tallies, angles = {}, {}
    for index in track(records.spread(int(views)), "views"):
        view = View.of(records[index], (0, index), network.size)
        for name, worse in photographs(view, np.random.default_rng((1, index))).items():
            normals, binary = worse.binary(network, None)
            seen = replace(view, mask=torch.minimum(view.mask, worse.mask))
            tallies.setdefault(name, Tally()).add(binary, seen)
            angle = metrics.angular_error(normals, seen.normals, seen.mask > 0.5)
            angles.setdefault(name, []).append(float(angle))
    print("| photograph | normals, degrees | RMSE | Dice |\n|---|---|---|---|")
    for name, tally in tallies.items():
        score = tally.score()
        print(f"| {name} | {np.mean(angles[name]):.1f} | {score.rmse[0]:.3f} | {score.dice[0]:.3f} |")


if __name__ == "__main__":
    main(*sys.argv[1:])
