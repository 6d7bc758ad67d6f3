"""Both networks' analysis of one image, as a multiple of one float32 forward of the paper's per-light network
(ResB 7) on the same canvas: a ratio within one run, so that it holds on any machine.

OMP_NUM_THREADS=1 taskset -c 1 python benchmarks/analysis.py [image]
"""

import sys
import time
from pathlib import Path
from statistics import median

import torch

import relight
from shading import Analysis, diffuse
from shadow import analysis
from shadow.framing import Framed
from shadow.networks import precision
from shadow.networks.unet import PerLight

REPEATS = 9


def seconds(function):
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def main(path):
    image = torch.from_numpy(relight.read(path)).permute(2, 0, 1)
    field, shader = analysis.load(), diffuse.load()
    framed = Framed.of(image[:3] / image[3:].clamp_min(0.05), image[3], field.size)
    per_light = PerLight(latent="resb7").eval().to(memory_format=torch.channels_last)  # untrained: as fast
    inputs = torch.rand(1, 4, *framed.mask.shape), torch.rand(1, 3, *framed.mask.shape)
    light = torch.tensor([[[0.0, 0.0, 1.0]]])

    def ours():
        """Normals, visibility and shading for any light, albedo."""
        return Analysis(framed, field, shader)

    def ours_in_float32():
        native, precision.native_bfloat16 = precision.native_bfloat16, lambda device: False
        try:
            return ours()
        finally:
            precision.native_bfloat16 = native

    @torch.no_grad()
    def theirs():
        return per_light(*inputs, light)

    found = {"resb7, one forward": theirs, "analysis": ours, "analysis in float32": ours_in_float32}
    times = {name: [seconds(function) for _ in range(REPEATS)] for name, function in found.items()}
    unit = median(times["resb7, one forward"])
    print(f"{' x '.join(map(str, framed.mask.shape))}, {torch.get_num_threads()} threads, ", end="")
    print("bfloat16" if precision.native_bfloat16("cpu") else "no native bfloat16")
    for name, spent in times.items():
        print(f"{name}: {median(spent):.3f} s, {median(spent) / unit:.2f} times")


if __name__ == "__main__":
    main(*sys.argv[1:] or [Path(__file__).parents[1] / "examples" / "person.png"])
