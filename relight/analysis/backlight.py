"""Where the light from behind gives a rim: along the outline before the background.

Edges before the body get none: a jaw before the neck, a lapel before the shirt.

`relight.analysis.gloss` gives the outline of a limb the light that grazes it. Light from behind reaches an
outline before the background, but none before the body, where another surface is in its way.

From each pixel of a rim, a line goes outward along the normal. A limb turns away from the camera there, up to
its outline. If the line comes to a pixel that faces the camera more before it leaves the person, this is
another surface, behind the limb.

A rim is as narrow as hair, skin and cloth let light graze past them, however large the picture shows a head.
Normals alone would make a broad veil of it in close pictures, and on hair, whose inferred surface is smooth.
So it falls off with the distance from the outline.

Only the gloss lacks this light. Diffuse light on the same pixels is as often blocked as it is not, so their
visibility is better left to the network (docs/history.md).
"""

import numpy as np
import torch
import torch.nn.functional as F

from relight.analysis.gloss import outline
from shadow.framing import Framing
from shadow.networks.mirror import Pixels

RIM = 0.02  # of `gloss.outline`: with less, a pixel has no rim
RISE = (0.1, 0.3)  # of N·V along the line: up to the first it is one surface, from the second there are two
REACH, STRIDE = 64, 1.5  # of the line, pixels of the canvas, and the ratio of its steps
WIDTH = 0.025  # of the canvas's height: distance from the outline at which no rim is left
HALF = 2  # pixels of the canvas, side of the blocks that are smoothed
SMOOTH = 3  # blocks, side of the box that smooths them, twice


def open_rims(silhouette: Pixels, normals: torch.Tensor, framing: Framing) -> torch.Tensor:
    """Return how much of each pixel's rim is at the outline before the background: (1, N) in [0, 1], smooth.

    `normals` (3, N): those at the pixels of the silhouette. `framing`: of the canvas on the plate. It is 0 at
    an edge before the body, and where the plate's frame cuts the person.
    """
    rim = (outline(normals[2]) > RIM).nonzero()[:, 0]
    share = torch.ones_like(normals[:1])
    if len(rim):
        share[0, rim] -= _before_the_body(silhouette, normals, rim)
    return share.clamp_(0, 1).mul_(_at_the_outline(silhouette, framing))


def _at_the_outline(silhouette: Pixels, framing: Framing) -> torch.Tensor:
    """Return a share (N,): 1 up to WIDTH / 4 from the outline, 0 from WIDTH on; 1 on what is narrower."""
    height, width = silhouette.shape
    covered = torch.zeros(1, height * width)
    covered[:, silhouette.pixels] = 1
    covered = covered.unflatten(1, silhouette.shape)
    (x, y), scale = framing.centre, framing.scale  # beyond the plate, the person goes on
    left, right = (round(width / 2 + scale * (edge - x)) for edge in (0, framing.plate[1]))
    top, bottom = (round(height / 2 + scale * (edge - y)) for edge in (0, framing.plate[0]))
    for outside in (np.s_[: max(top, 0)], np.s_[max(bottom, 0) :]):
        covered[:, outside] = 1
    for outside in (np.s_[: max(left, 0)], np.s_[max(right, 0) :]):
        covered[:, :, outside] = 1
    reach = max(1, round(WIDTH * height / HALF))
    blocks = F.pad(F.avg_pool2d(covered[None], HALF), (reach,) * 4, value=1)
    covered = F.avg_pool2d(F.avg_pool2d(blocks, (1, 2 * reach + 1), 1), (2 * reach + 1, 1), 1)
    share = ((1 - covered) / 0.375).clamp_(0, 1)  # of windows on a straight outline, half is outside
    return F.interpolate(share, silhouette.shape, mode="bilinear").flatten()[silhouette.pixels]


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
