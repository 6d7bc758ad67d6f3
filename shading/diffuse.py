"""Diffuse shading of one light at a time (OLAT), and the albedo that goes with it (Section 4.4).

shading(p, L) = base(p, L) + residual(p, L),  base = max(N·L, 0) × visibility

The base is direct light on the estimated surface. The residual, which is learned, is what the body throws on
itself, and what repairs the base. Both networks say linear values; shading is these, held to [0, 1].
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import nn

from shadow import inputs
from shadow import visibility as visibility_module
from shadow.directions import olat
from shadow.framing import Framing, extend
from shadow.networks import checkpoints
from shadow.networks.backbone import ENCODING, Backbone, encode_image, take_blocks
from shadow.networks.field import MIRROR, anchor_weights, both_sides, scatter, sides
from shadow.networks.unet import LIGHTS_AT_ONCE, UNet
from shadow.normals import on_canvas, resolve

# What the residual field adds is less by this at inference: so little is a guess that hedges between lit and
# dark, and a haze over deep shadows (SSIM 0.737 with it, 0.741 without, on 16 validation views).
HAZE = 0.01


def base(normals, visibility, directions):
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
    shading: Callable
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
        size=256,  # canvas height that the network was trained for
        normals=True,  # as an input and in the base, or in neither (Table 6)
        visibility="inferred",  # likewise; "baseline" is sign(N·L), None is neither (Table 6)
        **backbone,
    ):
        super().__init__()
        if visibility not in ("inferred", "baseline", None):
            raise ValueError(f"visibility: expected inferred, baseline or None, got {visibility!r}")
        self.size, self.normals, self.visibility = size, normals, visibility
        self.register_buffer("anchors", torch.from_numpy(olat(behind=True)), persistent=False)
        lights = len(self.anchors)
        guides = 0 if visibility is None else lights
        self.backbone = Backbone(7 if normals else 4, lights + 1, guides=guides, **backbone)

    def forward(self, image, normals, visibility, blocks=None):
        """Encoded image and mask (B, 4, H, W), normals (B, 3, H, W), and visibility of the anchor directions
        at every second pixel (B, K, H/2, W/2), to ShadingMaps; or to what `take_blocks` takes of them."""
        if self.visibility == "baseline":
            visibility = torch.einsum("kc,bchw->bkhw", self.anchors, normals[..., ::2, ::2]).gt(0).float()
        x = torch.cat([image, normals], dim=1) if self.normals else image
        maps = self.backbone(x, blocks, None if self.visibility is None else visibility).float()
        residual, log_gain = maps.split([len(self.anchors), 1], dim=1)
        photograph = image[:, :3] if blocks is None else take_blocks(image[:, :3], blocks)
        return ShadingMaps(residual, photograph * log_gain.clamp(-3, 3).exp())

    def shading(self, maps, normals, visibility, directions, haze=0.0):
        """Linear shading (B, D, H, W), not yet held to [0, 1], of unit directions (B, D, 3), given their
        visibility (B, D, H, W). What the residual adds is less by `haze`."""
        residual = torch.einsum("bdk,bkhw->bdhw", anchor_weights(directions, self.anchors), maps.residual)
        residual = residual - residual.clamp(0, haze)
        known = visibility if self.visibility == "inferred" else None
        return base(normals if self.normals else None, known, directions) + residual

    @torch.no_grad()
    def analyse(self, rgb, mask, normals, visibility):
        """Framed rgb (3, h, w), mask (h, w), normals (3, h, w), and visibility, a function of unit directions
        (D, 3) to maps (D, h, w), to Diffuse. Its shading runs no network but that function."""
        inside = mask > 0  # a light costs the subject's pixels only, some quarter of the canvas
        # As the field does: the mean of what the network says of the photograph and of its mirror image.
        mirror = MIRROR.to(rgb.device)
        image = encode_image(rgb[None], mask[None, None])
        opposite = (mirror.view(3, 1, 1) * normals).flip(-1)
        guides = torch.stack([visibility(self.anchors), visibility(self.anchors * mirror).flip(-1)])
        both = self(
            torch.cat([image, image.flip(-1)]), torch.stack([normals, opposite]), guides[..., ::2, ::2]
        )
        own, other = (ShadingMaps(*map(side, both)) for side in sides(inside))
        residual = both_sides(own.residual, other.residual, self.anchors)
        maps = ShadingMaps(residual, (own.albedo + other.albedo) / 2)
        surface = normals[None, :, inside, None]

        def shading(directions, seen=None):
            with torch.no_grad():
                seen = visibility(directions) if seen is None else seen
                seen = seen[None, :, inside, None]
                linear = self.shading(maps, surface, seen, directions[None], HAZE)
                return scatter(linear.clamp(0, 1), mask)

        return Diffuse(shading, scatter(maps.albedo.clamp(0, 1) ** ENCODING, mask))


class PerLightShading(nn.Module):
    """The paper's shading network: its U-Net with a linear head, one forward for one light (Section 4.4)."""

    def __init__(self, size=256, latent="resb7", **unet):
        super().__init__()
        self.size = size  # canvas height that the network was trained for
        self.unet = UNet(10, 1, latent, linear=True, **unet)
        nn.init.zeros_(self.unet.head.weight)  # untrained, shading is the base image
        nn.init.zeros_(self.unet.head.bias)

    def forward(self, image, normals, visibility, directions):
        """Encoded image and mask (B, 4, H, W), normals (B, 3, H, W), and unit directions (B, D, 3) with their
        visibility (B, D, H, W), to linear shading (B, D, H, W), not yet held to [0, 1]."""
        lights = directions.shape[1]
        seen = torch.cat([image[:, :3], normals], dim=1)[:, None].expand(-1, lights, -1, -1, -1)
        broadcast = directions[..., None, None].expand(-1, -1, -1, *image.shape[-2:])
        residual = self.unet(torch.cat([seen, broadcast, visibility[:, :, None]], dim=2).flatten(0, 1))
        return base(normals, visibility, directions) + residual.float().unflatten(0, (-1, lights))[:, :, 0]

    @torch.no_grad()
    def analyse(self, rgb, mask, normals, visibility):
        """As `ShadingField.analyse`, but the shading runs the network once a light; there is no albedo."""
        image = encode_image(rgb[None], mask[None, None])

        def shading(directions, seen=None):
            with torch.no_grad():
                seen = visibility(directions) if seen is None else seen
                batches = zip(seen.split(LIGHTS_AT_ONCE), directions.split(LIGHTS_AT_ONCE), strict=True)
                maps = [self(image, normals[None], maps[None], lights[None])[0] for maps, lights in batches]
                return torch.cat(maps).clamp(0, 1) * (mask > 0)

        return Diffuse(shading, None)


