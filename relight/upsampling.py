"""From the networks' canvas to the plate, guided by the plate: edges fall where the plate has them."""

import torch
import torch.nn.functional as F

from shadow.framing import Framing

SIGMA = 0.1  # guide difference (display-encoded) at which a canvas pixel counts 60 % of an equal one
FLOOR = 1e-3  # least range weight: where no neighbour looks alike, the nearest decide
UNKNOWN = 1e-4  # weight of canvas pixels off the subject: they count where nothing else is near
TAPS = 4  # canvas pixels along each axis
BRIGHTEST = 4 ** (1 / 2.2)  # of a guide
STRIP = 1 << 14  # plate pixels at a time, to bound the memory


class JointBilateral:
    """Joint bilateral upsampling (Kopf et al. 2007) of canvas maps to the subject's pixels on the plate.

    A plate pixel is a weighted mean of its 4 x 4 nearest canvas pixels: nearer ones weigh more (cubic
    B-spline), and those whose guide looks like the plate at that pixel. The weights depend on the guide only,
    so the operator is linear, keeps constants and ranges, and prints no texture into what it enlarges.

    Parameters
    ----------
    framing: shadow.framing.Framing between plate and canvas.
    guide: (P, 3), the colours of the plate pixels wanted, display-encoded.
    canvas_guide: (3, h, w), the same on the canvas.
    known: (h, w) bool, the canvas pixels that show the subject.
    pixels: (P,) indices of those pixels on the plate, in row-major order.
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
        trust = torch.where(known.flatten(), 1.0, UNKNOWN)
        rows, down = _taps(framing.plate[0], framing.centre[1], framing.scale, height)
        columns, right = _taps(framing.plate[1], framing.centre[0], framing.scale, width)
        rows *= width
        down, right = down.repeat_interleave(TAPS, dim=1), right.repeat(1, TAPS)
        self.strips = []
        for strip, here in zip(pixels.split(STRIP), guide.split(STRIP), strict=True):
            y = strip // framing.plate[1]
            x = strip - y * framing.plate[1]
            first = rows.index_select(0, y).add_(columns.index_select(0, x))
            indices = (first[:, None] + self.offsets).flatten()
            difference = torch.zeros(len(strip), len(self.offsets))
            for plane, shown in zip(planes, here.unbind(1), strict=True):
                seen = plane.index_select(0, indices).view_as(difference)
                difference += seen.sub_(shown[:, None]).square_()
            spatial = down.index_select(0, y).mul_(right.index_select(0, x))
            alike = difference.mul_(-0.5 / SIGMA**2).exp_().clamp_min_(FLOOR)
            weights = alike.mul_(spatial).mul_(trust.index_select(0, indices).view_as(difference))
            # Half precision holds 16 weights a pixel in the room of 8 maps; dividing by their rounded sum
            # keeps constants exact.
            weights = weights.div_(weights.sum(dim=1, keepdim=True)).half()
            self.strips.append((first, weights, weights.float().sum(dim=1, keepdim=True)))

    def __call__(self, maps: torch.Tensor) -> torch.Tensor:
        """Canvas maps (C, h, w) to the plate's pixels (P, C)."""
        # Of an odd number of channels `embedding_bag` often takes twice as long.
        table = F.pad(maps.flatten(1).T, (0, len(maps) % 2)).contiguous()
        enlarged = []
        for first, weights, total in self.strips:
            indices = first[:, None] + self.offsets
            mean = F.embedding_bag(indices, table, per_sample_weights=weights.float(), mode="sum")
            enlarged.append(mean.div_(total))
        return torch.cat(enlarged)[:, : len(maps)]


def as_seen(colour: torch.Tensor) -> torch.Tensor:
    """Exposed linear colour as the eye spaces it, for guides: in [0, BRIGHTEST]."""
    return colour.clamp(0, 4) ** (1 / 2.2)


def _taps(length: int, centre: float, scale: float, size: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Along one axis of the plate, of `length` pixels: the first of each one's four canvas pixels (length,),
    all of which are kept inside the canvas, and their weights (length, 4)."""
    position = ((torch.arange(length) + 0.5 - centre) * scale + size / 2 - 0.5).clamp(1, size - 2.001)
    whole = position.floor()
    return whole.int() - 1, _b_spline(position - whole)


def _b_spline(t: torch.Tensor) -> torch.Tensor:
    """Weights (P, 4) of the uniform cubic B-spline at fractions t (P,)."""
    return torch.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], 1) / 6
