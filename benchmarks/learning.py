"""Time a step of training the field in float32, with PyTorch's gradients of the weights of 3 x 3 convolutions
and with those by minimal filtering. Prints processor time of a core for a photograph, the least of several.

OMP_NUM_THREADS=1 python benchmarks/learning.py [--size 512] [--batch 4]
"""

import argparse

import torch
from timing import quickest

from shadow.framing import canvas_size
from shadow.networks.field import VisibilityField
from shadow.networks.winograd import Conv3x3

REPEATS = 3


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--batch", type=int, default=4)
    given = parser.parse_args()
    height, width = canvas_size(given.size)
    field = VisibilityField(given.size, depth=True).to(memory_format=torch.channels_last)
    image = torch.rand(given.batch, 4, height, width).contiguous(memory_format=torch.channels_last)
    blocks = torch.arange(height * width // 4)[::32].expand(given.batch, -1)

    def step():
        field.zero_grad()
        sum(maps.square().mean() for maps in field(image, blocks)).backward()

    ours = Conv3x3._learns_quicker
    times = {}
    for label, learns_quicker in {"PyTorch": lambda *_: False, "minimal filtering": ours}.items():
        Conv3x3._learns_quicker = learns_quicker
        times[label] = quickest(step, REPEATS) / given.batch
        print(f"{label}: {times[label]:.2f} s a photograph", flush=True)
    print(f"ratio {times['minimal filtering'] / times['PyTorch']:.2f}")


if __name__ == "__main__":
    main()
