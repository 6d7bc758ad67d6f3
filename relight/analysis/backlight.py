"""Light from behind that the body itself blocks: a jaw before the neck, a lapel before the shirt.

Where a surface turns away from a light, no photograph shows whether something else blocks it as well, and the
network's cast shadows say little. `relight.analysis.gloss` asks them there: it gives the rim of a limb the
light that reaches the outline. Light from behind reaches an outline before the background, but none before
the body.

From each pixel of a rim, a line goes outward along the normal. A limb turns away from the camera there, up to
its outline. If the line comes to a pixel that faces the camera more before it leaves the person, this is
another surface, behind the limb.
"""

import torch
import torch.nn.functional as F

from relight.analysis.gloss import outline
from relight.analysis.light_field import ANCHORS, LightField

RIM = 0.02  # of `gloss.outline`: with less, a pixel has no rim
RISE = (0.1, 0.3)  # of N·V along the line: up to the first it is one surface, from the second there are two
REACH, STRIDE = 64, 1.3  # of the line, pixels of the canvas, and the ratio of its steps
SMOOTH = 5  # pixels, side of the box that smooths the result, twice
BEHIND = (0.8, 0.95)  # -L·V of a light: up to the first nothing is blocked, from the second everything
BLOCKED = 4.0  # by which the logit of the visibility of blocked light is less


def without_inner_rims(field: LightField) -> LightField:
    """Return the field in which surfaces behind a rim block the light from behind."""
    rim = (outline(field.normals[2]) > RIM).nonzero()[:, 0]
    if not len(rim):
        return field
    share = ((-ANCHORS[:, 2] - BEHIND[0]) / (BEHIND[1] - BEHIND[0])).clamp(0, 1)
    lights = share.nonzero()
    cast = field.cast.clone()
    cast[lights, rim] -= BLOCKED * share[lights] * _before_the_body(field, rim)
    return field._replace(cast=cast)


def _before_the_body(field: LightField, rim: torch.Tensor) -> torch.Tensor:
    """Return whether another surface is behind each of the pixels `rim` (N,): (N,) in [0, 1], smooth."""
    height, width = field.silhouette.shape
    facing = torch.full((height * width,), -1.0)
    facing[field.silhouette.pixels] = field.normals[2]
    places, own = field.silhouette.pixels[rim], field.normals[2, rim]
    outward = F.normalize(field.normals[:2, rim], dim=0)
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
    for _ in range(2):
        maps = F.avg_pool2d(maps, SMOOTH, stride=1, padding=SMOOTH // 2)
    weight, before = maps.flatten(1)[:, places]
    return before / weight
