"""The image network that the visibility field and the shading field share: one forward for one image."""

import itertools
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import nn

from shadow.framing import bounding_box

ENCODING = 2.2  # exponent of the display-like encoding that images and albedo are seen in
EXPOSURE = 0.2  # mean linear luminance inside the mask, after normalisation
MARGIN = 8  # pixels of empty canvas that a subject keeps around it
COARSEST = 32  # pixels that one of the lowest level stands for


def encode_image(rgb: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """What a network sees: exposure-normalised, display-like encoding, masked, and the mask itself.

    rgb: (B, 3, H, W) linear, >= 0. mask: (B, 1, H, W) in [0, 1]. Returns (B, 4, H, W), the colour in about
    [0, 2]. Section 3 asks for any overall intensity: dividing by the mean over the mask gives exactly that.
    """
    area = mask.sum(dim=(-2, -1), keepdim=True).clamp_min(1)
    mean = (rgb * mask).sum(dim=(-2, -1), keepdim=True).mean(dim=1, keepdim=True) / area
    exposed = rgb.clamp_min(0) * (EXPOSURE / mean.clamp_min(1e-6))
    return torch.cat([(exposed.clamp_max(4) + 1e-4) ** (1 / ENCODING) * mask, mask], dim=1)


class ChannelNorm(nn.LayerNorm):
    """Layer normalisation over the channels of each pixel: it cannot see how much background there is,
    as GroupNorm and InstanceNorm do."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(x.permute(0, 2, 3, 1)).permute(0, 3, 1, 2)


class Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm1, self.conv1 = ChannelNorm(channels), nn.Conv2d(channels, channels, 3, padding=1)
        self.norm2, self.conv2 = ChannelNorm(channels), nn.Conv2d(channels, channels, 3, padding=1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        h = self.conv1(F.silu(self.norm1(x)))
        return x + self.conv2(F.silu(self.norm2(h)))


class Backbone(nn.Module):
    """U-Net with additive skips (RFB15) and pre-activation residual blocks (HZRS16).

    The image is read at half resolution (2 x 2 pixels unshuffled into channels), so that the top level is
    affordable on a CPU, and the head writes 2 x 2 pixels back. The empty canvas around the subject, a third
    or so where somebody stands upright, is not read at all.
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
            nn.Sequential(*(Residual(c) for _ in range(n))) for c, n in zip(widths, encoder, strict=True)
        )
        steps = list(itertools.pairwise(widths))
        self.down = nn.ModuleList(nn.Conv2d(fine, coarse, 2, stride=2) for fine, coarse in steps)
        self.up = nn.ModuleList(nn.Conv2d(coarse, fine, 1) for fine, coarse in steps)
        self.decoder = nn.ModuleList(
            nn.Sequential(*(Residual(c) for _ in range(n))) for c, n in zip(widths[:-1], decoder, strict=True)
        )
        self.norm = ChannelNorm(widths[0])
        self.head = nn.Conv2d(widths[0], 4 * out_channels, 1)
        for parameter in self.head.parameters():  # every network starts at its base: see field.py, diffuse.py
            nn.init.zeros_(parameter)

    def forward(
        self, x: torch.Tensor, blocks: torch.Tensor | None = None, guides: torch.Tensor | None = None
    ) -> torch.Tensor:
        """(B, in_channels, H, W), the first four as `encode_image` makes them, and guides (B, guides, H/2,
        W/2), if any, to (B, out_channels, H, W), zero far from the subjects; H and W multiples of 32.

        With `blocks`, to what `take_blocks` takes of it, (B, out_channels, 4, P), and at less cost.
        """
        canvas, (rows, columns) = x.shape[2:], windows(x[:, 3])
        x = F.pixel_unshuffle(x[..., rows, columns], 2)
        if guides is not None:
            guides = guides[..., _halved(rows), _halved(columns)]
        x = self.stem(x if guides is None else torch.cat([x, guides], dim=1))
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
        if blocks is None:
            maps = F.pixel_shuffle(self.head(x), 2)
            beyond = columns.start, canvas[1] - columns.stop, rows.start, canvas[0] - rows.stop
            return F.pad(maps, beyond)
        row, column = blocks // (canvas[1] // 2), blocks % (canvas[1] // 2)
        blocks = (row - rows.start // 2) * x.shape[3] + column - columns.start // 2
        # A product of matrices, which a CPU does several times as fast as a convolution of 1 x 1 pixels.
        pixels = x.permute(0, 2, 3, 1).flatten(1, 2)
        features = pixels.gather(1, blocks[..., None].expand(-1, -1, x.shape[1]))
        maps = F.linear(features, self.head.weight.flatten(1), self.head.bias)
        return maps.unflatten(2, (-1, 4)).permute(0, 2, 3, 1)


def windows(mask: torch.Tensor) -> tuple[slice, slice]:
    """The rows and columns (slices) that the subjects of masks (B, H, W) need: around all that is above zero,
    MARGIN to each side or to the canvas's edge.

    They begin and end at multiples of COARSEST, so that the pixels of all levels stay where they are on the
    canvas: in a video, whose mattes tremble, a window that moved would make the maps tremble.
    """
    seen, (height, width) = mask.amax(dim=0), mask.shape[1:]
    if not (seen > 0).any():
        return slice(0, height), slice(0, width)
    top, left, bottom, right = bounding_box(seen, threshold=0)
    return _window(top, bottom, height), _window(left, right, width)


def _window(low: int, high: int, extent: int) -> slice:
    start, stop = (low - MARGIN) // COARSEST * COARSEST, -(-(high + MARGIN) // COARSEST) * COARSEST
    return slice(max(start, 0), min(stop, extent))


def _halved(span: slice) -> slice:
    return slice(span.start // 2, span.stop // 2)


def take_blocks(image: torch.Tensor, blocks: torch.Tensor) -> torch.Tensor:
    """The 2 x 2 pixels of each block: (B, C, H, W) to (B, C, 4, P); `blocks` (B, P) count in row order."""
    width = image.shape[3]
    corner = blocks // (width // 2) * 2 * width + blocks % (width // 2) * 2
    corners = torch.stack([corner, corner + 1, corner + width, corner + width + 1], dim=1)
    return _gather(image, corners.flatten(1)).unflatten(2, (4, -1))


def _gather(image: torch.Tensor, index: torch.Tensor) -> torch.Tensor:
    """(B, C, H, W) and (B, P) to (B, C, P)."""
    return image.flatten(2).gather(2, index[:, None].expand(-1, image.shape[1], -1))
