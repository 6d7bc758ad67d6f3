"""Subsurface scattering of skin, which reddens the edges of shadows on it."""

import numpy as np
import torch

from shadow.data.records import Record

# Mean scattering distance of red, green and blue light in skin, in metres: 1 / σtr from Jensen et al., "A
# Practical Model for Subsurface Light Transport" (SIGGRAPH 2001), table 1, "Skin1".
SCATTERING_RADII = (3.7e-3, 1.4e-3, 0.7e-3)
MIN_SIGMA_PIXELS = 0.25  # standard deviation below which a blur is invisible


def scatter(record: Record, irradiance: torch.Tensor) -> torch.Tensor:
    """Blur the irradiance (N, 3), linear Rec.709, of the record's skin pixels by subsurface scattering.

    Each channel is blurred by its own radius, over skin only. A dipole's profile, exp(-r / radius) / r, has
    the variance of a Gaussian whose standard deviation is the radius. Skin pixels that are close in the
    picture are assumed to be close in space. Irradiance of records without regions or without a scale is
    returned unchanged.
    """
    skin, camera = np.any(record.shares, axis=1), record.about.get("camera")
    if camera is None or not skin.any():
        return irradiance
    pixels = camera["focal"] / record.about["view"]["distance"]  # for each metre
    shares = record.image(skin[:, None].astype("float32"))[None]
    spread = irradiance.clone()
    for channel, radius in enumerate(SCATTERING_RADII):
        deviation = radius * pixels
        if deviation < MIN_SIGMA_PIXELS:
            continue
        image = record.image(irradiance[:, channel : channel + 1].numpy())[None] * shares
        blurred = _blurred(image, deviation) / _blurred(shares, deviation).clamp_min(1e-6)
        spread[:, channel] = torch.where(
            torch.from_numpy(skin), blurred[0, 0, torch.from_numpy(record.mask)], irradiance[:, channel]
        )
    return spread


def _blurred(image: torch.Tensor, deviation: float) -> torch.Tensor:
    from kornia.filters import gaussian_blur2d

    side = 2 * round(3 * deviation + 1) + 1
    return gaussian_blur2d(image, (side, side), (deviation, deviation), border_type="constant")
