"""The one-pass network: one forward gives normals and depth, and visibility for every light direction.

visibility(p, L) = attached(N(p)·L) × cast(w(L)·f(p))

It infers the self-shadow maps of Section 3, for which the paper's network (unet.py) runs once for each light,
and the normals that the paper takes from PIFuHD. `attached` says whether the surface faces the light (the
test of Section 4.1, made soft), `cast` whether something occludes it. Feature k of f is the logit of anchor
direction k, and w(L) interpolates between the anchors near L. The head starts at zero: in an untrained
network all surfaces face the camera at the same depth, and nothing casts a shadow.
"""

from collections.abc import Callable
from typing import NamedTuple, Unpack

import torch
import torch.nn.functional as F
from torch import nn

from shadow.directions import olat
from shadow.networks.backbone import Backbone, BackboneForm, encode_image
from shadow.networks.mirror import FLIPPED, MIRROR, Pixels, Silhouette, mirrored_blocks, with_mirror
from shadow.networks.precision import autocast, with_cast_weights

PASSES = 2  # of the network over a photograph: over it and its mirror image, whose maps are averaged
LIT_LOGIT = 3.0  # cast-shadow logit of the untrained field: sigmoid(3) = 0.95, lit
SHARPNESS = 20.0  # slope of the untrained gate in N·L
KAPPA = 50.0  # concentration of an anchor's kernel: half weight at 10 degrees, anchors stand 18 apart
STRIP_PIXELS = 2048  # processed together, so that the weights of their anchors stay in the processor's cache
COSINE_CUTOFF = 0.2  # cosine difference to the nearest anchor beyond which an anchor has < 5e-5 of its weight


def anchor_weights(directions: torch.Tensor, anchors: torch.Tensor) -> torch.Tensor:
    """Return w(L), weights (..., D, K) that sum to one, of anchors (K, 3) for directions (..., D, 3)."""
    weights = torch.softmax(KAPPA * (directions @ anchors.T), dim=-1)
    # Weights of distant anchors are subnormal numbers, which a CPU multiplies ten times as slowly.
    return weights * (weights > 1e-12)


def interpolate_anchors(
    directions: torch.Tensor, anchors: torch.Tensor, *maps: torch.Tensor
) -> list[torch.Tensor]:
    """Return w(L)·f (N,) for each of the maps f (K, N), where each of the N pixels has a direction (3, N).

    Neighbouring pixels have similar directions, so few anchors have weight in a strip of them.
    """
    results = [features.new_empty(features.shape[1]) for features in maps]
    for start in range(0, directions.shape[1], STRIP_PIXELS):
        strip = slice(start, start + STRIP_PIXELS)
        cosines = anchors @ directions[:, strip]
        cosines -= cosines.amax(dim=0)
        near = (cosines.amax(dim=1) > -COSINE_CUTOFF).nonzero()[:, 0]
        weights = cosines[near].mul_(KAPPA).exp_()
        weights /= weights.sum(dim=0)
        for result, features in zip(results, maps, strict=True):
            result[strip] = features[:, strip].index_select(0, near).mul_(weights).sum(dim=0)
    return results


def average_mirrored(own: torch.Tensor, mirrored: torch.Tensor, anchors: torch.Tensor) -> torch.Tensor:
    """Return the mean of the features (K, N) of a photograph and of its mirror image, for the anchors (K, 3).

    The anchors are not symmetric, so the mirrored features are first interpolated at the mirrored anchors.
    """
    across = anchor_weights(anchors * MIRROR.to(anchors.device), anchors)
    return torch.addmm(own, across, mirrored).div_(2)


class FieldMaps(NamedTuple):
    """The maps of an image that hold for every light; a light's visibility is a dot product with them."""

    normals: torch.Tensor  # (B, 3, H, W) unit normals, which gate the attached shadow
    cast: torch.Tensor  # (B, K, H, W) cast-shadow logit of each anchor direction, relative to LIT_LOGIT
    sharpness: torch.Tensor  # (B, 1, H, W) slope of the gate: low where the normals are uncertain
    depth: torch.Tensor  # (B, 1, H, W) away from the camera, in heights of the matte; or (B, 0, H, W), none

    def at(self, take: Callable[[torch.Tensor], torch.Tensor]) -> "FieldMaps":
        """Apply `take`, which selects pixels of images (B, C, H, W), to every map."""
        return FieldMaps(*(take(image) for image in self))


