"""Diffuse shading of one light at a time (OLAT), and the albedo that goes with it (Section 4.4).

shading(p, L) = base(p, L) + residual(p, L),  base = max(N·L, 0) × visibility

The base is direct light on the estimated surface. The residual is learned: it adds the light that the body
reflects onto itself, and corrects errors of the base. There are two networks: `ShadingField` infers all
lights in one forward, `PerLightShading` is the paper's. Both predict linear values, which are clamped to [0,
1].
"""

import os
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias, Unpack

import torch
from torch import nn

from shadow.directions import olat
from shadow.networks import checkpoints
from shadow.networks.backbone import ENCODING, Backbone, BackboneForm, encode_image, take_blocks
from shadow.networks.field import Visibility, anchor_weights, interpolate_anchors
from shadow.networks.mirror import Pixels, Silhouette
from shadow.networks.precision import autocast, with_cast_weights
from shadow.networks.unet import LIGHTS_AT_ONCE, UNet, UNetForm, per_light

# From unit directions (D, 3) to visibility (D, h, w).
Visible = Visibility | Callable[[torch.Tensor], torch.Tensor]

# Subtracted from positive residuals at inference. Where the network is unsure whether a pixel is lit, it
# predicts a small positive residual, which veils deep shadows (on 16 validation views, SSIM is 0.741 with
# this correction and 0.737 without).
RESIDUAL_BIAS = 0.01


def base(
    normals: torch.Tensor | None, visibility: torch.Tensor | None, directions: torch.Tensor
) -> torch.Tensor:
    """Return the base image (B, D, H, W) of normals (B, 3, H, W) and visibility (B, D, H, W).

    `directions` are (B, D, 3). Ablations of Table 6: without normals the base is the visibility, without
    visibility it is max(N·L, 0), without both it is 0.
    """
    if normals is None:
        return torch.zeros(()) if visibility is None else visibility
    facing = torch.einsum("bdc,bchw->bdhw", directions, normals).clamp_min(0)
    return facing if visibility is None else facing * visibility


class ShadingMaps(NamedTuple):
    """The maps of an image that hold for every light."""

    residual: torch.Tensor  # (B, K, H, W) of each anchor direction, linear
    albedo: torch.Tensor  # (B, 3, H, W) encoded, albedo ** (1 / ENCODING)


class Diffuse(NamedTuple):
    """An analysed subject: its shading as a function of light, and its albedo."""

    # From unit directions (D, 3) to (D, h, w) in [0, 1], zero outside the mask. The visibility (D, h, w) of
    # these directions is an optional second argument.
    shading: "Shading | Callable[..., torch.Tensor]"
    albedo: torch.Tensor | None  # (3, h, w) linear in [0, 1]; None from a network that infers no albedo


