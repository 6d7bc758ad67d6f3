"""Upsample maps from the networks' canvas to the plate, guided by the plate: edges fall where it has them."""

import torch
import torch.nn.functional as F

from shadow.framing import Framing

EXTENSION_SHARE = 0.08  # of the canvas, by which maps are continued beyond the matte: for hair and soft edges
RANGE_SIGMA = 0.1  # guide difference (display-encoded) at which a weight falls to 60 %
MIN_RANGE_WEIGHT = 1e-3  # where no neighbour's guide is similar, the nearest decide
UNKNOWN_WEIGHT = 1e-4  # of canvas pixels off the person: they count where nothing else is near
TAPS = 4  # canvas pixels along each axis
GUIDE_ENCODING = 2.2  # exponent
GUIDE_MAX_LINEAR = 4.0  # exposed linear value at which a guide is clipped
GUIDE_MAX = GUIDE_MAX_LINEAR ** (1 / GUIDE_ENCODING)  # largest value of a guide
PIXELS_PER_STRIP = 1 << 14  # plate pixels at a time, to bound the memory


class JointBilateral:
    """Joint bilateral upsampling (Kopf et al. 2007) of canvas maps to the person's pixels on the plate.

    A plate pixel is a weighted mean of its 4 x 4 nearest canvas pixels. Nearer ones weigh more (cubic
    B-spline), and so do those whose guide is similar to the plate at that pixel. The weights depend on the
    guide only: the operator is linear, keeps constants and ranges, and adds no texture to the maps.

    `guide`: (P, 3) colours of the wanted plate pixels, display-encoded, see `encode_guide`; `pixels`: (P,)
    their indices on the plate, in row-major order. `canvas_guide`: (3, h, w) the same on the canvas, which
    `framing` places; `known`: (h, w) bool, the canvas pixels that show the person.
    """

    def __init__(
        self,
        framing: Framing,
        guide: torch.Tensor,
        canvas_guide: torch.Tensor,
        known: torch.Tensor,
        pixels: torch.Tensor,
    ) -> None:
        height, width = framing.canvas
        taps = torch.arange(TAPS)
        self.offsets = (taps[:, None] * width + taps).flatten().int()
        planes = canvas_guide.flatten(1).unbind()
        trust = torch.where(known.flatten(), 1.0, UNKNOWN_WEIGHT)
        rows, down = _taps(framing.plate[0], framing.centre[1], framing.scale, height)
        columns, right = _taps(framing.plate[1], framing.centre[0], framing.scale, width)
        rows *= width
        down, right = down.repeat_interleave(TAPS, dim=1), right.repeat(1, TAPS)
        self.strips = []
        for strip, here in zip(pixels.split(PIXELS_PER_STRIP), guide.split(PIXELS_PER_STRIP), strict=True):
            y = strip // framing.plate[1]
            x = strip - y * framing.plate[1]
            first = rows.index_select(0, y).add_(columns.index_select(0, x))
            indices = (first[:, None] + self.offsets).flatten()
            difference = torch.zeros(len(strip), len(self.offsets))
            for plane, shown in zip(planes, here.unbind(1), strict=True):
                seen = plane.index_select(0, indices).view_as(difference)
                difference += seen.sub_(shown[:, None]).square_()
            spatial = down.index_select(0, y).mul_(right.index_select(0, x))
            range_weights = difference.mul_(-0.5 / RANGE_SIGMA**2).exp_().clamp_min_(MIN_RANGE_WEIGHT)
            weights = range_weights.mul_(spatial).mul_(trust.index_select(0, indices).view_as(difference))
            # Half precision halves the memory of 16 weights a pixel. Dividing by the sum of the rounded
            # weights keeps constants exact.
            weights = weights.div_(weights.sum(dim=1, keepdim=True)).half()
            self.strips.append((first, weights, weights.float().sum(dim=1, keepdim=True)))

    def __call__(self, maps: torch.Tensor) -> torch.Tensor:
        """Upsample canvas maps (C, h, w) to the plate's pixels (P, C)."""
        # `embedding_bag` often takes twice as long for an odd number of channels.
        table = F.pad(maps.flatten(1).T, (0, len(maps) % 2)).contiguous()
        enlarged = []
        for first, weights, total in self.strips:
            indices = first[:, None] + self.offsets
            mean = F.embedding_bag(indices, table, per_sample_weights=weights.float(), mode="sum")
            enlarged.append(mean.div_(total))
        return torch.cat(enlarged)[:, : len(maps)]


def encode_guide(colour: torch.Tensor) -> torch.Tensor:
    """Encode exposed linear colour for a guide, perceptually about even: in [0, GUIDE_MAX]."""
    return colour.clamp(0, GUIDE_MAX_LINEAR) ** (1 / GUIDE_ENCODING)


def _taps(length: int, centre: float, scale: float, size: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Return, for the `length` plate pixels along an axis, the first of four canvas pixels and their weights.

    The first is (length,), such that all four are inside a canvas of `size` pixels; the weights (length, 4).
    """
    position = ((torch.arange(length) + 0.5 - centre) * scale + size / 2 - 0.5).clamp(1, size - 2.001)
    whole = position.floor()
    return whole.int() - 1, _b_spline(position - whole)


def _b_spline(t: torch.Tensor) -> torch.Tensor:
    """Return the weights (P, 4) of the uniform cubic B-spline at fractions t (P,)."""
    return torch.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], 1) / 6
