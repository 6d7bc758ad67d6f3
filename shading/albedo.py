"""Diffuse albedo of the photographed subject (delighting)."""

import torch
from torch import nn

from shadow import inputs, weights
from shadow.backbone import ENCODING, Backbone, encode_image
from shadow.framing import Framing, extend
from shadow.normals import on_canvas, resolve


class AlbedoNetwork(nn.Module):
    """RGB, mask and normals to albedo, as a correction of the encoded image: untrained, albedo = image."""

    def __init__(self, size=256, **backbone):
        super().__init__()
        self.size = size  # canvas height that the network was trained for
        self.backbone = Backbone(7, 3, **backbone)

    def forward(self, image, normals):
        """Encoded image and mask (B, 4, H, W) and normals (B, 3, H, W) to *encoded* albedo (B, 3, H, W).

        The encoding is that of the image, `albedo ** (1 / ENCODING)`, in which errors look alike in dark and
        bright cloth.
        """
        return image[:, :3] + self.backbone(torch.cat([image, normals], dim=1)).float()

    @torch.no_grad()
    def analyse(self, rgb, mask, normals):
        """Framed rgb (3, h, w), mask (h, w), normals (3, h, w) to linear albedo (3, h, w) in [0, 1]."""
        encoded = self(encode_image(rgb[None], mask[None, None]), normals[None])[0]
        return encoded.clamp(0, 1) ** ENCODING * (mask > 0)


def load(name="albedo"):
    """The shipped albedo network, or one trained by `relight train albedo` (a .safetensors path)."""
    return weights.load(name, {"albedo": AlbedoNetwork}, package="shading")


def infer_albedo(rgb, mask, *, normals=None, model="albedo"):
    """Diffuse albedo of the person in an image, without the light it was photographed in.

    Parameters
    ----------
    rgb: (H, W, 3) float, linear Rec.709, any size and exposure; NumPy or torch.
    mask: (H, W) in [0, 1], the matte of the person.
    normals: (H, W, 3) camera-frame normals to use instead of inferring them with the shipped network; or
        anything else that `shadow.normals.load` takes.
    model: name of shipped weights, or the path of a checkpoint.

    Returns
    -------
    (H, W, 3) float32 linear Rec.709 in [0, 1], zero outside the mask; at the network's resolution, enlarged.
    `relight.Subject` brings the plate's own texture back. NumPy or torch, as `rgb` was, on its device.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, an empty mask.
    """
    image = inputs.image("rgb", rgb)
    matte = inputs.mask("mask", mask, image.shape[1:]).to(image.device)
    network = load(model).to(image.device)
    framing = Framing.around(matte, network.size)
    framed, framed_mask = framing.crop(image), framing.crop(matte[None])[0]
    surface = on_canvas(resolve(normals, image, matte, network), framing, framed, framed_mask)
    albedo = network.analyse(framed, framed_mask, surface)
    restored = framing.restore(extend(albedo, framed_mask)).clamp(0, 1) * (matte > 0)
    return inputs.like(restored.permute(1, 2, 0), rgb)
