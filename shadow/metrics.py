"""The paper's metrics: pure functions of maps and a mask.

Maps are (..., H, W), the mask (H, W) bool or broadcastable; results are (...). All but SSIM look at the
masked pixels only (Section 4.1).
"""

import torch


def _masked_mean(values, mask):
    weight = mask.to(values)
    return (values * weight).sum(dim=(-2, -1)) / weight.expand_as(values).sum(dim=(-2, -1)).clamp_min(1)


def rmse(estimate, truth, mask):
    """Root mean square error inside the mask, lower is better."""
    return _masked_mean((estimate - truth).square(), mask).sqrt()


def psnr(rmse_value):
    """Peak signal-to-noise ratio in dB for a peak of 1: -20 log10(RMSE) (Section 4.1)."""
    return -20 * torch.log10(rmse_value.clamp_min(1e-10))


def dice(estimate, truth, mask):
    """Dice (F1) score of the lit pixels of binary maps inside the mask; 1 where neither map has any."""
    both = _masked_mean(estimate * truth, mask)
    total = _masked_mean(estimate + truth, mask)
    return torch.where(total > 0, 2 * both / total.clamp_min(1e-10), torch.ones_like(total))


def angular_error(estimate, truth, mask):
    """Mean angle in degrees between unit vectors (..., 3, H, W) inside the mask."""
    sine = torch.linalg.cross(estimate, truth, dim=-3).norm(dim=-3)
    cosine = (estimate * truth).sum(dim=-3)
    return torch.rad2deg(_masked_mean(torch.atan2(sine, cosine), mask))  # atan2 is exact near 0, acos is not
