"""Measure how long a person is cut out of a photograph, against one float32 forward of the paper's per-light
network (ResB 7) at 512 x 384.

The photograph is scaled to the size of a frame of HD (1080 rows) and to 12 megapixels (4000 rows or columns).
Times are processor time, the quickest of several calls, in float32; ratios are taken within one run. A good
ratio is at most 4 for HD and 5 for 12 megapixels. Needs both networks of `relight fetch`.

    OMP_NUM_THREADS=1 python benchmarks/cutout.py [photograph]
"""

import sys

import numpy as np
import torch
from skimage import data
from timing import quickest

import relight
from relight.matting.people.finder import FoundPerson
from relight.matting.refine import encoded_srgb, opaque_photograph
from relight.media.resampling import resize
from shadow.networks import precision
from shadow.networks.unet import PerLight

REPEATS = 5
CANVAS = (512, 384)  # pixels
SIZES = {"HD": 1080, "12 megapixels": 4000}  # pixels, the shorter side of HD, the longer one


def main(path=None):
    photograph = encoded_srgb(opaque_photograph(relight.read(path) if path else data.astronaut()))
    per_light = PerLight(latent="resb7").eval().to(memory_format=torch.channels_last)  # untrained: as fast
    inputs = torch.rand(1, 4, *CANVAS), torch.rand(1, 3, *CANVAS), torch.tensor([[[0.0, 0.0, 1.0]]])

    @torch.no_grad()
    def one_forward():
        return per_light(*inputs)

    with precision.using("float32"):
        one_forward()
        forward = quickest(one_forward, REPEATS)
        print(f"resb7, one forward: {forward:.3f} s")
        for name, side in SIZES.items():
            of = min if name == "HD" else max
            scale = side / of(photograph.shape[:2])
            size = tuple(round(n * scale) for n in photograph.shape[:2])
            picture = np.ascontiguousarray(resize(photograph, size).clip(0, 1))
            model = FoundPerson()
            model(picture)
            seconds = quickest(lambda picture=picture, model=model: model(picture), REPEATS)
            print(f"{name}, {size[1]} x {size[0]}: {seconds:.3f} s, {seconds / forward:.2f} times")


if __name__ == "__main__":
    main(*sys.argv[1:2])
