"""Measure 64 visibility maps of the one-pass field against 64 forwards of the paper's per-light network (ResB
7), with the forward that infers its normals. Prints ratios from one run, which are comparable between
machines.

python benchmarks/per_light.py [image] [mask]

Figures to compare with are in docs/paper.md.
"""

import sys
import time
from pathlib import Path

import torch

import relight
from shadow import inputs, visibility
from shadow.directions import olat
from shadow.framing import Framing
from shadow.networks.unet import PerLight

REPEATS = 7


def seconds(function, repeats):
    """The mean of several calls: 64 forwards in a row are a mean too."""
    start = time.perf_counter()
    for _ in range(repeats):
        function()
    return (time.perf_counter() - start) / repeats


def main(path, mask=None):
    image = relight.read(path)
    alpha = image[..., 3] if mask is None else relight.read_mask(mask)
    matte = inputs.mask("mask", alpha, image.shape[:2])
    rgb = torch.from_numpy(image[..., :3].copy()).permute(2, 0, 1)
    lights = torch.from_numpy(olat())
    field = visibility.load()
    per_light = PerLight(latent="resb7").eval().to(memory_format=torch.channels_last)  # untrained: as fast
    print(f"{len(lights)} lights, {torch.get_num_threads()} threads")

    def compare(height):
        framing = Framing.around(matte, height)
        framed, framed_mask = framing.crop(rgb), framing.crop(matte[None])[0]

        def ours():
            _, visibility = field.analyse(framed, framed_mask)
            return visibility(lights)

        def theirs():
            _, visibility = per_light.analyse(framed, framed_mask, field.normals(framed, framed_mask))
            return visibility(lights)

        ours()  # warms up
        one_pass, one_a_light = seconds(ours, REPEATS), seconds(theirs, 1)
        size = " x ".join(map(str, framing.canvas))
        ratio = one_a_light / one_pass
        print(f"{size}: field {one_pass:.3f} s; resb7 {one_a_light:.1f} s; ratio {ratio:.0f}", flush=True)

    compare(field.size)
    compare(512)  # the paper's


if __name__ == "__main__":
    main(*sys.argv[1:] or [Path(__file__).parents[1] / "examples" / "person.png"])
