"""Measure how well painted lights are found again, and how long it takes.

python benchmarks/painting.py RECORDS [views]

Bodies of the light stage are analysed, and a picture of them in one to three random lights is given as what
was painted. View number k has the seed k. The picture is rendered from the analysis, or, in the second row,
from the record's true normals, visibility and albedo. A light counts as found if the solution has one within
10 degrees whose power differs by less than 10 % in each colour. A picture does not tell a bright light from a
light skin, so the truth is also compared up to a common scale: powers are then shares of all light, in each
colour. The time is processor time of one thread for two strokes, brighter at left and darker at right.

Figures to compare with are in docs/lights.md.
"""

import sys
import warnings

import numpy as np
import torch
from rich.progress import track
from timing import quickest

import relight
from relight.light_painting import LightPainter
from shadow.data import photographs
from shadow.data.records import Records

KEY = relight.DirectionalLight(azimuth=0, elevation=10, intensity=0.8, name="key")
APART = 35.0  # degrees, of the lights of a picture at least
BEHIND = -0.2  # z of their directions at least


def photograph(record, weights):
    return record.image(photographs.light(record, weights)).permute(1, 2, 0).numpy()


def lights_for(record, rng):
    """One to three of the record's lights, in random colours, and their weights (D, 3)."""
    chosen, count = [], rng.integers(1, 4)
    candidates = rng.permutation(np.flatnonzero(record.directions[:, 2] > BEHIND))
    for index in candidates:
        cosines = record.directions[chosen] @ record.directions[index]
        if not chosen or cosines.max() < np.cos(np.radians(APART)):
            chosen.append(index)
        if len(chosen) == count:
            break
    weights = np.zeros((len(record.directions), 3), np.float32)
    weights[chosen] = rng.uniform(0.5, 2, (len(chosen), 1)) * rng.uniform(0.6, 1, (len(chosen), 3))
    lights = [
        relight.DirectionalLight(record.directions[k].tolist(), colour=weights[k].tolist()) for k in chosen
    ]
    return lights, weights


def errors(found, true):
    """Of each true light: degrees to the nearest found one; the difference of its power, and of its share."""
    whole, all_found = (np.sum([each.power for each in lights], axis=0) for lights in (true, found))
    for light in true:
        cosines = [np.dot(each.direction, light.direction) for each in found] or [-1.0]
        nearest = int(np.argmax(cosines))
        power = found[nearest].power if found else np.zeros(3)
        share = power / np.maximum(all_found, 1e-9)
        yield (
            np.degrees(np.arccos(np.clip(cosines[nearest], -1, 1))),
            np.abs(power / light.power - 1).max(),
            np.abs(share / (light.power / whole) - 1).max(),
        )


def strokes(size):
    left, right = np.zeros(size, np.float32), np.zeros(size, np.float32)
    left[:, : size[1] // 2], right[:, size[1] // 2 :] = 1, 1
    return [(left, 1.5), (right, 0.7)]


def main(folder, views=12):
    torch.set_num_threads(1)
    warnings.simplefilter("ignore", UserWarning)
    records = Records([folder])
    tables = {"from the analysis": [], "from the truth": []}
    extra, times = {name: [] for name in tables}, []
    for index in track(records.spread(int(views)), "views"):
        record, rng = records[index], np.random.default_rng(index)
        soft = np.full((len(record.directions), 3), 0.01, np.float32)
        soft[int(np.argmax(record.directions @ (-0.5, 0.5, 0.7)))] = 1
        subject = relight.Subject(photograph(record, soft) * 0.5, record.mask.astype(np.float32))
        true, weights = lights_for(record, rng)
        painter = LightPainter(subject, KEY)
        truth = np.concatenate([photograph(record, weights) * 0.5, record.mask[..., None]], axis=2)
        pictures = {"from the analysis": subject.relit(true), "from the truth": np.float32(truth)}
        for name, picture in pictures.items():
            found = painter.solve(picture).lights
            tables[name] += errors(found, true)
            extra[name].append(len(found) - len(true))
        times.append(
            quickest(lambda painter=painter, subject=subject: painter.solve(strokes(subject.size)), 3)
        )
    print("| picture rendered | lights | found | up to a scale | within 10 degrees | too many |")
    print("|---|---|---|---|---|---|")
    for name, rows in tables.items():
        degrees, power, share = np.array(rows).T
        near = degrees < 10
        hits = [100 * hit.mean() for hit in (near & (power < 0.1), near & (share < 0.1), near)]
        told = " | ".join(f"{hit:.0f} %" for hit in hits)
        print(f"| {name} | {len(rows)} | {told} | {np.mean(extra[name]):.1f} |")
    print("\n| picture rendered | median, 90 %: degrees | power | share |\n|---|---|---|---|")
    for name, rows in tables.items():
        middle, high = np.percentile(rows, (50, 90), axis=0) * (1, 100, 100)
        cells = [f"{a:.1f}, {b:.1f}" for a, b in zip(middle, high, strict=True)]
        print(f"| {name} | {cells[0]} | {cells[1]} % | {cells[2]} % |")
    print(f"\nTwo strokes are solved in {1e3 * np.median(times):.0f} ms, {1e3 * max(times):.0f} at most.")


if __name__ == "__main__":
    main(*sys.argv[1:])
