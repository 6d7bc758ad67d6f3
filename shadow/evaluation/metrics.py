"""The paper's metrics: pure functions of maps and a mask.

Maps are (..., H, W), the mask (H, W) bool or broadcastable; results are (...). All but SSIM look at the
masked pixels only (Section 4.1).
"""

import torch
from kornia.metrics import ssim as ssim_map

from shadow.framing import bounding_box

WINDOW = 11  # pixels of SSIM's Gaussian window, sigma 1.5


def _masked_mean(values: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    weight = mask.to(values)
    return (values * weight).sum(dim=(-2, -1)) / weight.expand_as(values).sum(dim=(-2, -1)).clamp_min(1)


def rmse(estimate: torch.Tensor, truth: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Root mean square error inside the mask, lower is better."""
    return _masked_mean((estimate - truth).square(), mask).sqrt()


def psnr(rmse_value: torch.Tensor) -> torch.Tensor:
    """Peak signal-to-noise ratio in dB for a peak of 1: -20 log10(RMSE) (Section 4.1)."""
    return -20 * torch.log10(rmse_value.clamp_min(1e-10))


def dice(estimate: torch.Tensor, truth: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Dice (F1) score of the lit pixels of binary maps inside the mask; 1 where neither map has any."""
    both = _masked_mean(estimate * truth, mask)
    total = _masked_mean(estimate + truth, mask)
    return torch.where(total > 0, 2 * both / total.clamp_min(1e-10), torch.ones_like(total))


def angular_error(estimate: torch.Tensor, truth: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Mean angle in degrees between unit vectors (..., 3, H, W) inside the mask."""
    sine = torch.linalg.cross(estimate, truth, dim=-3).norm(dim=-3)
    cosine = (estimate * truth).sum(dim=-3)
    return torch.rad2deg(_masked_mean(torch.atan2(sine, cosine), mask))  # atan2 is exact near 0, acos is not


def depth_error(estimate: torch.Tensor, truth: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Mean difference of depths (..., H, W) inside the mask, each relative to its own mean there, in per cent
    of the subject's height; depths are in units of this height. Lower is better."""
    estimate, truth = (depth - _masked_mean(depth, mask)[..., None, None] for depth in (estimate, truth))
    return 100 * _masked_mean((estimate - truth).abs(), mask)


def depth_order(
    estimate: torch.Tensor, truth: torch.Tensor, mask: torch.Tensor, reach: int = 4, step: float = 0.03
) -> torch.Tensor:
    """Share of pixel pairs across the borders of limbs whose nearer one is nearer in the estimate as well;
    0.5 is chance, and what a flat estimate gets; NaN where the subject has no such border.

    Pairs lie `reach` pixels apart in a row or column, both in the mask, and differ in true depth by more than
    `step` heights: 5 cm on a person, which is more than a surface slopes there. estimate, truth: (H, W).
    """
    right = total = truth.new_zeros(())
    for axis in (0, 1):
        rows = (slice(None),) * axis
        near, far = (*rows, slice(None, -reach)), (*rows, slice(reach, None))
        apart = (truth[far] - truth[near]) * (mask[near] & mask[far])
        border = apart.abs() > step
        agree = (estimate[far] - estimate[near]).sign() * apart.sign()
        right, total = right + ((1 + agree) / 2)[border].sum(), total + border.sum()
    return right / total


def ssim(estimate: torch.Tensor, truth: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Structural similarity in the mask's bounding box (Section 4.4), higher is better: the mean over the
    windows that lie in it (Wang et al. 2004: 11 x 11 Gaussian windows, sigma 1.5; values range over 1).

    estimate, truth: (..., H, W). mask: (H, W). ValueError if the box is smaller than a window.
    """
    top, left, bottom, right = bounding_box(mask)
    if min(bottom - top, right - left) < WINDOW:
        raise ValueError(f"mask: its bounding box is smaller than {WINDOW} x {WINDOW} pixels, SSIM's window")
    size = (bottom - top, right - left)
    ours, theirs = (image[..., top:bottom, left:right].reshape(-1, 1, *size) for image in (estimate, truth))
    return ssim_map(ours, theirs, WINDOW, padding="valid").mean(dim=(1, 2, 3)).view(estimate.shape[:-2])


def otsu(values: torch.Tensor) -> float:
    """Otsu's threshold of grey values of any shape, from a histogram of 256 bins: the one with the largest
    variance between the classes `<=` and `>` it (Section 4.3). Of constant values, that value."""
    low, high = float(values.min()), float(values.max())
    if low == high:
        return low
    counts = torch.histc(values.float(), 256, low, high).double()
    centres = low + (torch.arange(256, dtype=torch.float64) + 0.5) * (high - low) / 256
    below, total = counts.cumsum(0), (counts * centres).cumsum(0)
    above = below[-1] - below
    difference = total / below - (total[-1] - total) / above.clamp_min(1)
    return float(centres[(below * above * difference.square())[:-1].argmax()])
