"""Count the mistakes of binary visibility maps by kind. Prints, over all pixels and frontal lights, the share
of each kind, and the share of it that the field and the sign(N·L) test on the field's normals get wrong.

python benchmarks/mistakes.py [SCAN ...]

Figures are ten bodies of the generalisation split, or scans (.glb). The camera of Section 3 sees each from
two sides, each view under one random lighting. A shadow's kind is its distance to the surface that casts it:
a near shadow comes from a fold or a chin, a far one from an arm or the other leg.

Figures of shipped weights, to compare with, are in docs/history.md.
"""

import sys

import numpy as np
import torch
from rich.progress import track

import shadow
from shadow.data.lightings import random_lighting
from shadow.data.photographs import light, photograph
from shadow.data.records import Record
from shadow.directions import olat
from shadow.lightstage import stage
from shadow.lightstage.scene import OFFSET, Scene

SIZE = 448  # pixels of the photograph's side
PIXELS = 2500  # of each view, at random
EDGES = np.array([0.03, 0.08, 0.2, 0.5])  # metres
KINDS = (
    "facing away",
    "in the light",
    "in shadow, of what is nearer than 3 cm",
    "in shadow, of what is 3 to 8 cm away",
    "in shadow, of what is 8 to 20 cm away",
    "in shadow, of what is 20 to 50 cm away",
    "in shadow, of what is farther away",
)


def kinds(scene, surface, lights):
    """(N, D) index into KINDS of each point of the Surface under each of the lights (D, 3)."""
    facing = surface.facing(lights)
    kind = np.where(facing, KINDS.index("in the light"), KINDS.index("facing away"))
    point, which = np.nonzero(facing)
    origins = (surface.position + OFFSET * surface.geometric)[point]
    occluded, occluders = scene.trace(origins, lights[which])
    distance = np.linalg.norm(occluders.position - origins[occluded], axis=1)
    kind[point[occluded], which[occluded]] = 2 + np.searchsorted(EDGES, distance)
    return kind


def mistakes(figure, view, seed):
    """Of random points of a view: their kinds (N, D), and where the field (N, D) and the sign test (N, D) are
    wrong."""
    rng, frontal = np.random.default_rng(seed), olat()
    scene = Scene(figure, view.rotation(), view.position())
    seen, surface = scene.trace(*stage.camera_rays(view, SIZE))
    inside, lights = seen.reshape(SIZE, SIZE), olat(behind=True)
    record = Record.of(inside, surface.normal, surface.albedo, scene.visibility(surface, lights), lights)
    mask = torch.from_numpy(inside).float()[None]
    lit = record.image(light(record, random_lighting(rng, lights)))
    rgb = (photograph(lit, mask, rng) * mask).permute(1, 2, 0)
    normals = shadow.infer_normals(rgb, mask[0])
    maps = shadow.infer(rgb, mask[0], frontal)
    points = rng.choice(len(surface), min(PIXELS, len(surface)), replace=False)
    found = [image[:, inside][:, points].T > 0.5 for image in (maps, shadow.baseline(normals, frontal))]
    kind = kinds(scene, surface.take(points), frontal)
    truth = kind == KINDS.index("in the light")
    return kind, *(estimate.numpy() != truth for estimate in found)


def main(scans):
    sources = [stage.FigureSource.scan(path) for path in scans]
    sources = sources or [stage.FigureSource.body(seed, "generalisation") for seed in range(0, 20, 2)]
    found = []
    for number, source in enumerate(track(sources, "figures")):
        figure = source.load()
        found += [mistakes(figure, view, (number, side)) for side, view in enumerate(stage.views(2))]
    kind, field, sign = (np.concatenate([each[k].ravel() for each in found]) for k in range(3))
    print("| pixel and light | of all, % | wrong: field, % | wrong: sign(N·L), % |")
    print("|---|---|---|---|")
    for index, name in enumerate(KINDS):
        mine = kind == index
        share = (f"{100 * (mine & wrong).mean():.2f}" for wrong in (mine, field, sign))
        print(f"| {name} | " + " | ".join(share) + " |")
    print(f"| all | 100.0 | {100 * field.mean():.2f} | {100 * sign.mean():.2f} |")


if __name__ == "__main__":
    main(sys.argv[1:])
