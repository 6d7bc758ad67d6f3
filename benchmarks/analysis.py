"""Measure the analysis of one image against one float32 forward of the paper's per-light network (ResB 7),
and a whole `relight.Subject` against one that keeps the old light's colour and noise in the albedo.

All see the same canvas, and ratios are taken within one run, so that they can be compared between machines.
Times are processor time, the quickest of several calls.

    OMP_NUM_THREADS=1 python benchmarks/analysis.py [image]

A good ratio to the forward is at most 0.6, and of the two subjects at most 1.1.
"""

import sys
from pathlib import Path
from unittest import mock

import torch
from timing import quickest

import relight
from relight.analysis import infer
from relight.analysis.old_light import OldLight
from shading import Analysis, diffuse
from shadow import analysis
from shadow.framing import Framed
from shadow.networks import precision
from shadow.networks.unet import PerLight

REPEATS = 9


def main(path):
    image = torch.from_numpy(relight.read(path)).permute(2, 0, 1)
    field, shader = analysis.load(), diffuse.load()
    framed = Framed.of(image[:3] / image[3:].clamp_min(0.05), image[3], field.size)
    per_light = PerLight(latent="resb7").eval().to(memory_format=torch.channels_last)  # untrained: as fast
    inputs = torch.rand(1, 4, *framed.mask.shape), torch.rand(1, 3, *framed.mask.shape)
    light = torch.tensor([[[0.0, 0.0, 1.0]]])

    def both_networks():
        """Normals, visibility and shading for any light, albedo."""
        return Analysis(framed, field, shader)

    def both_networks_in_float32():
        with precision.using("float32"):
            return both_networks()

    @torch.no_grad()
    def one_forward():
        return per_light(*inputs, light)

    plate = image.permute(1, 2, 0).numpy()

    def subject():
        return relight.Subject(plate)

    def subject_with_old_colour():
        with mock.patch.object(infer, "denoised", lambda colour, *_: colour):
            return relight.Subject(plate, old_light=OldLight())

    functions = {
        "resb7, one forward": one_forward,
        "analysis": both_networks,
        "analysis in float32": both_networks_in_float32,
        "subject": subject,
        "subject with the old colour and noise": subject_with_old_colour,
    }
    for function in functions.values():
        function()
    times = {name: quickest(function, REPEATS) for name, function in functions.items()}
    print(f"{' x '.join(map(str, framed.mask.shape))}, {torch.get_num_threads()} threads, ", end="")
    print("bfloat16" if precision.native_bfloat16("cpu") else "no native bfloat16")
    for name, seconds in times.items():
        print(f"{name}: {seconds:.3f} s, {seconds / times['resb7, one forward']:.2f} times")
    whole, coloured = list(times.values())[-2:]
    print(f"subjects: {whole / coloured:.3f} times")


if __name__ == "__main__":
    main(*sys.argv[1:] or [Path(__file__).parents[1] / "examples" / "person.png"])
