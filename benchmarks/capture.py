"""Measure how cameras, file formats and mattes change the analysis: infer normals and binary visibility from
the same photographs, clean and degraded. Prints the scores of each degradation.

python benchmarks/capture.py RECORDS [field.safetensors] [views]

Views and lightings are those of `relight evaluate`. Only pixels that are in both mattes are scored.

Figures of shipped weights, to compare with, are in docs/history.md.
"""

import sys
from dataclasses import replace

import numpy as np
import torch
import torch.nn.functional as F
from lighting import table

from shadow.data.lightings import LUMINANCE
from shadow.data.photographs import MatteError, PictureStyle, compress, sharpen
from shadow.data.records import ENCODING
from shadow.evaluation.scores import ScoredView


def grey(rgb):
    return torch.einsum("chw,c->hw", rgb, torch.from_numpy(LUMINANCE)).expand(3, -1, -1)


def shrunk(rgb, factor):
    """The image (3, H, W) brought down by `factor` and up again."""
    small = F.avg_pool2d(rgb[None], factor)
    return F.interpolate(small, rgb.shape[1:], mode="bilinear")[0]


def tinted(rgb, red, blue):
    return rgb * torch.tensor([red, 1, blue]).view(3, 1, 1)


def styled(rgb, style):
    return style(rgb.clamp(0, 1) ** (1 / ENCODING)) ** ENCODING


def photographs(record, seed, height):
    """Names, and Views of the record on a canvas of `height` pixels, the clean one first."""
    view = ScoredView.of(record, seed, height)
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
        "contrast and colours of a phone": styled(rgb, PictureStyle(4, 0.5, 1.3, 0.4)),
        "flat raw development": styled(rgb, PictureStyle(0, 0.5, 0.8, 0)),
    }
    views = {name: replace(view, rgb=image.to(view.rgb)) for name, image in worse.items()}
    matte = MatteError.draw(np.random.default_rng(seed))(view.mask.cpu()[None])[0]
    return views | {"rough matte": replace(view, mask=matte.to(view.mask))}


if __name__ == "__main__":
    table(photographs, *sys.argv[1:])
