"""The one-pass network: one forward gives the surface normals, and visibility for every light direction.

visibility(p, L) = attached(N(p)·L) × cast(w(L)·f(p))

`attached` is the surface turning away, from the normals; `cast` is an occluder in between. Feature k of f is
the logit of anchor direction k, and w(L) interpolates between the anchors near L. The head starts at zero:
all faces the camera and nothing casts a shadow.
"""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import nn

from shadow.directions import olat
from shadow.networks.backbone import Backbone, encode_image

LIT = 3.0  # cast logit of the untrained field: sigmoid(3) = 0.95, lit
SHARPNESS = 20.0  # slope of the untrained gate in N·L
KAPPA = 50.0  # concentration of an anchor's kernel: half weight at 10 degrees, anchors stand 18 apart
MIRROR = torch.tensor([-1.0, 1.0, 1.0])  # takes a vector to the camera frame of the mirrored picture


def anchor_weights(directions, anchors):
    """w(L): (..., D, 3) unit directions and (K, 3) anchors to (..., D, K) weights that sum to one."""
    return torch.softmax(KAPPA * (directions @ anchors.T), dim=-1)


def sides(inside):
    """Two functions, that take maps (2, C, h, w) of a photograph and of its mirror image to the values (1, C,
    N, 1) of the one and of the other at the N pixels inside (h, w) the photograph."""
    width = inside.shape[1]
    row, column = inside.nonzero(as_tuple=True)
    own, other = row * width + column, row * width + width - 1 - column
    return (
        lambda maps: maps[:1].flatten(2).index_select(2, own)[..., None],
        lambda maps: maps[1:].flatten(2).index_select(2, other)[..., None],
    )


def both_sides(own, other, anchors):
    """The mean of features (1, K, N, 1) of the anchors (K, 3): a photograph's, and its mirror image's,
    brought to the same anchors, which are not each other's mirror."""
    across = anchor_weights(anchors * MIRROR.to(anchors.device), anchors)
    return (own + torch.einsum("kj,bjnw->bknw", across, other)) / 2


def scatter(values, mask):
    """Values (1, C, N, 1) of the pixels inside the mask (h, w) as a canvas (C, h, w), zero outside."""
    canvas = mask.new_zeros(values.shape[1], mask.numel())
    inside = (mask > 0).flatten().nonzero()[:, 0]
    return canvas.index_copy_(1, inside, values[0, :, :, 0].to(canvas)).unflatten(1, mask.shape)


class FieldMaps(NamedTuple):
    """What the image alone decides; everything about a light is a dot product with these."""

    normals: torch.Tensor  # (B, 3, H, W) unit normals, which gate the attached shadow
    cast: torch.Tensor  # (B, K, H, W) cast-shadow logit of each anchor direction, relative to LIT
    sharpness: torch.Tensor  # (B, 1, H, W) slope of the gate: low where the normals are uncertain

    def at(self, take):
        """The maps where `take` takes them from (B, C, H, W)."""
        return FieldMaps(*(take(image) for image in self))


class VisibilityField(nn.Module):
    def __init__(self, size=256, **backbone):
        super().__init__()
        self.size = size  # canvas height that the network was trained for
        self.register_buffer("anchors", torch.from_numpy(olat(behind=True)), persistent=False)
        self.backbone = Backbone(4, 3 + len(self.anchors) + 1, **backbone)

    def forward(self, image, blocks=None):
        """Encoded image and mask (B, 4, H, W) to FieldMaps; or to what `take_blocks` takes of them, which
        saves the training the memory of all lights at all pixels."""
        maps = self.backbone(image, blocks).float()
        surface, cast, log_sharpness = maps.split([3, len(self.anchors), 1], dim=1)
        toward_camera = torch.tensor([0.0, 0.0, 1.0], device=image.device).view(1, 3, 1, 1)
        normals = F.normalize(surface + toward_camera, dim=1)
        return FieldMaps(normals, cast, SHARPNESS * log_sharpness.clamp(-3, 3).exp())

    def log_visibility(self, maps, directions):
        """Logarithm of the visibility (B, D, H, W) of unit directions (B, D, 3)."""
        attached = maps.sharpness * torch.einsum("bdc,bchw->bdhw", directions, maps.normals)
        cast = torch.einsum("bdk,bkhw->bdhw", anchor_weights(directions, self.anchors), maps.cast)
        return F.logsigmoid(attached) + F.logsigmoid(cast + LIT)

    @torch.no_grad()
    def infer(self, rgb, mask):
        """Framed rgb (3, h, w), linear, and mask (h, w) to the FieldMaps of the N pixels inside it, as
        (1, C, N, 1): the mean of what the network says of the photograph and of its mirror image, since its
        errors there are others."""
        image = encode_image(rgb[None], mask[None, None])
        both = self(torch.cat([image, image.flip(-1)]))
        own, other = (both.at(side) for side in sides(mask > 0))
        mirrored = MIRROR.to(image.device).view(1, 3, 1, 1) * other.normals
        return FieldMaps(
            F.normalize(own.normals + mirrored, dim=1),
            both_sides(own.cast, other.cast, self.anchors),
            (own.sharpness * other.sharpness).sqrt(),
        )

    @torch.no_grad()
    def normals(self, rgb, mask):
        """Framed rgb (3, h, w), linear, and mask (h, w) to unit normals (3, h, w), zero outside the mask."""
        return scatter(self.infer(rgb, mask).normals, mask)

    @torch.no_grad()
    def analyse(self, rgb, mask, normals=None):
        """Framed rgb (3, h, w), linear, and mask (h, w) to unit normals (3, h, w), zero outside the mask, and
        to a function of directions. Normals (3, h, w) that are given take the place of the network's own.

        The function takes unit directions (D, 3) and returns their visibility (D, h, w) in [0, 1], zero
        outside the mask; it runs no network.
        """
        maps = self.infer(rgb, mask)  # a light costs the subject's pixels only, some quarter of the canvas
        if normals is not None:
            maps = maps._replace(normals=normals[None, :, mask > 0, None])

        def visibility(directions):
            with torch.no_grad():
                return scatter(self.log_visibility(maps, directions[None]).exp(), mask)

        return scatter(maps.normals, mask), visibility
