"""Diffuse shading of one light at a time (OLAT), and the albedo that goes with it (Section 4.4).

shading(p, L) = base(p, L) + residual(p, L),  base = max(N·L, 0) × visibility

The base is direct light on the estimated surface. The residual, which is learned, is what the body throws on
itself, and what repairs the base. Both networks say linear values; shading is these, held to [0, 1].
"""

import os
from collections.abc import Callable
from typing import Any, NamedTuple, overload

import torch
from torch import nn

from shadow.directions import olat
from shadow.networks import checkpoints
from shadow.networks.backbone import ENCODING, Backbone, encode_image, take_blocks
from shadow.networks.field import Visibility, anchor_weights, both_sides, interpolated
from shadow.networks.mirror import MIRROR, Pixels, Silhouette, with_mirror
from shadow.networks.precision import autocast
from shadow.networks.unet import LIGHTS_AT_ONCE, UNet

Visible = Callable[[torch.Tensor], torch.Tensor]  # unit directions (D, 3) to visibility (D, h, w)

# What the residual field adds is less by this at inference: so little is a guess that hedges between lit and
# dark, and a haze over deep shadows (SSIM 0.737 with it, 0.741 without, on 16 validation views).
HAZE = 0.01

# How the outputs of the albedo's gain, its brightness, warmth and green, make the logarithm of red's, green's
# and blue's gains. The first alone is a gain without colour.
LOG_GAINS = ((1.0, 1.0, 1.0), (1.0, 0.0, -1.0), (-0.5, 1.0, -0.5))


@overload
def base(
    normals: torch.Tensor, visibility: torch.Tensor | None, directions: torch.Tensor
) -> torch.Tensor: ...


@overload
def base(
    normals: torch.Tensor | None, visibility: torch.Tensor | None, directions: torch.Tensor
) -> torch.Tensor | float: ...


def base(
    normals: torch.Tensor | None, visibility: torch.Tensor | None, directions: torch.Tensor
) -> torch.Tensor | float:
    """The base image from tensors: normals (B, 3, H, W), visibility (B, D, H, W), directions (B, D, 3) to
    (B, D, H, W). Without normals it is the visibility, without visibility max(N·L, 0), without both 0: the
    ablations of Table 6."""
    if normals is None:
        return 0.0 if visibility is None else visibility
    facing = torch.einsum("bdc,bchw->bdhw", directions, normals).clamp_min(0)
    return facing if visibility is None else facing * visibility


class ShadingMaps(NamedTuple):
    """What the image alone decides."""

    residual: torch.Tensor  # (B, K, H, W) of each anchor direction, linear
    albedo: torch.Tensor  # (B, 3, H, W) encoded, albedo ** (1 / ENCODING)


class Diffuse(NamedTuple):
    """An analysed subject: a function of light, and what it shines on."""

    # Unit directions (D, 3) to (D, h, w) in [0, 1], zero outside the mask. Their visibility (D, h, w) may be
    # given as well.
    shading: Any
    albedo: torch.Tensor | None  # (3, h, w) linear in [0, 1]; None from a network that infers none


