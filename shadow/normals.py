"""Surface normals of the photographed person, in the camera frame."""

import torch
import torch.nn.functional as F
from torch import nn

from shadow import inputs, weights
from shadow.backbone import Backbone, encode_image
from shadow.framing import Framing, extend


class NormalsNetwork(nn.Module):
    """RGB and mask to camera-frame normals. An untrained network says that all faces the camera."""

    def __init__(self, size=256, **backbone):
        super().__init__()
        self.size = size  # canvas height that the network was trained for
        self.backbone = Backbone(4, 3, **backbone)

    def forward(self, image):
        """Encoded image and mask (B, 4, H, W) to unit normals (B, 3, H, W)."""
        toward_camera = torch.tensor([0.0, 0.0, 1.0], device=image.device).view(1, 3, 1, 1)
        return F.normalize(self.backbone(image).float() + toward_camera, dim=1)

    @torch.no_grad()
    def analyse(self, rgb, mask):
        """Framed rgb (3, h, w), linear, and mask (h, w) to unit normals (3, h, w), zero outside the mask."""
        return self(encode_image(rgb[None], mask[None, None]))[0] * (mask > 0)


def load(name="normals"):
    """The shipped normals network, or one trained by `relight train normals` (a .safetensors path)."""
    return weights.load(name, {"normals": NormalsNetwork}, package="shadow")


def on_canvas(given, framing, framed, framed_mask):
    """Unit normals (3, h, w) on the canvas: the plate's (H, W, 3) if given, else inferred from the framed rgb
    (3, h, w) and mask (h, w)."""
    if given is None:
        return load().to(framed.device).analyse(framed, framed_mask)
    surface = inputs.normals("normals", given, framing.plate).to(framed.device)
    return F.normalize(framing.crop(surface), dim=0)


def infer_normals(rgb, mask, *, model="normals"):
    """Surface normals of the person in an image.

    Parameters
    ----------
    rgb: (H, W, 3) float, linear Rec.709, any size and exposure; NumPy or torch.
    mask: (H, W) in [0, 1], the matte of the person.
    model: name of shipped weights, or the path of a checkpoint.

    Returns
    -------
    (H, W, 3) float32 unit vectors in the camera frame (x right, y up, z to the camera), zero outside the
    mask. NumPy or torch, as `rgb` was, on its device.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, an empty mask.
    """
    image = inputs.image("rgb", rgb)
    matte = inputs.mask("mask", mask, image.shape[1:]).to(image.device)
    network = load(model).to(image.device)
    framing = Framing.around(matte, network.size)
    framed_mask = framing.crop(matte[None])[0]
    framed = network.analyse(framing.crop(image), framed_mask)
    normals = F.normalize(framing.restore(extend(framed, framed_mask)), dim=0) * (matte > 0)
    return inputs.like(normals.permute(1, 2, 0), rgb)
