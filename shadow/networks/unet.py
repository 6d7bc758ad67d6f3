"""The paper's network (Section 3, Table 1): a U-Net with one forward for each image and light.

Table 1 gives the kernels, the five strides and the 512 channels at 1/32 of the resolution. It does not give
the widths of the other levels and the number of sets in each block. With the values here, and a decoder that
mirrors the encoder, all four parameter counts of Table 4 are met.
"""

from collections.abc import Callable
from typing import TypedDict, Unpack

import torch
import torch.nn.functional as F
from torch import nn

from shadow.networks.backbone import encode_image

WIDTHS = (64, 128, 192, 256, 512)  # channels of the blocks, 1/2 to 1/32
LIGHTS_AT_ONCE = 8  # batch size at inference: 1 GB of activations on a canvas of 512 x 384


class ConvSet(nn.Sequential):
    """Convolution, instance normalisation and activation: a "set" of Section 3."""

    def __init__(
        self, in_channels: int, out_channels: int, kernel: int = 3, stride: int = 1, norm: bool = True
    ) -> None:
        convolution = nn.Conv2d(in_channels, out_channels, kernel, stride, padding=kernel // 2)
        normalisation = [nn.InstanceNorm2d(out_channels)] if norm else []
        super().__init__(convolution, *normalisation, nn.ReLU())


class ResidualBlock(nn.Module):
    """ResB of Table 1, with one convolution: two would exceed the parameter counts of Table 4."""

    def __init__(self, channels: int, kernel: int) -> None:
        super().__init__()
        self.set = ConvSet(channels, channels, kernel)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + self.set(x)


class Attention(nn.Sequential):
    """Four identical multi-head self-attention layers (VSP*17) over the latent pixels (Section 4.2).

    The width between the linear projections follows from the parameter count of Table 4. There is no
    positional encoding: the zero padding of the preceding convolutions encodes the position.
    """

    def __init__(self, channels: int) -> None:
        width = 7 * channels
        super().__init__(
            *(nn.TransformerEncoderLayer(channels, 8, width, dropout=0.0, batch_first=True) for _ in range(4))
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        pixels = super().forward(x.flatten(2).transpose(1, 2))  # (B, H W, C)
        return pixels.transpose(1, 2).unflatten(2, x.shape[2:])


def _residuals(kernel: int) -> Callable[[int], nn.Module]:
    return lambda channels: nn.Sequential(ResidualBlock(channels, kernel), ResidualBlock(channels, kernel))


LATENTS = {"resb3": _residuals(3), "resb7": _residuals(7), "resb11": _residuals(11), "attention": Attention}


class UNetForm(TypedDict, total=False):
    """The arguments of `UNet` that networks leave to their callers."""

    widths: tuple[int, ...]


class UNet(nn.Module):
    """Encoder, latent transformation and decoder of Table 1, with skip connections between equal levels."""

    def __init__(
        self,
        in_channels: int = 9,  # RGB, normals and light direction; 6 without normals
        out_channels: int = 1,
        latent: str = "resb7",  # one of LATENTS; the paper's choice
        linear: bool = False,  # Section 4.4: linear output, for shading, instead of tanh
        widths: tuple[int, ...] = WIDTHS,
    ) -> None:
        super().__init__()
        if latent not in LATENTS:
            raise ValueError(f"latent: expected one of {', '.join(LATENTS)}, got {latent!r}")
        steps = list(zip((in_channels, *widths), widths, strict=False))
        # The first convolution has no normalisation (as in IZZE17), which would remove the light direction,
        # since that is the same in all pixels.
        self.encoder = nn.ModuleList(
            nn.Sequential(ConvSet(before, width, norm=level > 0), ConvSet(width, width, stride=2))
            for level, (before, width) in enumerate(steps)
        )
        self.latent = LATENTS[latent](widths[-1])
        mirrored = widths[::-1]
        self.decoder = nn.ModuleList(
            nn.Sequential(
                ConvSet(below + width, width),  # the upsampled features and the skip connection
                ConvSet(width, width),
                ConvSet(width, width),
            )
            for below, width in zip((mirrored[0], *mirrored), mirrored, strict=False)
        )
        self.head = nn.Conv2d(widths[0], out_channels, 1)
        self.linear = linear

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, in_channels, H, W) to (B, out_channels, H, W), in [-1, 1] unless linear.

        H and W are multiples of 32, and not both 32, since a single latent pixel cannot be normalised.
        """
        skips = []
        for down in self.encoder:
            x = down(x)
            skips.append(x)
        x = self.latent(x)
        for up in self.decoder:
            x = up(torch.cat([x, skips.pop()], dim=1))
            x = F.interpolate(x, scale_factor=2.0, mode="bilinear")
        x = self.head(x)
        return x if self.linear else torch.tanh(x)


def per_light(image: torch.Tensor, normals: torch.Tensor | None, directions: torch.Tensor) -> torch.Tensor:
    """Return the input of each light (B, D, 9, H, W): colour, normals (B, 3, H, W), and its direction.

    The image is (B, C, H, W), colour first, directions are (B, D, 3). Without normals there are 6 channels.
    """
    seen = image[:, :3] if normals is None else torch.cat([image[:, :3], normals], dim=1)
    seen = seen[:, None].expand(-1, directions.shape[1], -1, -1, -1)
    return torch.cat([seen, directions[..., None, None].expand(-1, -1, -1, *image.shape[-2:])], dim=2)


class PerLight(nn.Module):
    """The paper's visibility network (Section 3), from colour, normals and a light direction to a map."""

    def __init__(
        self, size: int = 256, latent: str = "resb7", normals: bool = True, **unet: Unpack[UNetForm]
    ) -> None:
        super().__init__()
        self.size = size  # canvas height that the network was trained for
        self.latent = latent
        self.normals = normals  # False: colour and direction only, the ablation "w/o Nor." of Table 3
        self.unet = UNet(9 if normals else 6, 1, latent, **unet)

    def forward(
        self, image: torch.Tensor, normals: torch.Tensor | None, directions: torch.Tensor
    ) -> torch.Tensor:
        """Infer maps (B, D, H, W) in [-1, 1], the range of tanh, where -1 is shadow and 1 is light.

        image: encoded image and mask (B, 4, H, W). normals: (B, 3, H, W) or None. directions: (B, D, 3) unit.
        """
        inputs = per_light(image, normals if self.normals else None, directions)
        return self.unet(inputs.flatten(0, 1)).float().unflatten(0, directions.shape[:2])[:, :, 0]

    @torch.no_grad()
    def analyse(
        self, rgb: torch.Tensor, mask: torch.Tensor, normals: torch.Tensor | None = None
    ) -> tuple[torch.Tensor | None, Callable[[torch.Tensor], torch.Tensor]]:
        """Return the given normals and a function that infers visibility from directions.

        rgb (3, h, w), linear, and mask (h, w) are on the canvas. normals (3, h, w) may be None if the network
        takes none. The function takes unit directions (D, 3) and returns their visibility (D, h, w) in [0,
        1], zero outside the mask. It runs the network once for each direction.
        """
        image = encode_image(rgb[None], mask[None, None])
        surface = None if normals is None else normals[None]

        def visibility(directions: torch.Tensor) -> torch.Tensor:
            with torch.no_grad():
                batches = directions.split(LIGHTS_AT_ONCE)
                maps = torch.cat([self(image, surface, batch[None])[0] for batch in batches])
                return (maps + 1) / 2 * (mask > 0)

        return normals, visibility