def load(name="shading"):
    """The shipped shading network, or one trained by `relight train shading` (a .safetensors path)."""
    networks = {"shading": ShadingField, "shading-per-light": PerLightShading}
    return checkpoints.load(name, networks, package="shading")


def analyse(rgb, mask, *, normals=None, model="shading"):
    """What the functions of this package share: checked input, brought to the canvas, through the networks.

    Returns (Framing, framed rgb (3, h, w), framed mask (h, w), Diffuse); raises as `infer` does.
    """
    image = inputs.image("rgb", rgb)
    matte = inputs.mask("mask", mask, image.shape[1:]).to(image.device)
    network = load(model).to(image.device)
    framing = Framing.around(matte, network.size)
    framed, framed_mask = framing.crop(image), framing.crop(matte[None])[0]
    field = visibility_module.load().to(image.device)
    surface = on_canvas(resolve(normals, image, matte, field, network), framing)
    surface, visibility = field.analyse(framed, framed_mask, surface)
    return framing, framed, framed_mask, network.analyse(framed, framed_mask, surface, visibility)


def infer(rgb, mask, directions, *, normals=None, visibility=None, model="shading"):
    """Diffuse shading of the person in an image, lit by one unit-intensity light at a time.

    Parameters
    ----------
    rgb: (H, W, 3) float, linear Rec.709, any size and exposure; NumPy or torch.
    mask: (H, W) in [0, 1], the matte of the person.
    directions: (D, 3) toward the lights, camera frame, any length but zero.
    normals: (H, W, 3) camera-frame normals to use instead of inferring them with the shipped network; or
        anything else that `shadow.normals.load` takes.
    visibility: (D, H, W) in [0, 1] to use instead of inferring it, in the base image.
    model: name of shipped weights, or the path of a checkpoint.

    Returns
    -------
    (D, H, W) float32 linear shading in [0, 1], bounce light from the body included; 1 is a surface facing an
    unoccluded light, or brighter; zero outside the mask. NumPy or torch, as `rgb` was, on its device.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, an empty mask, a zero direction.
    """
    framing, _, framed_mask, diffuse = analyse(rgb, mask, normals=normals, model=model)
    lights = inputs.directions("directions", directions).to(framed_mask.device)
    if visibility is not None:
        given = inputs.visibility("visibility", visibility, (len(lights), *framing.plate))
        visibility = framing.crop(given.to(framed_mask.device))
    maps = diffuse.shading(lights, visibility)
    matte = inputs.mask("mask", mask, framing.plate).to(framed_mask.device)
    return inputs.like(framing.restore(extend(maps, framed_mask)).clamp(0, 1) * (matte > 0), rgb)
