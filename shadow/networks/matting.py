"""The network that cuts people out: a photograph and a rough mask become a matte.

The rough mask is a fourth channel of the input, as in mask-guided matting (Yu et al., "Mask Guided Matting
via Progressive Refinement Network", CVPR 2021), so that the network neither looks for people nor chooses
among them. One decoder gives a coarse matte at 1/8 of the resolution, for where the person is, and the fine
one (Ke et al., "MODNet", AAAI 2022). The blocks are those of the visibility field.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import nn

from shadow.networks.backbone import ChannelNorm, ResidualBlock

TRUST = 4.0  # logit of the matte where the rough mask is 1, before anything was learned
COARSE_LEVEL = 2  # of the decoder, whose output is the coarse matte


class Mattes(NamedTuple):
    """Logits of a matte, fine (B, 1, H, W) and coarse (B, 1, H/8, W/8)."""

    fine: torch.Tensor
    coarse: torch.Tensor


class MattingNetwork(nn.Module):
    """U-Net (RFB15) of pre-activation residual blocks (HZRS16), from 1/2 to 1/32 of the resolution."""

    def __init__(
        self,
        size: int = 512,  # side of the photographs, in pixels, on which it was trained last
        widths: Sequence[int] = (24, 48, 96, 160, 256),  # channels of each level
        encoder: Sequence[int] = (1, 1, 2, 2, 2),  # residual blocks a level, on the way down
        decoder: Sequence[int] = (1, 1, 2, 2),  # residual blocks a level, on the way up
    ) -> None:
        super().__init__()
        self.size = size
        self.stem = nn.Conv2d(4 * 4, widths[0], 3, padding=1)
        self.encoder = nn.ModuleList(_blocks(c, n) for c, n in zip(widths, encoder, strict=True))
        steps = list(itertools.pairwise(widths))
        self.down = nn.ModuleList(nn.Conv2d(fine, coarse, 2, stride=2) for fine, coarse in steps)
        self.up = nn.ModuleList(nn.Conv2d(coarse, fine, 1) for fine, coarse in steps)
        self.decoder = nn.ModuleList(_blocks(c, n) for c, n in zip(widths[:-1], decoder, strict=True))
        self.coarse_head = nn.Conv2d(widths[COARSE_LEVEL], 1, 1)
        self.norm = ChannelNorm(widths[0])
        self.head = nn.Conv2d(widths[0], 4, 1)
        for parameter in (*self.head.parameters(), *self.coarse_head.parameters()):
            nn.init.zeros_(parameter)  # the matte is the rough mask at first

    def forward(self, rgb: torch.Tensor, mask: torch.Tensor) -> Mattes:
        """Return the mattes of photographs (B, 3, H, W), sRGB-encoded, with masks (B, 1, H, W), in [0, 1].

        H and W are multiples of 32.
        """
        x = F.pixel_unshuffle(torch.cat([rgb, mask], dim=1) * 2 - 1, 2)
        x = self.stem(x.contiguous(memory_format=torch.channels_last))
        skips = []
        for residuals, down in zip(self.encoder, self.down, strict=False):
            x = residuals(x)
            skips.append(x)
            x = down(x)
        x = self.encoder[-1](x)
        coarse = mask
        for level in reversed(range(len(self.decoder))):
            x = skips[level] + F.interpolate(self.up[level](x), scale_factor=2.0, mode="bilinear")
            x = self.decoder[level](x)
            if level == COARSE_LEVEL:
                coarse = self.coarse_head(x)
        trusted = TRUST * (2 * mask - 1)
        fine = F.pixel_shuffle(self.head(F.silu(self.norm(x))), 2) + trusted
        return Mattes(fine, coarse + F.avg_pool2d(trusted, mask.shape[-1] // coarse.shape[-1]))


def _blocks(channels: int, count: int) -> nn.Sequential:
    return nn.Sequential(*(ResidualBlock(channels) for _ in range(count)))
