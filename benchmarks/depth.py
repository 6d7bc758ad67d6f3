"""Score the depth of a person on records with the true depth: the field's, that of the normals, and both.

python benchmarks/depth.py RECORDS [--views 32] [--model field.safetensors]

"Field" is the network's own output, "normals" is integrated from its normals alone. "Both" is what
`Subject.depth` gives: integrated from the normals, with the low frequencies of the field's depth. Errors are
per cent of the height that the matte shows; "order" is the fraction of pixel pairs across limb borders whose
order is right (`shadow.evaluation.metrics`). Each record is photographed once under a random lighting.

Figures of shipped weights, to compare with, are in docs/history.md.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from rich.progress import track

import shadow
from relight.analysis.camera import Camera
from relight.analysis.depth import WorldGeometry
from shadow import visibility
from shadow.data.photographs import photograph, sample
from shadow.data.records import Records
from shadow.evaluation.metrics import depth_error, depth_order
from shadow.framing import bounding_box, canvas_size


def scores(record, size, model, rng):
    """{source: (error, order)} of a view."""
    drawn = sample(record, rng, size, lights=1, augment=False)
    rgb, truth = photograph(drawn["rgb"], drawn["mask"], rng), drawn["depth"][0]
    matte = drawn["mask"][0].clamp(0, 1)  # resampled, and beyond 1 by rounding
    analysis, camera = shadow.analyse(rgb.permute(1, 2, 0), matte, model=model), Camera.of(matte)
    both = WorldGeometry.of(analysis, camera, analysis.framed.framing, matte)
    top, _, bottom, _ = bounding_box(matte)
    height = (bottom - top) * camera.metres_per_pixel
    normals = WorldGeometry.of(analysis, camera, analysis.framed.framing, matte, own_normals=False)
    found = {"flat": torch.zeros_like(truth)}
    for name, geometry in (("normals", normals), ("both", both)):
        found[name] = analysis.framed.restored(geometry.depth[None])[0] / height
    if analysis.depth is not None:
        found["field"] = analysis.depth
    return {
        name: [float(score(depth, truth, matte > 0.5)) for score in (depth_error, depth_order)]
        for name, depth in found.items()
    }


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("records", type=Path)
    parser.add_argument("--views", type=int, default=32)
    parser.add_argument("--model", default="field")
    given = parser.parse_args()
    records, size = Records([given.records]), canvas_size(visibility.load(given.model).size)
    found = [
        scores(records[index], size, given.model, np.random.default_rng((0, index)))
        for index in track(records.spread(given.views), "scoring")
    ]
    print("| depth from | error, % of the height | order |\n|---|---|---|")
    for name in found[0]:
        error, order = np.nanmean([view[name] for view in found], axis=0)
        print(f"| {name} | {error:.2f} | {order:.3f} |")


if __name__ == "__main__":
    main()
