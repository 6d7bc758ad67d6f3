"""Simple things that people hold: cups, bags, sticks, balls and sheets, drawn in two dimensions."""

import numpy as np
import torch

from shadow.data.backdrops import Backdrops, surface
from shadow.data.rough_masks import blurred


def thing(
    rng: np.random.Generator, side: int, x: float, y: float, radius: float, backdrops: Backdrops
) -> torch.Tensor:
    """Return a thing (4, side, side), premultiplied and linear, in a hand at (x, y).

    radius: of the hand; all are in pixels.
    """
    rows, columns = torch.meshgrid(torch.arange(side) + 0.5, torch.arange(side) + 0.5, indexing="ij")
    kind = rng.choice(["cup", "bag", "stick", "ball", "sheet"])
    angle = rng.normal(0, 0.3) if kind in ("cup", "bag") else rng.uniform(0, np.pi)
    across = ((columns - x) * np.cos(angle) + (rows - y) * np.sin(angle)) / radius
    down = ((rows - y) * np.cos(angle) - (columns - x) * np.sin(angle)) / radius
    soft = lambda inside: (inside * radius).sigmoid()  # noqa: E731 - the edge is about a pixel wide
    if kind == "cup":
        width, height = rng.uniform(0.6, 1.1), rng.uniform(0.8, 2.0)
        narrow = width * (1 - rng.uniform(0, 0.2) * down / height)
        shape = soft(torch.minimum(narrow - across.abs(), height - (down + height / 2).abs()))
        shade = 1 - 0.5 * (across / width).clamp(-1, 1).abs() ** 2
    elif kind == "bag":
        width, height, hang = rng.uniform(1.2, 3.5), rng.uniform(1.2, 3.0), rng.uniform(0.5, 4)
        body = torch.minimum(width - across.abs(), height - (down - hang - height).abs())
        half = width * (down / hang).clamp(0, 1)
        strap = torch.minimum(0.15 - ((across.abs() - half * 0.6).abs()), hang / 2 - (down - hang / 2).abs())
        shape = soft(torch.maximum(body, strap))
        shade = 1 + 0.15 * across / width
    elif kind == "stick":
        width, before, behind = rng.uniform(0.06, 0.4), rng.uniform(1, 12), rng.uniform(0.5, 8)
        along = torch.minimum(down + before, behind - down)
        shape, shade = (
            soft(torch.minimum(width - across.abs(), along)),
            1 - 0.4 * (across / width).clamp(-1, 1),
        )
    elif kind == "ball":
        size = rng.uniform(0.7, 3)
        away = (across**2 + (down + size) ** 2).sqrt()
        shape, shade = soft(size - away), 1 - 0.4 * (away / size).clamp(0, 1) ** 2
    else:
        width, height = rng.uniform(0.5, 3), rng.uniform(0.8, 4)
        shape = soft(torch.minimum(width - across.abs(), height - (down + rng.uniform(0, height)).abs()))
        shade = torch.ones_like(shape)
    texture = backdrops.part(rng, side, 0.1) if rng.random() < 0.3 else surface(rng, side)
    colour = (
        texture * (np.exp(rng.uniform(np.log(0.03), np.log(0.5))) / texture.mean().clamp_min(1e-3)) * shade
    )
    return blurred(torch.cat([colour * shape, shape[None]]), 0.5)
