"""Measure 64 OLAT shadings of one 512 x 512 image by the one-pass networks, with all steps included, against
forwards of the paper's ResB 7 at 512 x 512. Prints ratios from one run, which are comparable between
machines.

python benchmarks/olat.py [image]
"""

import sys
import time
from pathlib import Path

import numpy as np
import torch
from timing import quickest

import relight
import shading
from shadow.directions import olat
from shadow.networks.unet import UNet

SIZE = 512
REPEATS = 5


def main(path):
    image = relight.read(path)
    step = -(-max(image.shape[:2]) // SIZE)  # whole pixels, so that the picture needs no filter
    plate = np.zeros((SIZE, SIZE, 4), np.float32)
    small = image[::step, ::step]
    plate[: small.shape[0], : small.shape[1]] = small
    rgb, mask, lights = plate[..., :3].copy(), plate[..., 3].copy(), olat()
    network = UNet(latent="resb7").eval().to(memory_format=torch.channels_last)  # untrained: as fast
    x = torch.rand(1, 9, SIZE, SIZE).to(memory_format=torch.channels_last)
    with torch.no_grad():
        theirs = quickest(lambda: network(x), REPEATS, time.perf_counter)
    ours = quickest(lambda: shading.infer(rgb, mask, lights), REPEATS, time.perf_counter)
    print(f"{torch.get_num_threads()} threads: 64 shadings of {SIZE} x {SIZE} by shading.infer {ours:.3f} s;")
    print(f"a forward of resb7 {theirs:.3f} s: as much as {ours / theirs:.2f} of them")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[1] / "examples" / "person.png")