class ShadingField(nn.Module):
    """The one-pass network: one forward gives the residual of every light direction, and the albedo.

    As in the visibility field, feature k is the residual of anchor direction k, and w(L) interpolates between
    anchors. Image = albedo × Σ light × shading, so whoever explains one has to know the other. The albedo is
    the photograph times a gain, which need not know the texture, only the light. It has no colour: nobody can
    tell from one picture the tint of the light from that of all paint. The head starts at zero: untrained,
    shading is the base image and albedo the photograph.
    """

    def __init__(
        self,
        size: int = 256,  # canvas height that the network was trained for
        normals: bool = True,  # as an input and in the base, or in neither (Table 6)
        visibility: str | None = "inferred",  # likewise; "baseline" is sign(N·L), None is neither (Table 6)
        gains: int = 1,  # outputs of the albedo's gain: 1 its brightness, 3 its colour too (LOG_GAINS)
        **backbone: Any,
    ) -> None:
        super().__init__()
        if visibility not in ("inferred", "baseline", None):
            raise ValueError(f"visibility: expected inferred, baseline or None, got {visibility!r}")
        self.size, self.normals, self.visibility = size, normals, visibility
        self.register_buffer("anchors", torch.from_numpy(olat(behind=True)), persistent=False)
        self.register_buffer("log_gains", torch.tensor(LOG_GAINS[:gains]), persistent=False)
        lights = len(self.anchors)
        guides = 0 if visibility is None else lights
        self.backbone = Backbone(7 if normals else 4, lights + gains, guides=guides, **backbone)

    anchors: torch.Tensor  # (K, 3)
    log_gains: torch.Tensor  # (gains, 3)

    def forward(
        self,
        image: torch.Tensor,
        normals: torch.Tensor,
        visibility: torch.Tensor | None,
        blocks: torch.Tensor | None = None,
    ) -> ShadingMaps:
        """Encoded image and mask (B, 4, H, W), normals (B, 3, H, W), and visibility of the anchor directions
        at every second pixel (B, K, H/2, W/2), to ShadingMaps; or to what `take_blocks` takes of them."""
        if self.visibility == "baseline":
            visibility = torch.einsum("kc,bchw->bkhw", self.anchors, normals[..., ::2, ::2]).gt(0).float()
        x = torch.cat([image, normals], dim=1) if self.normals else image
        maps = self.backbone(x, blocks, None if self.visibility is None else visibility).float()
        residual, gain = maps.split([len(self.anchors), len(self.log_gains)], dim=1)
        log_gain = torch.einsum("bg...,gc->bc...", gain.clamp(-3, 3), self.log_gains)
        photograph = image[:, :3] if blocks is None else take_blocks(image[:, :3], blocks)
        return ShadingMaps(residual, photograph * log_gain.exp())

    def shading(
        self, maps: ShadingMaps, normals: torch.Tensor, visibility: torch.Tensor, directions: torch.Tensor
    ) -> torch.Tensor:
        """Linear shading (B, D, H, W), not yet held to [0, 1], of unit directions (B, D, 3), given their
        visibility (B, D, H, W)."""
        residual = torch.einsum("bdk,bkhw->bdhw", anchor_weights(directions, self.anchors), maps.residual)
        known = visibility if self.visibility == "inferred" else None
        return base(normals if self.normals else None, known, directions) + residual

    @torch.no_grad()
    def analyse(
        self, rgb: torch.Tensor, mask: torch.Tensor, normals: torch.Tensor, visibility: Visible
    ) -> Diffuse:
        """Framed rgb (3, h, w), mask (h, w), normals (3, h, w), and the visibility of any light, to Diffuse.
        Its shading runs no network but the visibility's."""
        silhouette, mirror = Silhouette(mask), MIRROR.to(rgb.device)
        image = with_mirror(encode_image(rgb[None], mask[None, None]))
        surface = torch.stack([normals, mirror.view(3, 1, 1) * normals.flip(-1)])
        guides = self._guides(visibility, mirror)
        with autocast(rgb.device):
            both = self(image, surface, guides, silhouette.blocks)
        own, mirrored = (ShadingMaps(*side) for side in zip(*map(silhouette.sides, both), strict=True))
        shading = Shading(
            both_sides(own.residual, mirrored.residual, self.anchors),
            silhouette.take(normals) if self.normals else None,
            visibility,
            silhouette,
            self.anchors,
            known=self.visibility == "inferred",
        )
        albedo = ((own.albedo + mirrored.albedo) / 2) ** ENCODING
        if len(self.log_gains) > 1:
            albedo *= _balance(albedo, silhouette.take(image[0, :3]) ** ENCODING)
        return Diffuse(shading, silhouette.scatter(albedo.clamp(0, 1)))

    def _guides(self, visibility: Visible, mirror: torch.Tensor) -> torch.Tensor | None:
        """Visibility of the anchors (2, K, h/2, w/2) at every second pixel of the photograph, and of its
        mirror image, whose even columns are the photograph's odd ones."""
        if self.visibility != "inferred":
            return None
        own, other = self.anchors, self.anchors * mirror
        if isinstance(visibility, Visibility):
            pair = visibility.halved(own, 0), visibility.halved(other, 1)
        else:
            pair = visibility(own)[:, ::2, ::2], visibility(other)[:, ::2, 1::2]
        return torch.stack([pair[0], pair[1].flip(-1)])


def _balance(albedo: torch.Tensor, photograph: torch.Tensor) -> torch.Tensor:
    """Factors (3, 1) with which an albedo (3, N) has the mean colour of the photograph (3, N), and still its
    own mean brightness."""
    own, seen = (image.mean(dim=1, keepdim=True).clamp_min(1e-6) for image in (albedo, photograph))
    factors = seen / own
    return factors * own.sum() / (factors * own).sum()