class ShadingField(nn.Module):
    """The one-pass network: one forward gives the residual of every light direction, and the albedo.

    As in the visibility field, feature k is the residual of anchor direction k, and w(L) interpolates between
    anchors. Image = albedo × Σ light × shading, so one network infers both. The albedo is the photograph
    multiplied by a gain: the gain depends only on the light, and the photograph supplies the texture. The
    gain has no colour, since one picture cannot distinguish the tint of the light from a tint of the
    surfaces. The head starts at zero: in an untrained network, the shading is the base image and the albedo
    is the photograph.
    """

    def __init__(
        self,
        size: int = 256,  # canvas height that the network was trained for
        normals: bool = True,  # these two are in weights files: whether it has the inputs of Table 6
        visibility: str | None = "inferred",
        **backbone: Unpack[BackboneForm],
    ) -> None:
        super().__init__()
        if not normals or visibility != "inferred":
            raise ValueError("normals, visibility: expected both, which only per-light networks can lack")
        self.size = size
        self.register_buffer("anchors", torch.from_numpy(olat(behind=True)), persistent=False)
        lights = len(self.anchors)
        self.backbone = Backbone(7, lights + 1, guides=lights, **backbone)

    anchors: torch.Tensor  # (K, 3)

    def forward(
        self,
        image: torch.Tensor,
        normals: torch.Tensor,
        visibility: torch.Tensor,
        blocks: torch.Tensor | None = None,
    ) -> ShadingMaps:
        """Return the ShadingMaps of encoded images and masks (B, 4, H, W) with normals (B, 3, H, W).

        `visibility` is that of the anchor directions at every second pixel, (B, K, H/2, W/2). With `blocks`
        the result is `take_blocks` of the maps.
        """
        maps = self.backbone(torch.cat([image, normals], dim=1), blocks, visibility).float()
        residual, log_gain = maps.split([len(self.anchors), 1], dim=1)
        photograph = image[:, :3] if blocks is None else take_blocks(image[:, :3], blocks)
        return ShadingMaps(residual, photograph * log_gain.clamp(-3, 3).exp())

    def shading(
        self, maps: ShadingMaps, normals: torch.Tensor, visibility: torch.Tensor, directions: torch.Tensor
    ) -> torch.Tensor:
        """Return linear shading (B, D, H, W), not yet clamped, for unit directions (B, D, 3).

        `visibility` is that of these directions, (B, D, H, W).
        """
        residual = torch.einsum("bdk,bkhw->bdhw", anchor_weights(directions, self.anchors), maps.residual)
        return base(normals, visibility, directions) + residual

    @torch.no_grad()
    def analyse(
        self, rgb: torch.Tensor, mask: torch.Tensor, normals: torch.Tensor, visibility: Visible
    ) -> Diffuse:
        """Infer shading and albedo of framed rgb (3, h, w), with its mask (h, w) and normals (3, h, w).

        `visibility` is a function of light directions. The returned shading calls it, and runs no network of
        its own. Unlike the field, this network sees the photograph alone: the mean with its mirror image is
        no better (docs/history.md).
        """
        silhouette = Silhouette(mask)
        image, guides = encode_image(rgb[None], mask[None, None]), self._guides(visibility)
        with autocast(rgb.device):
            maps = with_cast_weights(self)(image, normals[None], guides, silhouette.blocks[:1])
        residual, albedo = (silhouette.sides(part)[0] for part in maps)
        shading = Shading(residual, silhouette.take(normals), visibility, silhouette, self.anchors)
        return Diffuse(shading, silhouette.scatter((albedo**ENCODING).clamp(0, 1)))

    def _guides(self, visibility: Visible) -> torch.Tensor:
        """Return the visibility of the anchors at every second pixel, (1, K, h/2, w/2)."""
        if isinstance(visibility, Visibility):
            return visibility.at_half_resolution(self.anchors)
        return visibility(self.anchors)[None, :, ::2, ::2]


class Shading(NamedTuple):
    """The shading of one subject by any light: dot products with its maps."""

    residual: torch.Tensor  # (K, N) of each anchor direction at the subject's pixels, linear
    normals: torch.Tensor  # (3, N)
    visibility: Visible
    silhouette: Pixels
    anchors: torch.Tensor  # (K, 3)

    def __call__(self, directions: torch.Tensor, seen: torch.Tensor | None = None) -> torch.Tensor:
        """Return shading (D, h, w) in [0, 1], zero outside the subject, for unit directions (D, 3).

        It is base + w(L)·residual, as in `ShadingField.shading`, minus RESIDUAL_BIAS. `seen` (D, h, w) is the
        visibility of these directions, if it is already known.
        """
        return self.silhouette.scatter(self.at_pixels(directions, seen))

    @torch.no_grad()
    def at_pixels(self, directions: torch.Tensor, seen: torch.Tensor | None = None) -> torch.Tensor:
        """Return shading (D, N) of the subject's pixels, see `__call__`."""
        residual = anchor_weights(directions, self.anchors) @ self.residual
        base = (directions @ self.normals).clamp_min_(0).mul_(self._seen(directions, seen))
        return _sum(base, residual)

    @torch.no_grad()
    def per_pixel(self, directions: torch.Tensor) -> torch.Tensor:
        """Return the map (h, w), in [0, 1], in which each pixel has its own light direction (3, h, w)."""
        toward = self.silhouette.take(directions)
        base = (toward * self.normals).sum(dim=0).clamp_min_(0)
        if isinstance(self.visibility, Visibility):  # which has the same anchors
            maps = self.residual, self.visibility.maps.cast
            residual, cast = interpolate_anchors(toward, self.anchors, *maps)
            base.mul_(self.visibility.gated(cast, toward))
        else:
            (residual,) = interpolate_anchors(toward, self.anchors, self.residual)
        return self.silhouette.scatter(_sum(base, residual)[None])[0]

    def _seen(self, directions: torch.Tensor, seen: torch.Tensor | None) -> torch.Tensor:
        """Return the visibility (D, N) of the subject's pixels."""
        if seen is None and isinstance(self.visibility, Visibility):
            return self.visibility.at_pixels(directions)
        return self.silhouette.take(self.visibility(directions) if seen is None else seen)


