"""Light that enters skin and leaves it beside: the edges of shadows on skin are red."""

import numpy as np
import torch
from kornia.filters import gaussian_blur2d

from shadow.data.records import Record

# How far light of linear red, green and blue gets, metres: 1 / σtr of the skin measured by Jensen et al., "A
# Practical Model for Subsurface Light Transport" (SIGGRAPH 2001), table 1, "Skin1".
REACH = (3.7e-3, 1.4e-3, 0.7e-3)
FEWEST = 0.25  # standard deviation in pixels below which a blur is not seen


def scattered(record: Record, irradiance: torch.Tensor) -> torch.Tensor:
    """Irradiance (N, 3), linear Rec.709, of the record's pixels as it leaves their surface again: on skin, as
    far as the record knows where that is, each channel blurred over the skin around it.

    A dipole's profile, exp(-r / reach) / r, has the variance of a Gaussian whose standard deviation is the
    reach. Skin at the same place in the picture is taken for near in space. Records that do not say what
    their pixels are of, or how large, stay as they are.
    """
    skin, camera = np.any(record.shares, axis=1), record.about.get("camera")
    if camera is None or not skin.any():
        return irradiance
    pixels = camera["focal"] / record.about["view"]["distance"]  # a metre
    shares = record.image(skin[:, None].astype("float32"))[None]
    spread = irradiance.clone()
    for channel, reach in enumerate(REACH):
        deviation = reach * pixels
        if deviation < FEWEST:
            continue
        image = record.image(irradiance[:, channel : channel + 1].numpy())[None] * shares
        blurred = _blurred(image, deviation) / _blurred(shares, deviation).clamp_min(1e-6)
        spread[:, channel] = torch.where(
            torch.from_numpy(skin), blurred[0, 0, torch.from_numpy(record.mask)], irradiance[:, channel]
        )
    return spread


def _blurred(image: torch.Tensor, deviation: float) -> torch.Tensor:
    side = 2 * round(3 * deviation + 1) + 1
    return gaussian_blur2d(image, (side, side), (deviation, deviation), border_type="constant")
