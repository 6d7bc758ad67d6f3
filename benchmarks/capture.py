"""What cameras, files and mattes cost: normals and binary visibility inferred from the same photographs as
they are and as they might have been.

python benchmarks/capture.py RECORDS [field.safetensors] [views]

Views and lightings are those of `relight evaluate`; scores are of what both mattes show.
"""

import sys
from dataclasses import replace

import numpy as np
import torch
import torch.nn.functional as F
from lighting import table

from shadow.data.photographs import LUMINANCE, compress, rough_matte, sharpen
from shadow.evaluation.scores import View


def grey(rgb):
    return torch.einsum("chw,c->hw", rgb, torch.from_numpy(LUMINANCE)).expand(3, -1, -1)


def shrunk(rgb, factor):
    """The image (3, H, W) brought down by `factor` and up again."""
    small = F.avg_pool2d(rgb[None], factor)
    return F.interpolate(small, rgb.shape[1:], mode="bilinear")[0]


def tinted(rgb, red, blue):
    return rgb * torch.tensor([red, 1, blue]).view(3, 1, 1)


def photographs(record, seed, height):
    """Names, and Views of the record on a canvas of `height` pixels, the clean one first."""
    view = View.of(record, seed, height)
    rgb = view.rgb.cpu()
    worse = {
        "as it is": rgb,
        "JPEG, quality 50": compress(rgb, 50),
        "JPEG, quality 20": compress(rgb, 20),
        "blurred": sharpen(rgb, 0),
        "sharpened": sharpen(rgb, 4),
        "half the resolution": shrunk(rgb, 2),
        "a quarter of it": shrunk(rgb, 4),
        "white balance of daylight under a bulb": tinted(rgb, 1.5, 0.5),
        "black and white": grey(rgb),
    }
    views = {name: replace(view, rgb=image.to(view.rgb)) for name, image in worse.items()}
    matte = rough_matte(view.mask.cpu()[None], np.random.default_rng(seed))[0]
    return views | {"rough matte": replace(view, mask=matte.to(view.mask))}


if __name__ == "__main__":
    table(photographs, *sys.argv[1:])
