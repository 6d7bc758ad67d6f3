"""The image network of the visibility field and the shading field: one forward for one image."""

import itertools
from collections.abc import Sequence
from typing import TypedDict

import torch
import torch.nn.functional as F
from torch import nn

from shadow.framing import bounding_box
from shadow.networks.winograd import Conv3x3

ENCODING = 2.2  # exponent of the display-like encoding of images and albedo
EXPOSURE = 0.2  # mean linear luminance inside the mask, after normalisation
MARGIN_PIXELS = 8  # empty canvas pixels that are computed around a subject
COARSEST_STRIDE = 32  # canvas pixels for each pixel of the lowest level


def encode_image(rgb: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return the input of a network: exposure-normalised colour in a display-like encoding, and the mask.

    rgb: (B, 3, H, W) linear, >= 0. mask: (B, 1, H, W) in [0, 1]. Returns (B, 4, H, W); the colour is masked,
    and in about [0, 2]. Section 3 trains with random overall intensities. Dividing by the mean over the mask
    makes the networks exactly invariant to them.
    """
    area = mask.sum(dim=(-2, -1), keepdim=True).clamp_min(1)
    mean = (rgb * mask).sum(dim=(-2, -1), keepdim=True).mean(dim=1, keepdim=True) / area
    exposed = rgb.clamp_min(0) * (EXPOSURE / mean.clamp_min(1e-6))
    return torch.cat([(exposed.clamp_max(4) + 1e-4) ** (1 / ENCODING) * mask, mask], dim=1)


class ChannelNorm(nn.LayerNorm):
    """Layer normalisation over the channels of each pixel.

    Unlike GroupNorm and InstanceNorm it does not depend on how much of the picture is background.
    """

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(x.permute(0, 2, 3, 1)).permute(0, 3, 1, 2)


class ResidualBlock(nn.Module):
    """Pre-activation residual block (HZRS16): x + two normalised 3 x 3 convolutions of x."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm1, self.conv1 = ChannelNorm(channels), Conv3x3(channels, channels)
        self.norm2, self.conv2 = ChannelNorm(channels), Conv3x3(channels, channels)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        h = self.conv1(F.silu(self.norm1(x)))
        return x + self.conv2(F.silu(self.norm2(h)))


class BackboneForm(TypedDict, total=False):
    """The arguments of `Backbone` that networks leave to their callers."""

    widths: Sequence[int]
    encoder: Sequence[int]
    decoder: Sequence[int]


class Backbone(nn.Module):
    """U-Net with additive skips (RFB15) and pre-activation residual blocks (HZRS16).

    It takes the place of the encoder and decoder of Section 3, Table 1. The image is read at half resolution
    (2 x 2 pixels unshuffled into channels), so that the top level is affordable on a CPU, and the head writes
    2 x 2 pixels back. The empty canvas around the subject, about a third for a standing person, is not
    computed.
    """

    def __init__(
        self,
        in_channels: int,  # 4 (colour and mask), or 7 with normals
        out_channels: int,  # channels of the head, at full resolution
        widths: Sequence[int] = (48, 96, 144, 192, 256),  # channels of each level, 1/2 to 1/32
        encoder: Sequence[int] = (1, 1, 2, 4, 6),  # residual blocks a level, on the way down
        decoder: Sequence[int] = (1, 2, 2, 2),  # residual blocks a level, on the way up
        guides: int = 0,  # channels of a second input, at half resolution
    ) -> None:
        super().__init__()
        self.stem = nn.Conv2d(4 * in_channels + guides, widths[0], 3, padding=1)
        self.encoder = nn.ModuleList(
            nn.Sequential(*(ResidualBlock(c) for _ in range(n))) for c, n in zip(widths, encoder, strict=True)
        )
        steps = list(itertools.pairwise(widths))
        self.down = nn.ModuleList(nn.Conv2d(fine, coarse, 2, stride=2) for fine, coarse in steps)
        self.up = nn.ModuleList(nn.Conv2d(coarse, fine, 1) for fine, coarse in steps)
        self.decoder = nn.ModuleList(
            nn.Sequential(*(ResidualBlock(c) for _ in range(n)))
            for c, n in zip(widths[:-1], decoder, strict=True)
        )
        self.norm = ChannelNorm(widths[0])
        self.head = nn.Conv2d(widths[0], 4 * out_channels, 1)
        for parameter in self.head.parameters():  # field.py and diffuse.py say what an output of zero means
            nn.init.zeros_(parameter)

    def forward(
        self, x: torch.Tensor, blocks: torch.Tensor | None = None, guides: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Map images (B, in_channels, H, W) to (B, out_channels, H, W), zero far from the subjects.

        The first four input channels are those of `encode_image`; `guides` are (B, guides, H/2, W/2). H and W
        are multiples of 32. With `blocks` (B, P) the result is `take_blocks(maps, blocks)`, (B, out_channels,
        4, P), at a lower cost.
        """
        canvas, (rows, columns) = x.shape[2:], subject_window(x[:, 3])
        x = F.pixel_unshuffle(x[..., rows, columns], 2)
        if guides is not None:  # their channels are adjacent in memory, as convolutions read them
            x = x.contiguous(memory_format=torch.channels_last)
            x = torch.cat([x, guides[..., _halved(rows), _halved(columns)]], dim=1)
        x = self.stem(x)
        skips = []
        for residuals, down in zip(self.encoder, self.down, strict=False):
            x = residuals(x)
            skips.append(x)
            x = down(x)
        x = self.encoder[-1](x)
        for residuals, up in zip(reversed(self.decoder), reversed(self.up), strict=True):
            x = skips.pop() + F.interpolate(up(x), scale_factor=2.0, mode="bilinear")
            x = residuals(x)
        x = F.silu(self.norm(x))
        if blocks is not None:
            row, column = blocks // (canvas[1] // 2), blocks % (canvas[1] // 2)
            return self._head_at(x, row - rows.start // 2, column - columns.start // 2)
        maps = F.pixel_shuffle(self.head(x), 2)
        return F.pad(maps, (columns.start, canvas[1] - columns.stop, rows.start, canvas[0] - rows.stop))

    def _head_at(self, x: torch.Tensor, row: torch.Tensor, column: torch.Tensor) -> torch.Tensor:
        """Apply the head to single pixels of features (B, C, h, w), whose rows and columns are (B, P).

        Returns (B, out_channels, 4, P): the 2 x 2 image pixels of each. Pixels outside the features give
        zero.
        """
        read = (row >= 0) & (row < x.shape[2]) & (column >= 0) & (column < x.shape[3])
        # A CPU computes a matrix product several times as fast as a 1 x 1 convolution.
        pixels = x.permute(0, 2, 3, 1).flatten(1, 2)
        index = (row * x.shape[3] + column) * read
        features = pixels.gather(1, index[..., None].expand(-1, -1, x.shape[1]))
        assert self.head.bias is not None
        weight, bias = (
            parameter.flatten(1).unflatten(0, (-1, 4)).transpose(0, 1).flatten(0, 1)  # the 2 x 2 pixels first
            for parameter in (self.head.weight, self.head.bias[:, None])
        )
        maps = F.linear(features, weight, bias[:, 0])
        if torch.compiler.is_compiling() or not read.all():
            maps = maps * read[..., None]
        return maps.unflatten(2, (4, -1)).permute(0, 3, 2, 1)  # channels are innermost in memory


def subject_window(mask: torch.Tensor) -> tuple[slice, slice]:
    """Return the slices of rows and columns that contain the subjects of masks (B, H, W) and a margin.

    They begin and end at multiples of COARSEST_STRIDE, so that the pixels of all levels keep their places on
    the canvas. Mattes in a video flicker: a window that moved with them would make the maps flicker too.
    """
    seen, (height, width) = mask.amax(dim=0), mask.shape[1:]
    # A compiled network has one size, and the photographs of a large mini-batch fill the canvas anyway.
    if torch.compiler.is_compiling() or not (seen > 0).any():
        return slice(0, height), slice(0, width)
    top, left, bottom, right = bounding_box(seen, threshold=0)
    return _window(top, bottom, height), _window(left, right, width)


def _window(low: int, high: int, extent: int) -> slice:
    start = (low - MARGIN_PIXELS) // COARSEST_STRIDE * COARSEST_STRIDE
    stop = -(-(high + MARGIN_PIXELS) // COARSEST_STRIDE) * COARSEST_STRIDE
    return slice(max(start, 0), min(stop, extent))


def _halved(span: slice) -> slice:
    return slice(span.start // 2, span.stop // 2)


def take_blocks(image: torch.Tensor, blocks: torch.Tensor) -> torch.Tensor:
    """Return the 2 x 2 pixels (B, C, 4, P) of blocks (B, P), counted in row order, of images (B, C, H, W)."""
    width = image.shape[3]
    corner = blocks // (width // 2) * 2 * width + blocks % (width // 2) * 2
    corners = torch.stack([corner, corner + 1, corner + width, corner + width + 1], dim=1)
    index = corners.flatten(1)[:, None].expand(-1, image.shape[1], -1)
    return image.flatten(2).gather(2, index).unflatten(2, (4, -1))
