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

    Irradiance of records without regions or without a scale is returned unchanged; see `scatter_images`.
    """
    skin, scale = np.any(record.shares, axis=1, keepdims=True), pixels_per_metre(record)
    if not scale or not skin.any():
        return irradiance
    image, skin_image = (record.image(values)[None] for values in (irradiance.numpy(), skin))
    spread = scatter_images(image, skin_image > 0, torch.tensor([scale]))
    return spread[0][:, torch.from_numpy(record.mask)].T


def scatter_images(light: torch.Tensor, skin: torch.Tensor, scales: torch.Tensor) -> torch.Tensor:
    """Blur the light (B, 3, H, W) on skin (B, 1, H, W) by subsurface scattering.

    Each channel is blurred by its own radius, over skin only. A dipole's profile, exp(-r / radius) / r, has
    the variance of a Gaussian whose standard deviation is the radius. Skin pixels that are close in the
    picture are assumed to be close in space. scales (B,): pixels for each metre, 0 if unknown.
    """
    shares, spread = skin.float(), light.clone()
    for channel, radius in enumerate(SCATTERING_RADII):
        deviations, image = radius * scales, light[:, channel : channel + 1]
        if deviations.max() < MIN_SIGMA_PIXELS:
            continue
        blurred = _blurred(image * shares, deviations) / _blurred(shares, deviations).clamp_min(1e-6)
        visible = skin & (deviations >= MIN_SIGMA_PIXELS).view(-1, 1, 1, 1)
        spread[:, channel : channel + 1] = torch.where(visible, blurred, image)
    return spread


def _blurred(images: torch.Tensor, deviations: torch.Tensor) -> torch.Tensor:
    """Blur each of the images (B, 1, H, W) by a Gaussian of its own deviation (B,) in pixels."""
    from kornia.filters import gaussian_blur2d

    side = 2 * round(3 * float(deviations.max()) + 1) + 1
    sigmas = deviations.clamp_min(MIN_SIGMA_PIXELS)[:, None].expand(-1, 2)
    return gaussian_blur2d(images, (side, side), sigmas, border_type="constant")


def pixels_per_metre(record: Record) -> float:
    """Return the scale of the record's picture, or 0 if it is unknown."""
    camera = record.about.get("camera")
    return 0.0 if camera is None else float(camera["focal"] / record.about["view"]["distance"])