class VisibilityField(nn.Module):
    """The network that maps a photograph and its matte to `FieldMaps` (see the module's docstring)."""

    anchors: torch.Tensor  # (K, 3)

    def __init__(self, size: int = 256, depth: bool = False, **backbone: Unpack[BackboneForm]) -> None:
        super().__init__()
        self.size = size  # canvas height that the network was trained for
        self.depth = depth  # whether it infers depth
        self.register_buffer("anchors", torch.from_numpy(olat(behind=True)), persistent=False)
        self.backbone = Backbone(4, 3 + len(self.anchors) + 1 + depth, **backbone)

    def forward(self, image: torch.Tensor, blocks: torch.Tensor | None = None) -> FieldMaps:
        """Return the FieldMaps of encoded images and masks (B, 4, H, W).

        With `blocks` the result is `maps.at(take_blocks)` of these blocks: training could not hold all lights
        at all pixels in memory.
        """
        maps = self.backbone(image, blocks).float()
        surface, cast, log_sharpness, depth = maps.split([3, len(self.anchors), 1, int(self.depth)], dim=1)
        toward_camera = torch.tensor([0.0, 0.0, 1.0], device=image.device).view(1, 3, 1, 1)
        normals = F.normalize(surface + toward_camera, dim=1)
        return FieldMaps(normals, cast, SHARPNESS * log_sharpness.clamp(-3, 3).exp(), depth)

    def log_visibility(self, maps: FieldMaps, directions: torch.Tensor) -> torch.Tensor:
        """Return the logarithm of the visibility (B, D, H, W) of unit directions (B, D, 3)."""
        attached = maps.sharpness * torch.einsum("bdc,bchw->bdhw", directions, maps.normals)
        cast = torch.einsum("bdk,bkhw->bdhw", anchor_weights(directions, self.anchors), maps.cast)
        return F.logsigmoid(attached) + F.logsigmoid(cast + LIT_LOGIT)

    @torch.no_grad()
    def infer(
        self, rgb: torch.Tensor, mask: torch.Tensor, passes: int = PASSES
    ) -> tuple[FieldMaps, Silhouette]:
        """Return the FieldMaps (C, N) of framed linear rgb (3, h, w), at the N pixels of a mask (h, w).

        They are the mean of those of the photograph and of its mirror image, or with one of the `passes` the
        former, which takes half the time.
        """
        silhouette = Silhouette(mask)
        image = with_mirror(encode_image(rgb[None], mask[None, None]))[:passes]
        with autocast(rgb.device):
            outputs = with_cast_weights(self)(image, silhouette.blocks[:passes])
        sides = [FieldMaps(*side) for side in zip(*map(silhouette.sides, outputs), strict=True)]
        return sides[0] if passes == 1 else self._averaged(*sides), silhouette

    def _averaged(self, own: FieldMaps, mirrored: FieldMaps) -> FieldMaps:
        """Return the mean of the maps (C, N) of a photograph and of its mirror image, at the same pixels."""
        turned = MIRROR.to(own.normals.device)[:, None] * mirrored.normals
        return FieldMaps(
            F.normalize(own.normals + turned, dim=0),
            average_mirrored(own.cast, mirrored.cast, self.anchors),
            (own.sharpness * mirrored.sharpness).sqrt(),
            (own.depth + mirrored.depth) / 2,
        )

    @torch.no_grad()
    def mean_at(self, image: torch.Tensor, blocks: torch.Tensor) -> FieldMaps:
        """Return the mean maps (B, C, 4, P) of encoded images (B, 4, H, W) and of their mirror images.

        They are those of `infer`, at the pixels of `take_blocks(maps, blocks)`: the targets of a network that
        learns to give them in one pass.
        """
        with autocast(image.device):
            network = with_cast_weights(self)
            own = network(image, blocks)
            mirrored = network(image.flip(-1), mirrored_blocks(blocks, image.shape[3]))
        mirrored = mirrored.at(lambda maps: maps[:, :, FLIPPED])
        pixels = (side.at(lambda maps: maps.transpose(0, 1).flatten(1)) for side in (own, mirrored))
        shape = own.normals.shape
        return self._averaged(*pixels).at(
            lambda maps: maps.unflatten(1, (shape[0], *shape[2:])).transpose(0, 1)
        )

    @torch.no_grad()
    def normals(self, rgb: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return unit normals (3, h, w), zero outside the mask, of framed linear rgb (3, h, w)."""
        maps, silhouette = self.infer(rgb, mask)
        return silhouette.scatter(maps.normals)

    @torch.no_grad()
    def analyse(
        self,
        rgb: torch.Tensor,
        mask: torch.Tensor,
        normals: torch.Tensor | None = None,
        passes: int = PASSES,
    ) -> tuple[torch.Tensor, "Visibility"]:
        """Return unit normals (3, h, w), zero outside the mask, and the visibility of any light.

        rgb (3, h, w) is framed and linear, mask (h, w). Given normals (3, h, w) replace the network's own.
        `passes` is that of `infer`.
        """
        maps, silhouette = self.infer(rgb, mask, passes)
        if normals is not None:
            maps = maps._replace(normals=silhouette.take(normals))
        return silhouette.scatter(maps.normals), Visibility(maps, silhouette, self.anchors)


class Visibility(NamedTuple):
    """The visibility of one subject for any light: dot products with its maps, without a network."""

    maps: FieldMaps  # (C, N) of the subject's pixels
    silhouette: Pixels  # a Silhouette where a network follows
    anchors: torch.Tensor  # (K, 3)

    def __call__(self, directions: torch.Tensor) -> torch.Tensor:
        """Return maps (D, h, w) in [0, 1], zero outside the subject, for unit directions (D, 3)."""
        return self.silhouette.scatter(self.at_pixels(directions))

    @torch.no_grad()
    def per_pixel(self, directions: torch.Tensor) -> torch.Tensor:
        """Return the map (h, w) in which each pixel has its own light direction (3, h, w)."""
        toward = self.silhouette.take(directions)
        (cast,) = interpolate_anchors(toward, self.anchors, self.maps.cast)
        return self.silhouette.scatter(self.gated(cast, toward)[None])[0]

    def gated(self, cast: torch.Tensor, directions: torch.Tensor) -> torch.Tensor:
        """Return visibility (N,) from the cast-shadow logits (N,) of the pixels' own directions (3, N)."""
        attached = (directions * self.maps.normals).sum(dim=0).mul_(self.maps.sharpness[0]).sigmoid_()
        return cast.add(LIT_LOGIT).sigmoid_().mul_(attached)

    @torch.no_grad()
    def cast(self, directions: torch.Tensor, chosen: slice = slice(None)) -> torch.Tensor:
        """Return visibility (D, n) of cast shadows alone, as if the surface faced each direction (D, 3)."""
        weights = anchor_weights(directions, self.anchors)
        return (weights @ self.maps.cast[:, chosen]).add_(LIT_LOGIT).sigmoid_()

    @torch.no_grad()
    def cast_of_each(self, directions: torch.Tensor) -> torch.Tensor:
        """Return `cast` (N,) for the pixels' own directions (3, N)."""
        (cast,) = interpolate_anchors(directions, self.anchors, self.maps.cast)
        return cast.add_(LIT_LOGIT).sigmoid_()

    @property
    def depth(self) -> torch.Tensor | None:
        """Depth (h, w) away from the camera, relative to the subject's mean; zero outside the subject.

        It is in units of the height that the mask shows. None from a network that infers no depth.
        """
        if not len(self.maps.depth):
            return None
        return self.silhouette.scatter(self.maps.depth - self.maps.depth.mean())[0]

    def at_half_resolution(self, directions: torch.Tensor) -> torch.Tensor:
        """Return the visibility (1, D, h/2, w/2) of every second row and column, for directions (D, 3).

        The channels of a pixel are adjacent in memory, as convolutions read them.
        """
        height, width = (length // 2 for length in self.silhouette.shape)
        maps = directions.new_zeros(height * width, len(directions))
        assert isinstance(self.silhouette, Silhouette)
        chosen, index = self.silhouette.at_half_resolution()
        maps.index_copy_(0, index, self.at_pixels(directions, chosen).T)
        return maps.unflatten(0, (height, width)).permute(2, 0, 1)[None]

    @torch.no_grad()
    def at_pixels(self, directions: torch.Tensor, chosen: slice = slice(None)) -> torch.Tensor:
        """Return visibility (D, n) of the subject's pixels, or of those chosen, for unit directions (D, 3).

        It is `VisibilityField.log_visibility` without the logarithm, which costs ten times the product.
        """
        normals, sharpness = self.maps.normals[:, chosen], self.maps.sharpness[:, chosen]
        attached = (directions @ normals).mul_(sharpness).sigmoid_()
        return self.cast(directions, chosen).mul_(attached)
