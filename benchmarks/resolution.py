"""Measure the effect of resolution: infer visibility and normals from photographs at the records' size, and
from the same photographs reduced to half and enlarged again. Prints the scores of both on the records'
pixels.

python benchmarks/resolution.py RECORDS [views]

Every view is photographed once under a random lighting. The binary maps of its frontal lights are scored.

Figures of shipped weights, to compare with, are in docs/history.md.
"""

import sys

import numpy as np
import torch
import torch.nn.functional as F
from rich.progress import track

import shadow
from shadow import visibility
from shadow.data.photographs import light, photograph, random_lighting
from shadow.data.records import Records
from shadow.evaluation import metrics
from shadow.evaluation.scores import FRONTAL


def photographed(record, seed):
    """The record under one random lighting, as a camera delivers it: rgb (3, H, W) linear, mask (1, H, W)."""
    rng = np.random.default_rng(seed)
    mask = torch.from_numpy(record.mask).float()[None]
    lit = record.image(light(record, random_lighting(rng, record.directions)))
    return photograph(lit, mask, rng) * mask, mask


def halved(rgb, mask):
    """Both at half the size; rgb is premultiplied by the mask before and not after."""
    small = F.avg_pool2d(torch.cat([rgb, mask])[None], 2)[0]
    return small[:3] / small[3:].clamp_min(1e-3), small[3:]


def inferred(rgb, mask, lights):
    """Normals (3, H, W) and visibility (D, H, W) of a photograph."""
    image, matte = rgb.permute(1, 2, 0), mask[0]
    surface = shadow.infer_normals(image, matte)
    return surface.permute(2, 0, 1), shadow.infer(image, matte, lights)


def enlarged(maps, size):
    return F.interpolate(maps[None], size, mode="bilinear")[0]


def main(folder, views=16):
    records, rows = Records([folder]), {}
    for index in track(records.spread(int(views)), "views"):
        record = records[index]
        frontal = record.directions[:, 2] > FRONTAL
        lights = torch.from_numpy(record.directions[frontal])
        truth = record.image(record.visibility[:, frontal].astype(np.float32))
        surface = record.image(record.normals)
        rgb, mask = photographed(record, (0, index))
        inside, size = mask[0] > 0.5, record.mask.shape
        small = inferred(*halved(rgb, mask), lights)
        found = {
            "the photograph": inferred(rgb, mask, lights),
            "half of it, enlarged": (F.normalize(enlarged(small[0], size), dim=0), enlarged(small[1], size)),
        }
        for name, (normals, maps) in found.items():
            sign = visibility.baseline(normals.permute(1, 2, 0), lights)
            scores = [float(metrics.angular_error(normals, surface, inside))]
            for binary in ((maps > 0.5).float(), sign):
                scores.append(float(metrics.rmse(binary, truth, inside).mean()))
                scores.append(float(metrics.dice(binary, truth, inside).mean()))
            rows.setdefault(name, []).append(scores)
    print("| inferred from | normals, degrees | RMSE | Dice | sign(N·L): RMSE | Dice |")
    print("|---|---|---|---|---|---|")
    for name, scores in rows.items():
        angle, *rest = np.mean(scores, axis=0)
        print(f"| {name} | {angle:.1f} | " + " | ".join(f"{value:.3f}" for value in rest) + " |")


if __name__ == "__main__":
    main(*sys.argv[1:])
