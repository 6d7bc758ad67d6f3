"""Measure the effect of resolution: infer visibility and normals from photographs at the records' size, and
from the same photographs reduced to half and enlarged again. Prints the scores of both on the records'
pixels, so that networks of different canvases can be compared.

python benchmarks/resolution.py RECORDS [--views 16] [--model FILE ...] [--passes 1 2] [--whole]

Every view is photographed once under a random lighting. The binary maps of its frontal lights are scored.
The fine part of the normals is what a blur of 1/64 of the height takes away. For it, the table gives the
correlation with the true one, and the energy relative to it. With --whole, the halved photographs are left
out. With --passes 1 2, a field is scored by the photograph alone, and by the mean with its mirror image.

Figures of shipped weights, to compare with, are in docs/history.md.
"""

import argparse
import itertools
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from rich.progress import track

import shadow
from shadow import visibility
from shadow.data.lightings import random_lighting
from shadow.data.photographs import light, photograph
from shadow.data.records import REGIONS, Records
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


def inferred(rgb, mask, lights, model, passes=None):
    """Normals (3, H, W) and visibility (D, H, W) of a photograph."""
    found = shadow.analyse(rgb.permute(1, 2, 0), mask[0], model=model, passes=passes)
    return found.normals.permute(2, 0, 1), found.visibility(lights)


def enlarged(maps, size):
    return F.interpolate(maps[None], size, mode="bilinear")[0]


def fine(normals, inside):
    """The fine part (3, N) of normals (3, H, W) inside (H, W) bool."""
    side = len(inside) // 128 * 2 + 1
    low = torch.cat([normals * inside, inside[None].float()])[None]
    for _ in range(3):  # three box blurs are close to a Gaussian
        low = F.avg_pool2d(low, side, 1, side // 2)
    return (normals - low[0, :3] / low[0, 3:].clamp_min(1e-4))[:, inside]


def scored(normals, maps, record, surface, truth, lights):
    """The columns of the table, for inferred normals (3, H, W) and visibility (D, H, W)."""
    inside = torch.from_numpy(record.mask)
    row = {"normals, degrees": float(metrics.angular_error(normals, surface, inside))}
    shares = record.image(record.shares)
    for name, part in zip(REGIONS[1:], shares > 0.5, strict=True):
        if part.any():
            row[name] = float(metrics.angular_error(normals, surface, part))
    ours, true = fine(normals, inside), fine(surface, inside)
    row["fine part: correlation"] = float((ours * true).sum() / (ours.norm() * true.norm()))
    row["energy"] = float(ours.square().sum() / true.square().sum())
    sign = visibility.baseline(normals.permute(1, 2, 0), lights)
    for name, binary in (("", (maps > 0.5).float()), ("sign(N·L): ", sign)):
        row[name + "RMSE"] = float(metrics.rmse(binary, truth, inside).mean())
        row[name + "Dice"] = float(metrics.dice(binary, truth, inside).mean())
    return row


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("records", type=Path)
    parser.add_argument("--views", type=int, default=16)
    parser.add_argument("--model", nargs="+", default=["field"], metavar="FILE")
    parser.add_argument("--passes", type=int, nargs="+", default=[None])
    parser.add_argument("--whole", action="store_true")
    given = parser.parse_args()
    records, rows = Records([given.records]), {}
    for index in track(records.spread(given.views), "views"):
        record = records[index]
        frontal = record.directions[:, 2] > FRONTAL
        lights = torch.from_numpy(record.directions[frontal])
        truth = record.image(record.visibility[:, frontal].astype(np.float32))
        surface = record.image(record.normals)
        rgb, mask = photographed(record, (0, index))
        for model, passes in itertools.product(given.model, given.passes):
            name, size = Path(model).stem + (f", {passes} of 2 passes" if passes else ""), record.mask.shape
            found = {name: inferred(rgb, mask, lights, model, passes)}
            if not given.whole:
                normals, maps = inferred(*halved(rgb, mask), lights, model, passes)
                turned = F.normalize(enlarged(normals, size), dim=0)
                found[f"{name}, half the photograph"] = turned, enlarged(maps, size)
            for label, (normals, maps) in found.items():
                rows.setdefault(label, []).append(scored(normals, maps, record, surface, truth, lights))
    # A view without a face or hands counts for the other columns only.
    keys = list(dict.fromkeys(key for views in rows.values() for view in views for key in view))
    print("| | " + " | ".join(keys) + " |")
    print("|---" * (len(keys) + 1) + "|")
    for label, views in rows.items():
        means = [np.mean([view[key] for view in views if key in view]) for key in keys]
        print(f"| {label} | " + " | ".join(f"{mean:.4f}" for mean in means) + " |")


if __name__ == "__main__":
    main()
