"""3 x 3 convolutions by Winograd's minimal filtering, F(4 x 4, 3 x 3) (Lavin and Gray 2016).

A tile of 4 x 4 pixels takes 36 products for a pair of channels instead of 144. PyTorch has this algorithm for
GPUs only. On one core both networks take 8 to 17 % less time in float32, and their maps change by less than
1e-5, by rounding. The gradient of the weights takes the same products: F(3 x 3, 4 x 4), with the matrices
transposed. oneDNN's takes two to seven times as long as its convolution on processors without AVX-512.
"""

from typing import Any

import torch
import torch.nn.functional as F
from torch import nn
from torch.autograd.function import once_differentiable

from shadow.torch_settings import own_settings

TILE = 4  # pixels a side that are computed together
FEWEST_CHANNELS = 64  # with fewer, transforming the tiles takes as long as what it saves
FEWEST_PIXELS = 512  # with fewer, transforming the filters does
FEWEST_PIXELS_LEARNED = 1024  # with fewer, transforming their gradient does
CHUNK = 1 << 19  # floats of transformed tiles that are computed together: 2 MiB stay in the processor's cache

# The matrices of Section 4.3, for both axes: of the input's tiles, of the filters, of the result's tiles.
with own_settings():
    _INPUT = torch.tensor(
        [
            [4, 0, -5, 0, 1, 0],
            [0, -4, -4, 1, 1, 0],
            [0, 4, -4, -1, 1, 0],
            [0, -2, -1, 2, 1, 0],
            [0, 2, -1, -2, 1, 0],
            [0, 4, 0, -5, 0, 1],
        ]
    ).float()
    _FILTER = torch.tensor([[6, 0, 0], [-4, -4, -4], [-4, 4, -4], [1, 2, 4], [1, -2, 4], [0, 0, 24]]) / 24
    _RESULT = torch.tensor(
        [[1, 1, 1, 1, 1, 0], [0, 1, -1, 2, -2, 0], [0, 1, 1, 4, 4, 0], [0, 1, -1, 8, -8, 1]]
    ).float()
    _INPUTS, _FILTERS, _RESULTS = (torch.kron(matrix, matrix) for matrix in (_INPUT, _FILTER, _RESULT))


class Conv3x3(nn.Conv2d):
    """A 3 x 3 convolution with zero padding; quicker in float32 on a CPU.

    Where its weights are frozen, the result is computed by minimal filtering, and where they learn, their
    gradient.
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__(in_channels, out_channels, 3, padding=1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        if self._is_quicker(x):
            return self._minimal(x)
        if self._learns_quicker(x):
            return _Learned.apply(x, self.weight, self.bias)
        return super().forward(x)

    def _is_quicker(self, x: torch.Tensor) -> bool:
        frozen = self._in_float32(x) and not self.weight.requires_grad
        return frozen and x.shape[1] >= FEWEST_CHANNELS and x[:, 0].numel() >= FEWEST_PIXELS

    def _learns_quicker(self, x: torch.Tensor) -> bool:
        if torch.compiler.is_compiling():  # a compiler could not trace the question for the processor
            return False
        learns = self._in_float32(x) and self.weight.requires_grad and torch.is_grad_enabled()
        slow = learns and torch.backends.cpu.get_cpu_capability() == "AVX2"
        return slow and x[:, 0].numel() >= FEWEST_PIXELS_LEARNED

    def _in_float32(self, x: torch.Tensor) -> bool:
        both = x.dtype == self.weight.dtype == torch.float32
        return both and x.device.type == "cpu" and not torch.is_autocast_enabled("cpu")

    def _minimal(self, x: torch.Tensor) -> torch.Tensor:
        height, width = x.shape[2:]
        filters = (_FILTERS @ self.weight.permute(2, 3, 1, 0).reshape(9, -1)).view(36, x.shape[1], -1)
        tiles = _input_tiles(x)
        _, down, across, channels = tiles.shape[:4]
        result = x.new_empty(len(x), down, TILE, across, TILE, self.out_channels)
        rows = max(1, CHUNK // (36 * channels * across))
        for image, target in zip(tiles, result, strict=True):
            for part, chunk in zip(image.split(rows), target.split(rows), strict=True):
                computed = _RESULTS @ torch.bmm(_transformed(_INPUTS, part), filters).view(36, -1)
                chunk.copy_(computed.view(TILE, TILE, -1, across, self.out_channels).permute(2, 0, 3, 1, 4))
        assert self.bias is not None
        result += self.bias
        return result.flatten(3, 4).flatten(1, 2)[:, :height, :width].permute(0, 3, 1, 2)


class _Learned(torch.autograd.Function):
    """PyTorch's convolution, and the gradient of its weights by minimal filtering."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
        ctx.save_for_backward(x, weight)
        return F.conv2d(x, weight, bias, padding=1)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        x, weight = ctx.saved_tensors
        gradient = gradient.contiguous(memory_format=torch.channels_last)
        of_x = F.conv2d(gradient, weight.flip(2, 3).transpose(0, 1), padding=1)
        return of_x, _weight_gradient(x, gradient), gradient.sum(dim=(0, 2, 3))


def _weight_gradient(x: torch.Tensor, gradient: torch.Tensor) -> torch.Tensor:
    """Return the weights' gradient (O, C, 3, 3) from the input (B, C, H, W) and the result's (B, O, H, W)."""
    tiles, results = _input_tiles(x), _result_tiles(gradient)
    across, channels, out_channels = *tiles.shape[2:4], results.shape[3]
    products = x.new_zeros(36, out_channels, channels)
    rows = max(1, CHUNK // (36 * (channels + out_channels) * across))
    for image, target in zip(tiles, results, strict=True):
        for part, chunk in zip(image.split(rows), target.split(rows), strict=True):
            spread = _transformed(_RESULTS.T, chunk)
            products.baddbmm_(spread.transpose(1, 2), _transformed(_INPUTS, part))
    return (_FILTERS.T @ products.flatten(1)).view(3, 3, out_channels, channels).permute(2, 3, 0, 1)


def _input_tiles(x: torch.Tensor) -> torch.Tensor:
    """Return the overlapping tiles (B, down, across, C, 6, 6) of images (B, C, H, W) with zeros around."""
    down, across = (-extent % TILE + 1 for extent in x.shape[2:])
    padded = F.pad(x.permute(0, 2, 3, 1), (0, 0, 1, across, 1, down))
    return padded.unfold(1, TILE + 2, TILE).unfold(2, TILE + 2, TILE)


def _result_tiles(x: torch.Tensor) -> torch.Tensor:
    """Return the tiles (B, down, across, C, 4, 4) of images (B, C, H, W), zero beyond them."""
    down, across = (-extent % TILE for extent in x.shape[2:])
    padded = F.pad(x.permute(0, 2, 3, 1), (0, 0, 0, across, 0, down))
    return padded.unfold(1, TILE, TILE).unfold(2, TILE, TILE)


def _transformed(matrix: torch.Tensor, tiles: torch.Tensor) -> torch.Tensor:
    """Apply a matrix (M, N) to the N pixels of tiles (down, across, C, h, w); return (M, down across, C)."""
    pixels = tiles.permute(3, 4, 0, 1, 2).reshape(matrix.shape[1], -1)
    return (matrix @ pixels).view(len(matrix), -1, tiles.shape[2])
