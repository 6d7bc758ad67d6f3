"""The one-pass network: one forward gives normals and depth, and visibility for every light direction.

visibility(p, L) = attached(N(p)·L) × cast(w(L)·f(p))

`attached` is the surface turning away, from the normals; `cast` is an occluder in between. Feature k of f is
the logit of anchor direction k, and w(L) interpolates between the anchors near L. The head starts at zero:
all faces the camera, is equally far from it, and nothing casts a shadow.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import torch
import torch.nn.functional as F
from torch import nn

from shadow.directions import olat
from shadow.networks.backbone import Backbone, encode_image
from shadow.networks.mirror import MIRROR, Silhouette, with_mirror
from shadow.networks.precision import autocast

LIT = 3.0  # cast logit of the untrained field: sigmoid(3) = 0.95, lit
SHARPNESS = 20.0  # slope of the untrained gate in N·L
KAPPA = 50.0  # concentration of an anchor's kernel: half weight at 10 degrees, anchors stand 18 apart
STRIP = 2048  # pixels at a time, so that their anchors' weights stay in the cache
REACH = 0.2  # difference of cosines from the nearest anchor at which others weigh 4e-5 of it


def anchor_weights(directions: torch.Tensor, anchors: torch.Tensor) -> torch.Tensor:
    """w(L): (..., D, 3) unit directions and (K, 3) anchors to (..., D, K) weights that sum to one."""
    weights = torch.softmax(KAPPA * (directions @ anchors.T), dim=-1)
    # Those of anchors far away are subnormal numbers, with which a CPU multiplies ten times as slowly.
    return weights * (weights > 1e-12)


def interpolated(directions: torch.Tensor, anchors: torch.Tensor, *maps: torch.Tensor) -> list[torch.Tensor]:
    """w(L)·f of maps (K, N) of the anchors (K, 3), at N pixels with a unit direction each (3, N): (N,) each.

    Pixels that lie together look in about the same direction: few of the anchors count for a strip of them.
    """
    results = [features.new_empty(features.shape[1]) for features in maps]
    for start in range(0, directions.shape[1], STRIP):
        strip = slice(start, start + STRIP)
        cosines = anchors @ directions[:, strip]
        cosines -= cosines.amax(dim=0)
        near = (cosines.amax(dim=1) > -REACH).nonzero()[:, 0]
        weights = cosines[near].mul_(KAPPA).exp_()
        weights /= weights.sum(dim=0)
        for result, features in zip(results, maps, strict=True):
            result[strip] = features[:, strip].index_select(0, near).mul_(weights).sum(dim=0)
    return results


def both_sides(own: torch.Tensor, mirrored: torch.Tensor, anchors: torch.Tensor) -> torch.Tensor:
    """The mean of features (K, N) of the anchors (K, 3): a photograph's, and its mirror image's, brought to
    the same anchors, which are not each other's mirror."""
    across = anchor_weights(anchors * MIRROR.to(anchors.device), anchors)
    return torch.addmm(own, across, mirrored).div_(2)


class FieldMaps(NamedTuple):
    """What the image alone decides; everything about a light is a dot product with these."""

    normals: torch.Tensor  # (B, 3, H, W) unit normals, which gate the attached shadow
    cast: torch.Tensor  # (B, K, H, W) cast-shadow logit of each anchor direction, relative to LIT
    sharpness: torch.Tensor  # (B, 1, H, W) slope of the gate: low where the normals are uncertain
    depth: torch.Tensor  # (B, 1, H, W) away from the camera, in heights of the matte; or (B, 0, H, W), none

    def at(self, take: Callable[[torch.Tensor], torch.Tensor]) -> "FieldMaps":
        """The maps where `take` takes them from (B, C, H, W)."""
        return FieldMaps(*(take(image) for image in self))


