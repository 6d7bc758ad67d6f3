"""Weights of the pixels in the losses, as the recipe sets them."""

from collections.abc import Mapping

import torch
import torch.nn.functional as F

from shadow.training.recipes import Recipe

BORDER_PIXELS = 3  # canvas pixels on either side of the border of a cast shadow that count as near it


def attention(batch: Mapping[str, torch.Tensor], recipe: Recipe) -> torch.Tensor:
    """Return the weight (B, 1, H, W) of each pixel in the losses.

    It is 1 inside the mask and 0 outside. It is higher near borders of cast shadow under any of the batch's
    lights, and on faces and hands.
    """
    weight = torch.ones_like(batch["mask"])
    if recipe.borders != 1:
        weight = weight + (recipe.borders - 1) * near_borders(batch)
    if recipe.faces != 1:
        weight = weight + (recipe.faces - 1) * batch["regions"].sum(dim=1, keepdim=True).clamp(0, 1)
    return weight * (batch["mask"] > 0.5)


def near_borders(batch: Mapping[str, torch.Tensor]) -> torch.Tensor:
    """Return the fraction (B, 1, H, W) of the lights for which a pixel is near the border of a cast shadow.

    Such a border lies between two neighbouring pixels that face the light and of which only one is lit.
    """
    facing = torch.einsum("bdc,bchw->bdhw", batch["directions"], batch["normals"]) > 0.05
    facing = facing & (batch["mask"] > 0.5)
    lit, dark = ((facing & side).float() for side in (batch["visibility"] > 0.5, batch["visibility"] <= 0.5))
    window = 2 * BORDER_PIXELS + 1
    both = F.max_pool2d(lit, window, 1, BORDER_PIXELS) * F.max_pool2d(dark, window, 1, BORDER_PIXELS)
    return both.mean(dim=1, keepdim=True)
