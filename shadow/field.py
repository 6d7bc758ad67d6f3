"""The one-pass visibility field: one forward gives visibility for every light direction.

visibility(p, L) = attached(N(p)·L) × cast(w(L)·f(p))

`attached` is the surface turning away, from the normals; `cast` is an occluder in between, learned. Feature
k of f is the logit of anchor direction k, and w(L) interpolates between the anchors near L. The head starts
at zero: the untrained field is the sign(N·L) baseline of Section 4.1, and training adds cast shadow.
"""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import nn

from shadow.backbone import Backbone, encode_image, take_blocks
from shadow.directions import olat

LIT = 3.0  # cast logit of the untrained field: sigmoid(3) = 0.95, lit
SHARPNESS = 20.0  # slope of the untrained gate in N·L
KAPPA = 50.0  # concentration of an anchor's kernel: half weight at 10 degrees, anchors stand 18 apart


def anchor_weights(directions, anchors):
    """w(L): (..., D, 3) unit directions and (K, 3) anchors to (..., D, K) weights that sum to one."""
    return torch.softmax(KAPPA * (directions @ anchors.T), dim=-1)


class FieldMaps(NamedTuple):
    """What the image alone decides; everything about a light is a dot product with these."""

    cast: torch.Tensor  # (B, K, H, W) cast-shadow logit of each anchor direction, relative to LIT
    normals: torch.Tensor  # (B, 3, H, W) the unit normals given, which gate the attached shadow
    sharpness: torch.Tensor  # (B, 1, H, W) slope of the gate: low where the normals are uncertain

    def at(self, take):
        """The maps where `take` takes them from (B, C, H, W)."""
        return FieldMaps(*(take(image) for image in self))


class VisibilityField(nn.Module):
    def __init__(self, size=256, **backbone):
        super().__init__()
        self.size = size  # canvas height that the network was trained for
        self.register_buffer("anchors", torch.from_numpy(olat(behind=True)), persistent=False)
        self.backbone = Backbone(7, len(self.anchors) + 1, **backbone)

    def forward(self, image, normals, blocks=None):
        """Encoded image and mask (B, 4, H, W) and normals (B, 3, H, W) to FieldMaps; or to what
        `take_blocks` takes of them, which saves the training the memory of all lights at all pixels."""
        maps = self.backbone(torch.cat([image, normals], dim=1), blocks).float()
        normals = normals if blocks is None else take_blocks(normals, blocks)
        cast, log_sharpness = maps.split([len(self.anchors), 1], dim=1)
        return FieldMaps(cast, normals, SHARPNESS * log_sharpness.clamp(-3, 3).exp())

    def log_visibility(self, maps, directions):
        """Logarithm of the visibility (B, D, H, W) of unit directions (B, D, 3)."""
        attached = maps.sharpness * torch.einsum("bdc,bchw->bdhw", directions, maps.normals)
        cast = torch.einsum("bdk,bkhw->bdhw", anchor_weights(directions, self.anchors), maps.cast)
        return F.logsigmoid(attached) + F.logsigmoid(cast + LIT)

    @torch.no_grad()
    def analyse(self, rgb, mask, normals):
        """Framed rgb (3, h, w), mask (h, w) and normals (3, h, w) to a function of directions.

        The function takes unit directions (D, 3) and returns their visibility (D, h, w) in [0, 1], zero
        outside the mask; it runs no network.
        """
        inside = mask > 0  # a light costs the subject's pixels only, some quarter of the canvas
        maps = self(encode_image(rgb[None], mask[None, None]), normals[None])
        maps = FieldMaps(*(canvas[..., inside][..., None] for canvas in maps))

        def visibility(directions):
            with torch.no_grad():
                canvas = rgb.new_zeros(len(directions), *mask.shape)
                canvas[:, inside] = self.log_visibility(maps, directions[None])[0, ..., 0].exp()
                return canvas

        return visibility
