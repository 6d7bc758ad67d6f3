"""Where the losses look: how often at each pixel, as the recipe has it."""

from collections.abc import Mapping

import torch
import torch.nn.functional as F

from shadow.training.recipes import Recipe

REACH = 3  # canvas pixels on either side of a border of cast shadow that are near it


def attention(batch: Mapping[str, torch.Tensor], recipe: Recipe) -> torch.Tensor:
    """How often (B, 1, H, W) the losses look at each pixel, as a multiple: 1 inside the mask, more near
    borders of cast shadow, under any of the batch's lights, and on faces and hands; 0 outside."""
    weight = torch.ones_like(batch["mask"])
    if recipe.borders != 1:
        weight = weight + (recipe.borders - 1) * near_borders(batch)
    if recipe.faces != 1:
        weight = weight + (recipe.faces - 1) * batch["regions"].sum(dim=1, keepdim=True).clamp(0, 1)
    return weight * (batch["mask"] > 0.5)


def near_borders(batch: Mapping[str, torch.Tensor]) -> torch.Tensor:
    """The share (B, 1, H, W) of the lights under which a border of cast shadow is near a pixel: where of two
    surfaces that face the light side by side one is lit and the other is not."""
    facing = torch.einsum("bdc,bchw->bdhw", batch["directions"], batch["normals"]) > 0.05
    facing = facing & (batch["mask"] > 0.5)
    lit, dark = ((facing & side).float() for side in (batch["visibility"] > 0.5, batch["visibility"] <= 0.5))
    window = 2 * REACH + 1
    both = F.max_pool2d(lit, window, 1, REACH) * F.max_pool2d(dark, window, 1, REACH)
    return both.mean(dim=1, keepdim=True)
