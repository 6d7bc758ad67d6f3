"""Transform a plate of any size to the networks' canvas around the subject, and back.

The networks see people at one scale. Training and inference use the same framing: the subject's bounding box
is centred on a portrait canvas (3:4) and scaled to fill it, except for a margin. There is no margin on a side
where the plate's frame cuts the subject.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
import torch.nn.functional as F
from scipy import ndimage

CANVAS_MARGIN = 0.04  # share of the canvas on each side: small, since larger subjects give better maps
ASPECT = 0.75  # width over height
LARGEST_CANVAS = 8192  # pixels of height: a larger value is a mistake, or comes from a damaged file


def canvas_size(height: int) -> tuple[int, int]:
    """Return (height, width) of the canvas.

    Raises ValueError unless the height is a multiple of 128 (so that both are multiples of 32) and at most
    LARGEST_CANVAS.
    """
    if height % 128 or not 0 < height <= LARGEST_CANVAS:
        raise ValueError(f"size: expected a multiple of 128 up to {LARGEST_CANVAS}, got {height}")
    return height, int(height * ASPECT)


def bounding_box(mask: torch.Tensor, threshold: float = 0.5) -> tuple[int, int, int, int]:
    """Return (top, left, bottom, right) of `mask` (H, W) > `threshold`, in pixels; the last two exclusive."""
    rows = torch.nonzero(mask.amax(dim=1) > threshold)[:, 0]  # comparing each pixel takes four times as long
    if not len(rows):
        raise ValueError("mask: is empty, so there is no subject to frame")
    top, bottom = int(rows[0]), int(rows[-1]) + 1
    columns = torch.nonzero(mask[top:bottom].amax(dim=0) > threshold)[:, 0]
    return top, int(columns[0]), bottom, int(columns[-1]) + 1


def affine_sample(
    tensor: torch.Tensor, matrix: torch.Tensor, size: tuple[int, ...], beyond: str = "zeros"
) -> torch.Tensor:
    """Sample `tensor` (C, H, W) on a canvas of `size` (h, w); zero beyond its frame, or the "border" goes on.

    `matrix` (2, 3) maps a canvas position (x, y, 1) in pixels to a position in the tensor; pixel centres are
    at half-integers. If the canvas is coarser than the tensor, each canvas pixel is the mean of several
    samples, so that fine texture does not alias. The sample positions depend on the matrix only: another crop
    of the tensor, with the matrix that belongs to it, gives the same values.
    """
    height, width = size
    shrink = float(torch.linalg.det(matrix[:, :2]).abs().sqrt())
    finer = math.ceil(shrink) if shrink > 1.5 else 1
    y, x = (((torch.arange(length * finer) + 0.5) / finer).to(tensor) for length in (height, width))
    across, down, offset = matrix.to(tensor).T
    extent = torch.tensor([tensor.shape[-1], tensor.shape[-2]]).to(tensor)
    grid = (x[:, None] * across + y[:, None, None] * down + offset) * 2 / extent - 1
    canvas = F.grid_sample(tensor[None], grid[None], padding_mode=beyond, align_corners=False)
    return F.avg_pool2d(canvas, finer)[0] if finer > 1 else canvas[0]


@dataclass(frozen=True)
class Framing:
    """The place of the canvas on the plate: `scale` canvas pixels for a plate pixel, centred at (x, y)."""

    centre: tuple[float, float]
    scale: float
    canvas: tuple[int, int]
    plate: tuple[int, int]

    @classmethod
    def around(cls, mask: torch.Tensor, height: int) -> "Framing":
        """Return the framing of the subject that `mask` (H, W) shows, on a canvas of `height` pixels."""
        top, left, bottom, right = bounding_box(mask)
        canvas, plate = canvas_size(height), (mask.shape[0], mask.shape[1])
        # Where the plate's frame cuts the subject, the frame of the canvas cuts it too. With a margin, the
        # networks would see the end of the body there and round it off.
        low, cut_low = np.array([top, left]), np.array([top, left]) == 0
        high, cut_high = np.array([bottom, right]), np.array([bottom, right]) == plate
        usable = 1 - CANVAS_MARGIN * (2 - cut_low - cut_high)
        scale = float((usable * canvas / (high - low)).min())
        half = np.array(canvas) / scale / 2
        centre = np.where(cut_low & ~cut_high, half, (low + high) / 2)
        centre = np.where(cut_high & ~cut_low, np.array(plate) - half, centre)
        return cls((float(centre[1]), float(centre[0])), scale, canvas, plate)

    def shifted(self, left: int, top: int, plate: tuple[int, int]) -> "Framing":
        """Return the same canvas on a larger plate, in which this framing's plate begins at (left, top)."""
        return replace(self, centre=(self.centre[0] + left, self.centre[1] + top), plate=plate)

    def onto(self, other: "Framing") -> torch.Tensor:
        """Return the matrix (2, 3) from positions on this canvas to those on another of the same plate."""
        scale = other.scale / self.scale
        here, there = (torch.tensor(framing.canvas[::-1]) / 2 for framing in (self, other))
        moved = (torch.tensor(self.centre) - torch.tensor(other.centre)) * other.scale
        return torch.cat([torch.eye(2) * scale, (moved + there - here * scale)[:, None]], dim=1)

    def crop(self, tensor: torch.Tensor) -> torch.Tensor:
        """Sample (C, H, W) on the plate as (C, h, w) on the canvas; zero beyond the plate."""
        step = 1 / self.scale
        offset = [c - n / 2 * step for c, n in zip(self.centre, self.canvas[::-1], strict=True)]
        return affine_sample(tensor, torch.tensor([[step, 0, offset[0]], [0, step, offset[1]]]), self.canvas)

    def restore(self, tensor: torch.Tensor) -> torch.Tensor:
        """Sample (C, h, w) on the canvas as (C, H, W) on the plate; zero beyond the canvas."""
        offset = [n / 2 - c * self.scale for c, n in zip(self.centre, self.canvas[::-1], strict=True)]
        matrix = torch.tensor([[self.scale, 0, offset[0]], [0, self.scale, offset[1]]])
        return affine_sample(tensor, matrix, self.plate)


