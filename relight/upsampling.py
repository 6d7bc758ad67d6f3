"""From the networks' canvas to the plate, guided by the plate: edges fall where the plate has them."""

import torch
import torch.nn.functional as F

from shadow.framing import Framing

SIGMA = 0.1  # guide difference (display-encoded) at which a canvas pixel counts 60 % of an equal one
FLOOR = 1e-3  # least range weight: where no neighbour looks alike, the nearest decide
UNKNOWN = 1e-4  # weight of canvas pixels off the subject: they count where nothing else is near
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
        taps = torch.arange(-1, 3)
        self.offsets = (taps[:, None] * width + taps).flatten().int()
        canvas_guide = canvas_guide.flatten(1).T.contiguous()
        trust = torch.where(known.flatten(), 1.0, UNKNOWN)
        self.strips = []
        for strip, here in zip(pixels.split(STRIP), guide.split(STRIP), strict=True):
            y, x = strip // framing.plate[1], strip % framing.plate[1]
            row, down = _position(y, framing.centre[1], framing.scale, height)
            column, right = _position(x, framing.centre[0], framing.scale, width)
            nearest = (row * width + column).int()
            spatial = (_b_spline(down)[:, :, None] * _b_spline(right)[:, None, :]).flatten(1)
            weights = torch.empty(len(strip), len(self.offsets))
            for tap, offset in enumerate(self.offsets.tolist()):
                index = nearest + offset
                difference = (canvas_guide[index] - here).square_().sum(dim=1)
                alike = (difference * (-0.5 / SIGMA**2)).exp_().clamp_min_(FLOOR)
                weights[:, tap] = spatial[:, tap] * alike * trust[index]
            # Half precision holds 16 weights a pixel in the room of 8 maps; dividing by their rounded sum
            # keeps constants exact.
            weights = (weights / weights.sum(dim=1, keepdim=True)).half()
            self.strips.append((nearest, weights, weights.float().sum(dim=1, keepdim=True)))

    def __call__(self, maps: torch.Tensor) -> torch.Tensor:
        """Canvas maps (C, h, w) to the plate's pixels (P, C)."""
        table = maps.flatten(1).T.contiguous()
        enlarged = []
        for nearest, weights, total in self.strips:
            indices = nearest[:, None] + self.offsets
            mean = F.embedding_bag(indices, table, per_sample_weights=weights.float(), mode="sum")
            enlarged.append(mean.div_(total))
        return torch.cat(enlarged)


def _position(
    index: torch.Tensor, centre: float, scale: float, size: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Canvas pixel (whole) and fraction at a plate pixel's centre, kept inside the canvas for all taps."""
    position = ((index + 0.5 - centre) * scale + size / 2 - 0.5).clamp(1, size - 2.001)
    whole = position.floor()
    return whole.long(), position - whole


def _b_spline(t: torch.Tensor) -> torch.Tensor:
    """Weights (P, 4) of the uniform cubic B-spline at fractions t (P,)."""
    return torch.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], 1) / 6
