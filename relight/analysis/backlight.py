"""Edges before the body, which get no rim from behind: a jaw before the neck, a lapel before the shirt.

`relight.analysis.gloss` gives the outline of a limb the light that grazes it. Light from behind reaches an
outline before the background, but none before the body, where another surface is in its way.

From each pixel of a rim, a line goes outward along the normal. A limb turns away from the camera there, up to
its outline. If the line comes to a pixel that faces the camera more before it leaves the person, this is
another surface, behind the limb.

Only the gloss lacks this light. Diffuse light on the same pixels is as often blocked as it is not, so their
visibility is better left to the network (docs/history.md).
"""

import torch
import torch.nn.functional as F

from relight.analysis.gloss import outline
from shadow.networks.mirror import Pixels

RIM = 0.02  # of `gloss.outline`: with less, a pixel has no rim
RISE = (0.1, 0.3)  # of N·V along the line: up to the first it is one surface, from the second there are two
REACH, STRIDE = 64, 1.5  # of the line, pixels of the canvas, and the ratio of its steps
HALF = 2  # pixels of the canvas, side of the blocks that are smoothed
SMOOTH = 3  # blocks, side of the box that smooths them, twice


def open_rims(silhouette: Pixels, normals: torch.Tensor) -> torch.Tensor:
    """Return how much of each pixel's rim is before the background: (1, N) in [0, 1], smooth.

    `normals` (3, N): those at the pixels of the silhouette. It is 0 at an edge before the body, and 1 where a
    pixel has no rim.
    """
    rim = (outline(normals[2]) > RIM).nonzero()[:, 0]
    share = torch.ones_like(normals[:1])
    if len(rim):
        share[0, rim] -= _before_the_body(silhouette, normals, rim)
    return share.clamp_(0, 1)


def _before_the_body(silhouette: Pixels, normals: torch.Tensor, rim: torch.Tensor) -> torch.Tensor:
    """Return whether another surface is behind each of the pixels `rim` (N,): (N,) in [0, 1], smooth."""
    height, width = silhouette.shape
    facing = torch.full((height * width,), -1.0)
    facing[silhouette.pixels] = normals[2]
    places, own = silhouette.pixels[rim], normals[2, rim]
    outward = F.normalize(normals[:2, rim], dim=0)
    row, column = places // width, places % width
    most, on_person, step = own, torch.ones_like(own, dtype=torch.bool), 1.0
    while step < REACH:
        x = (column + step * outward[0]).round_().long()
        y = (row - step * outward[1]).round_().long()
        there = facing[y.clamp(0, height - 1) * width + x.clamp(0, width - 1)]
        on_person &= (x >= 0) & (x < width) & (y >= 0) & (y < height) & (there >= 0)
        most = torch.where(on_person, torch.maximum(most, there), most)
        step = max(step + 1, step * STRIDE)
    before = ((most - own - RISE[0]) / (RISE[1] - RISE[0])).clamp_(0, 1)
    weight = outline(own)
    maps = torch.zeros(2, height * width)
    maps[:, places] = torch.stack([weight, weight * before])
    maps = maps.unflatten(1, (height, width))
    blocks = F.avg_pool2d(maps[None], HALF)
    for _ in range(2):
        blocks = F.avg_pool2d(blocks, SMOOTH, stride=1, padding=SMOOTH // 2)
    weight, before = F.interpolate(blocks, (height, width), mode="bilinear")[0].flatten(1)[:, places]
    return before / weight