class Extension:
    """Extrapolate canvas maps beyond the edge of `mask` (h, w), by `reach` times its height.

    Values inside are kept, and values farther out are zero. Without this, enlarging a map that is zero
    outside the subject would draw a dark line along every matte edge. The method is normalised convolution
    (Knutsson and Westin 1993), ring by ring: a pixel is the mean of the neighbours that already have a value.
    The neighbours depend on the mask only, so they are found once for all maps.
    """

    def __init__(self, mask: torch.Tensor, reach: float = 1 / 32) -> None:
        self.known = mask > 0.5
        height, width = mask.shape
        distance = ndimage.distance_transform_cdt(~self.known.cpu().numpy(), "chessboard")
        y, x = np.nonzero((distance > 0) & (distance <= round(reach * height)))
        order = np.argsort(distance[y, x], kind="stable")  # ring by ring
        y, x = y[order], x[order]
        step = np.arange(-1, 2)
        pixels = y * width + x
        # A neighbour beyond the canvas counts as farther than all others, so its weight is 0.
        neighbours = (pixels[:, None] + (step[:, None] * width + step).ravel()).clip(0, height * width - 1)
        ring = np.pad(distance, 1, constant_values=height + width)
        padded_pixels = (y + 1) * (width + 2) + x + 1
        around = padded_pixels[:, None] + (step[:, None] * (width + 2) + step).ravel()
        weights = (ring.ravel()[around] < distance[y, x][:, None]).astype(np.float32)
        weights /= weights.sum(axis=1, keepdims=True)
        sizes = np.bincount(distance[y, x])[1:].tolist()
        # For each ring: its pixels (n,), their neighbours (n, 9) and the neighbours' weights (n, 9).
        parts = (torch.from_numpy(a).to(mask.device).split(sizes) for a in (pixels, neighbours, weights))
        self.rings = list(zip(*parts, strict=True))

    def __call__(self, maps: torch.Tensor) -> torch.Tensor:
        """Return canvas maps (C, h, w) extrapolated beyond the mask's edge."""
        table = (maps * self.known).flatten(1).T.contiguous()
        for ring, neighbours, weights in self.rings:
            table[ring] = F.embedding_bag(neighbours, table, per_sample_weights=weights, mode="sum")
        return table.T.view(maps.shape)


@dataclass(frozen=True)
class Framed:
    """A photograph and its matte on the networks' canvas, and the mapping back to the plate."""

    framing: Framing
    rgb: torch.Tensor  # (3, h, w) linear
    mask: torch.Tensor  # (h, w) in [0, 1]
    matte: torch.Tensor  # (H, W) in [0, 1], on the plate

    @classmethod
    def of(cls, rgb: torch.Tensor, matte: torch.Tensor, height: int) -> "Framed":
        """Frame a photograph (3, H, W) and its matte (H, W) on a canvas of `height` pixels.

        A canvas pixel that the plate covers partly has the mean colour of that part, so the plate's frame
        leaves no black edge. Raises ValueError if the subject is too thin for any canvas pixel to show it.
        """
        framing = Framing.around(matte, height)
        layers = framing.crop(torch.cat([matte[None], torch.ones_like(matte)[None], rgb]))
        mask, covered, colour = layers[0].clamp(0, 1), layers[1:2], layers[2:]
        if not (mask > 0.5).any():
            thinnest = 1 / framing.scale
            raise ValueError(
                f"mask: is too thin for its length, expected at least {thinnest:.1f} pixels across somewhere"
            )
        colour = colour / covered.clamp_min(1e-6) * (covered > 0)
        return cls(framing, colour, mask, matte)

    def restored(self, maps: torch.Tensor) -> torch.Tensor:
        """Resample canvas maps (C, h, w) to the plate (C, H, W), extrapolated to the matte's edge."""
        return self.framing.restore(Extension(self.mask)(maps)) * (self.matte > 0)

    def to(self, device: torch.device | str) -> "Framed":
        """Return a copy with its tensors on another device."""
        moved = (tensor.to(device) for tensor in (self.rgb, self.mask, self.matte))
        return Framed(self.framing, *moved)
