"""The paper's metrics (Sections 4.1 and 4.4) and our own, as pure functions of maps and a mask.

Maps are (..., H, W), the mask is (H, W) bool or broadcastable, results are (...). All but SSIM use the pixels
in the mask only (Section 4.1).
"""

import torch

from shadow.framing import bounding_box

WINDOW = 11  # pixels of SSIM's Gaussian window, sigma 1.5
PAIR_DISTANCE = 4  # pixels between the two pixels whose depth order is compared
BORDER_STEP = 0.03  # heights: least difference of depth across the border of a limb, 5 cm on a person


def _masked_mean(values: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    weight = mask.to(values)
    return (values * weight).sum(dim=(-2, -1)) / weight.expand_as(values).sum(dim=(-2, -1)).clamp_min(1)


def rmse(estimate: torch.Tensor, truth: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return the root mean square error inside the mask; lower is better."""
    return _masked_mean((estimate - truth).square(), mask).sqrt()


def psnr(rmse_value: torch.Tensor) -> torch.Tensor:
    """Return the peak signal-to-noise ratio in dB for a peak of 1: -20 log10(RMSE) (Section 4.1)."""
    return -20 * torch.log10(rmse_value.clamp_min(1e-10))


def dice(estimate: torch.Tensor, truth: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return the Dice (F1) score of the lit pixels of binary maps inside the mask; 1 if both have none."""
    both = _masked_mean(estimate * truth, mask)
    total = _masked_mean(estimate + truth, mask)
    return torch.where(total > 0, 2 * both / total.clamp_min(1e-10), torch.ones_like(total))


def angular_error(estimate: torch.Tensor, truth: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return the mean angle in degrees between unit vectors (..., 3, H, W) inside the mask."""
    sine = torch.linalg.cross(estimate, truth, dim=-3).norm(dim=-3)
    cosine = (estimate * truth).sum(dim=-3)
    return torch.rad2deg(_masked_mean(torch.atan2(sine, cosine), mask))  # atan2 is exact near 0, acos is not


def depth_error(estimate: torch.Tensor, truth: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return the mean absolute difference of depths (..., H, W) in per cent of the subject's height.

    Depths are in units of this height, and relative to their own means in the mask. Lower is better.
    """
    estimate, truth = (depth - _masked_mean(depth, mask)[..., None, None] for depth in (estimate, truth))
    return 100 * _masked_mean((estimate - truth).abs(), mask)


def depth_order(estimate: torch.Tensor, truth: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return the fraction of pixel pairs across limb borders whose depth order in the estimate is correct.

    Chance and a flat estimate give 0.5. The result is NaN if the subject has no such border. The pixels of a
    pair are PAIR_DISTANCE pixels apart in a row or column, both in the mask. Their true depths differ by more
    than BORDER_STEP heights, which is more than a slope reaches over this distance. estimate, truth: (H, W).
    """
    right = total = truth.new_zeros(())
    for axis in (0, 1):
        rows = (slice(None),) * axis
        near, far = (*rows, slice(None, -PAIR_DISTANCE)), (*rows, slice(PAIR_DISTANCE, None))
        apart = (truth[far] - truth[near]) * (mask[near] & mask[far])
        border = apart.abs() > BORDER_STEP
        agree = (estimate[far] - estimate[near]).sign() * apart.sign()
        right, total = right + ((1 + agree) / 2)[border].sum(), total + border.sum()
    return right / total


def ssim(estimate: torch.Tensor, truth: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return the structural similarity in the mask's bounding box (Section 4.4); higher is better.

    It is the mean over all windows inside the box (Wang et al. 2004: 11 x 11 Gaussian windows, sigma 1.5, a
    value range of 1). estimate, truth: (..., H, W). mask: (H, W). Raises ValueError if the box is smaller
    than a window.
    """
    from kornia.metrics import ssim as ssim_map

    top, left, bottom, right = bounding_box(mask)
    if min(bottom - top, right - left) < WINDOW:
        raise ValueError(f"mask: its bounding box is smaller than {WINDOW} x {WINDOW} pixels, SSIM's window")
    size = (bottom - top, right - left)
    ours, theirs = (image[..., top:bottom, left:right].reshape(-1, 1, *size) for image in (estimate, truth))
    return ssim_map(ours, theirs, WINDOW, padding="valid").mean(dim=(1, 2, 3)).view(estimate.shape[:-2])


def otsu(values: torch.Tensor) -> float:
    """Return Otsu's threshold of grey values of any shape (Section 4.3).

    It maximises the variance between the classes `<=` and `>` the threshold, on a histogram of 256 bins. For
    constant values it is their value.
    """
    low, high = float(values.min()), float(values.max())
    if low == high:
        return low
    counts = torch.histc(values.float(), 256, low, high).double()
    centres = low + (torch.arange(256, dtype=torch.float64) + 0.5) * (high - low) / 256
    below, total = counts.cumsum(0), (counts * centres).cumsum(0)
    above = below[-1] - below
    difference = total / below - (total[-1] - total) / above.clamp_min(1)
    return float(centres[(below * above * difference.square())[:-1].argmax()])