class VisibilityField(nn.Module):
    anchors: torch.Tensor  # (K, 3)

    def __init__(self, size: int = 256, depth: bool = False, **backbone: Any) -> None:
        super().__init__()
        self.size = size  # canvas height that the network was trained for
        self.depth = depth  # whether it says how far away the surface is
        self.register_buffer("anchors", torch.from_numpy(olat(behind=True)), persistent=False)
        self.backbone = Backbone(4, 3 + len(self.anchors) + 1 + depth, **backbone)

    def forward(self, image: torch.Tensor, blocks: torch.Tensor | None = None) -> FieldMaps:
        """Encoded image and mask (B, 4, H, W) to FieldMaps; or to what `take_blocks` takes of them, which
        saves the training the memory of all lights at all pixels."""
        maps = self.backbone(image, blocks).float()
        surface, cast, log_sharpness, depth = maps.split([3, len(self.anchors), 1, int(self.depth)], dim=1)
        toward_camera = torch.tensor([0.0, 0.0, 1.0], device=image.device).view(1, 3, 1, 1)
        normals = F.normalize(surface + toward_camera, dim=1)
        return FieldMaps(normals, cast, SHARPNESS * log_sharpness.clamp(-3, 3).exp(), depth)

    def log_visibility(self, maps: FieldMaps, directions: torch.Tensor) -> torch.Tensor:
        """Logarithm of the visibility (B, D, H, W) of unit directions (B, D, 3)."""
        attached = maps.sharpness * torch.einsum("bdc,bchw->bdhw", directions, maps.normals)
        cast = torch.einsum("bdk,bkhw->bdhw", anchor_weights(directions, self.anchors), maps.cast)
        return F.logsigmoid(attached) + F.logsigmoid(cast + LIT)

    @torch.no_grad()
    def infer(self, rgb: torch.Tensor, mask: torch.Tensor) -> tuple[FieldMaps, Silhouette]:
        """Framed rgb (3, h, w), linear, and mask (h, w) to the FieldMaps (C, N) of the N pixels inside it."""
        silhouette = Silhouette(mask)
        image = with_mirror(encode_image(rgb[None], mask[None, None]))
        with autocast(rgb.device):
            both = self(image, silhouette.blocks)
        own, mirrored = (FieldMaps(*side) for side in zip(*map(silhouette.sides, both), strict=True))
        turned = MIRROR.to(rgb.device)[:, None] * mirrored.normals
        maps = FieldMaps(
            F.normalize(own.normals + turned, dim=0),
            both_sides(own.cast, mirrored.cast, self.anchors),
            (own.sharpness * mirrored.sharpness).sqrt(),
            (own.depth + mirrored.depth) / 2,
        )
        return maps, silhouette

    @torch.no_grad()
    def normals(self, rgb: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Framed rgb (3, h, w), linear, and mask (h, w) to unit normals (3, h, w), zero outside the mask."""
        maps, silhouette = self.infer(rgb, mask)
        return silhouette.scatter(maps.normals)

    @torch.no_grad()
    def analyse(
        self, rgb: torch.Tensor, mask: torch.Tensor, normals: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, "Visibility"]:
        """Framed rgb (3, h, w), linear, and mask (h, w) to unit normals (3, h, w), zero outside the mask, and
        to the visibility of any light. Normals (3, h, w) that are given take the place of the network's own.
        """
        maps, silhouette = self.infer(rgb, mask)
        if normals is not None:
            maps = maps._replace(normals=silhouette.take(normals))
        return silhouette.scatter(maps.normals), Visibility(maps, silhouette, self.anchors)


class Visibility(NamedTuple):
    """The visibility of one subject in any light: dot products with its maps, and no network."""

    maps: FieldMaps  # (C, N) of the subject's pixels
    silhouette: Any  # Silhouette, or Pixels where no network follows
    anchors: torch.Tensor  # (K, 3)

    def __call__(self, directions: torch.Tensor) -> torch.Tensor:
        """Unit directions (D, 3) to maps (D, h, w) in [0, 1], zero outside the subject."""
        return self.silhouette.scatter(self.at_pixels(directions))

    @torch.no_grad()
    def each(self, directions: torch.Tensor) -> torch.Tensor:
        """A unit direction a pixel (3, h, w) to one map (h, w), as a light in the room needs it."""
        toward = self.silhouette.take(directions)
        (cast,) = interpolated(toward, self.anchors, self.maps.cast)
        return self.silhouette.scatter(self.gated(cast, toward)[None])[0]

    def gated(self, cast: torch.Tensor, directions: torch.Tensor) -> torch.Tensor:
        """Visibility (N,) from the cast logits (N,) of the pixels' own directions (3, N)."""
        attached = (directions * self.maps.normals).sum(dim=0).mul_(self.maps.sharpness[0]).sigmoid_()
        return cast.add(LIT).sigmoid_().mul_(attached)

    @property
    def depth(self) -> torch.Tensor | None:
        """(h, w) away from the camera, relative to the subject's mean, in units of the height that the mask
        shows; zero outside it. None from a network that says nothing of depth."""
        if not len(self.maps.depth):
            return None
        return self.silhouette.scatter(self.maps.depth - self.maps.depth.mean())[0]

    def halved(self, directions: torch.Tensor, column: int) -> torch.Tensor:
        """The same at every second row and column, from column 0 or 1 on: (D, h / 2, w / 2)."""
        chosen, place, size = self.silhouette.halved(column)
        maps = directions.new_zeros(len(directions), size.numel())
        return maps.index_copy_(1, place, self.at_pixels(directions, chosen)).unflatten(1, size)

    @torch.no_grad()
    def at_pixels(self, directions: torch.Tensor, chosen: slice = slice(None)) -> torch.Tensor:
        """Visibility (D, n) of the subject's pixels, or of those chosen: `VisibilityField.log_visibility`,
        without its logarithm, which costs ten times the product."""
        normals, cast, sharpness = (image[:, chosen] for image in self.maps[:3])
        attached = (directions @ normals).mul_(sharpness).sigmoid_()
        return (anchor_weights(directions, self.anchors) @ cast).add_(LIT).sigmoid_().mul_(attached)
