"""The paper's U-Net (Section 3, Table 1): one forward for one image and one light.

Table 1 fixes the kernels, the five strides and the 512 channels at 1/32 of the image. Widths and sets a block
it leaves open: these, and the decoder as the encoder's mirror, meet all four parameter counts of Table 4.
"""

import torch
import torch.nn.functional as F
from torch import nn

WIDTHS = (64, 128, 192, 256, 512)  # channels of the blocks, 1/2 to 1/32


class ConvSet(nn.Sequential):
    """Convolution, instance normalisation, activation: a set of Section 3."""

    def __init__(self, in_channels, out_channels, kernel=3, stride=1, norm=True):
        convolution = nn.Conv2d(in_channels, out_channels, kernel, stride, padding=kernel // 2)
        normalisation = [nn.InstanceNorm2d(out_channels)] if norm else []
        super().__init__(convolution, *normalisation, nn.ReLU())


class Residual(nn.Module):
    """ResB of Table 1. The parameters of Table 4 leave room for one convolution in each of the two."""

    def __init__(self, channels, kernel):
        super().__init__()
        self.set = ConvSet(channels, channels, kernel)

    def forward(self, x):
        return x + self.set(x)


class Attention(nn.Sequential):
    """Four identical multi-head self-attention layers (VSP*17) over the pixels of the latent image (Section
    4.2). The width between the linear projections follows from the parameters of Table 4; a pixel's place is
    known from the zero padding of the convolutions before."""

    def __init__(self, channels):
        width = 7 * channels
        super().__init__(
            *(nn.TransformerEncoderLayer(channels, 8, width, dropout=0.0, batch_first=True) for _ in range(4))
        )

    def forward(self, x):
        pixels = super().forward(x.flatten(2).transpose(1, 2))  # (B, H W, C)
        return pixels.transpose(1, 2).unflatten(2, x.shape[2:])


def _residuals(kernel):
    return lambda channels: nn.Sequential(Residual(channels, kernel), Residual(channels, kernel))


LATENTS = {"resb3": _residuals(3), "resb7": _residuals(7), "resb11": _residuals(11), "attention": Attention}


class UNet(nn.Module):
    def __init__(
        self,
        in_channels=9,  # RGB, normals and light direction; 6 without normals
        out_channels=1,
        latent="resb7",  # one of LATENTS; the paper's choice
        linear=False,  # Section 4.4: linear output, for shading, instead of tanh
        widths=WIDTHS,
    ):
        super().__init__()
        if latent not in LATENTS:
            raise ValueError(f"latent: expected one of {', '.join(LATENTS)}, got {latent!r}")
        steps = list(zip((in_channels, *widths), widths, strict=False))
        # The first convolution has no normalisation (as in IZZE17): it would subtract whatever is the same in
        # all pixels, and that is what the light direction is.
        self.encoder = nn.ModuleList(
            nn.Sequential(ConvSet(before, width, norm=level > 0), ConvSet(width, width, stride=2))
            for level, (before, width) in enumerate(steps)
        )
        self.latent = LATENTS[latent](widths[-1])
        mirrored = widths[::-1]
        self.decoder = nn.ModuleList(
            nn.Sequential(
                ConvSet(below + width, width),  # what comes from below, and the skip
                ConvSet(width, width),
                ConvSet(width, width),
            )
            for below, width in zip((mirrored[0], *mirrored), mirrored, strict=False)
        )
        self.head = nn.Conv2d(widths[0], out_channels, 1)
        self.linear = linear

    def forward(self, x):
        """(B, in_channels, H, W) to (B, out_channels, H, W), in [-1, 1] unless linear; H and W multiples of
        32, and not both 32, since a single latent pixel cannot be normalised."""
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