def _sum(base: torch.Tensor, residual: torch.Tensor) -> torch.Tensor:
    """Return the shading in [0, 1] of a base image and a residual, in whose place it is."""
    residual -= residual.clamp(0, RESIDUAL_BIAS)
    return residual.add_(base).clamp_(0, 1)


class PerLightShading(nn.Module):
    """The paper's shading network (Section 4.4): a U-Net with linear output, one forward for each light."""

    def __init__(
        self,
        size: int = 256,  # canvas height that the network was trained for
        latent: str = "resb7",
        normals: bool = True,  # whether they are an input and part of the base (Table 6)
        visibility: str | None = "inferred",  # likewise; or "baseline", sign(N·L); or None (Table 6)
        **unet: Unpack[UNetForm],
    ) -> None:
        super().__init__()
        if visibility not in ("inferred", "baseline", None):
            raise ValueError(f"visibility: expected inferred, baseline or None, got {visibility!r}")
        self.size, self.normals, self.visibility = size, normals, visibility
        channels = 6 + 3 * normals + (visibility is not None)  # colour, light direction and those two
        self.unet = UNet(channels, 1, latent, linear=True, **unet)
        for parameter in self.unet.head.parameters():  # untrained, the shading is the base image
            nn.init.zeros_(parameter)

    def forward(
        self,
        image: torch.Tensor,
        normals: torch.Tensor,
        visibility: torch.Tensor,
        directions: torch.Tensor,
    ) -> torch.Tensor:
        """Return linear shading (B, D, H, W), not yet clamped, for unit directions (B, D, 3).

        The image and mask (B, 4, H, W) are encoded; normals are (B, 3, H, W), visibility (B, D, H, W).
        """
        inputs = per_light(image, normals if self.normals else None, directions)
        if self.visibility == "baseline":
            visibility = base(normals, None, directions).gt(0).float()
        if self.visibility is not None:
            inputs = torch.cat([inputs, visibility[:, :, None]], dim=2)
        residual = self.unet(inputs.flatten(0, 1)).float().unflatten(0, directions.shape[:2])[:, :, 0]
        known = visibility if self.visibility == "inferred" else None
        return base(normals if self.normals else None, known, directions) + residual

    @torch.no_grad()
    def analyse(
        self, rgb: torch.Tensor, mask: torch.Tensor, normals: torch.Tensor, visibility: Visible
    ) -> Diffuse:
        """Return shading that runs the network once for each light, and no albedo.

        The arguments are those of `ShadingField.analyse`.
        """
        image = encode_image(rgb[None], mask[None, None])

        def shading(directions: torch.Tensor, seen: torch.Tensor | None = None) -> torch.Tensor:
            with torch.no_grad():
                seen = visibility(directions) if seen is None else seen
                batches = zip(seen.split(LIGHTS_AT_ONCE), directions.split(LIGHTS_AT_ONCE), strict=True)
                maps = [self(image, normals[None], maps[None], lights[None])[0] for maps, lights in batches]
                return torch.cat(maps).clamp(0, 1) * (mask > 0)

        return Diffuse(shading, None)


ShadingNetwork: TypeAlias = ShadingField | PerLightShading
NETWORKS: dict[str, type[ShadingNetwork]] = {"shading": ShadingField, "shading-per-light": PerLightShading}


def load(name: str | os.PathLike = "shading", device: torch.device | str = "cpu") -> Any:
    """Load the shipped shading network, or one trained by `relight train shading` (a .safetensors path)."""
    return checkpoints.load(name, NETWORKS, package="shading", device=device)