class Shading(NamedTuple):
    """The shading of one subject by any light: dot products with its maps; no network but visibility's."""

    residual: torch.Tensor  # (K, N) of each anchor direction at the subject's pixels, linear
    normals: torch.Tensor | None  # (3, N), if the base image has them
    visibility: Visible
    silhouette: Pixels
    anchors: torch.Tensor  # (K, 3)
    known: bool  # the base image has the visibility

    @torch.no_grad()
    def __call__(self, directions: torch.Tensor, seen: torch.Tensor | None = None) -> torch.Tensor:
        """Unit directions (D, 3), whose visibility `seen` (D, h, w) may be given, to (D, h, w) in [0, 1]:
        base + w(L)·residual, as `ShadingField.shading` says it, less the haze; zero outside the subject."""
        residual = anchor_weights(directions, self.anchors) @ self.residual
        residual -= residual.clamp(0, HAZE)
        if self.normals is not None:
            base = (directions @ self.normals).clamp_min_(0)
            residual += base * self._seen(directions, seen) if self.known else base
        elif self.known:
            residual += self._seen(directions, seen)
        return self.silhouette.scatter(residual.clamp_(0, 1))

    @torch.no_grad()
    def each(self, directions: torch.Tensor) -> torch.Tensor:
        """A unit direction a pixel (3, h, w) to one map (h, w) in [0, 1], as a light in the room needs it."""
        toward = self.silhouette.take(directions)
        lit = None
        if self.known and isinstance(self.visibility, Visibility):  # of the same anchors
            residual, cast = interpolated(toward, self.anchors, self.residual, self.visibility.maps.cast)
            lit = self.visibility.gated(cast, toward)
        else:
            (residual,) = interpolated(toward, self.anchors, self.residual)
        residual -= residual.clamp(0, HAZE)
        if self.normals is not None:
            base = (toward * self.normals).sum(dim=0).clamp_min_(0)
            residual += base if lit is None else base * lit
        elif lit is not None:
            residual += lit
        return self.silhouette.scatter(residual.clamp_(0, 1)[None])[0]

    def _seen(self, directions: torch.Tensor, seen: torch.Tensor | None) -> torch.Tensor:
        """Visibility (D, N) of the subject's pixels; the field's need not be drawn on the canvas."""
        if seen is None and isinstance(self.visibility, Visibility):
            return self.visibility.at_pixels(directions)
        return self.silhouette.take(self.visibility(directions) if seen is None else seen)


class PerLightShading(nn.Module):
    """The paper's shading network: its U-Net with a linear head, one forward for one light (Section 4.4)."""

    def __init__(self, size: int = 256, latent: str = "resb7", **unet: Any) -> None:
        super().__init__()
        self.size = size  # canvas height that the network was trained for
        self.unet = UNet(10, 1, latent, linear=True, **unet)
        for parameter in self.unet.head.parameters():  # untrained, shading is the base image
            nn.init.zeros_(parameter)

    def forward(
        self,
        image: torch.Tensor,
        normals: torch.Tensor,
        visibility: torch.Tensor,
        directions: torch.Tensor,
    ) -> torch.Tensor:
        """Encoded image and mask (B, 4, H, W), normals (B, 3, H, W), and unit directions (B, D, 3) with their
        visibility (B, D, H, W), to linear shading (B, D, H, W), not yet held to [0, 1]."""
        lights = directions.shape[1]
        seen = torch.cat([image[:, :3], normals], dim=1)[:, None].expand(-1, lights, -1, -1, -1)
        broadcast = directions[..., None, None].expand(-1, -1, -1, *image.shape[-2:])
        residual = self.unet(torch.cat([seen, broadcast, visibility[:, :, None]], dim=2).flatten(0, 1))
        return base(normals, visibility, directions) + residual.float().unflatten(0, (-1, lights))[:, :, 0]

    @torch.no_grad()
    def analyse(
        self, rgb: torch.Tensor, mask: torch.Tensor, normals: torch.Tensor, visibility: Visible
    ) -> Diffuse:
        """As `ShadingField.analyse`, but the shading runs the network once a light; there is no albedo."""
        image = encode_image(rgb[None], mask[None, None])

        def shading(directions: torch.Tensor, seen: torch.Tensor | None = None) -> torch.Tensor:
            with torch.no_grad():
                seen = visibility(directions) if seen is None else seen
                batches = zip(seen.split(LIGHTS_AT_ONCE), directions.split(LIGHTS_AT_ONCE), strict=True)
                maps = [self(image, normals[None], maps[None], lights[None])[0] for maps, lights in batches]
                return torch.cat(maps).clamp(0, 1) * (mask > 0)

        return Diffuse(shading, None)


def load(name: str | os.PathLike = "shading", device: torch.device | str = "cpu") -> Any:
    """The shipped shading network, or one trained by `relight train shading` (a .safetensors path)."""
    networks = {"shading": ShadingField, "shading-per-light": PerLightShading}
    return checkpoints.load(name, networks, package="shading", device=device)
