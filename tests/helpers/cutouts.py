"""People with alpha and backdrops, as small as tests need them."""

import numpy as np
from PIL import Image

from shadow.data import cutouts


def disc(colour=(200, 120, 40), side=64, radius=20, hands=()):
    """A disc of one colour in the middle of a square; its edge is a pixel wide."""
    rows, columns = np.mgrid[:side, :side] + 0.5 - side / 2
    alpha = np.clip(radius + 0.5 - np.hypot(rows, columns), 0, 1)
    return cutouts.Cutout(
        np.full((side, side, 3), colour, np.uint8), np.round(alpha * 255).astype(np.uint8), list(hands)
    )


def write_sources(folder, count=3):
    """Write cutouts and backdrops; return their folders."""
    people, behind = folder / "cutouts", folder / "backdrops"
    people.mkdir()
    behind.mkdir()
    for number in range(count):
        cutouts.write(people / f"{number}.png", disc(radius=16 + 4 * number, hands=[(32.0, 20.0, 4.0)]))
        noise = np.random.default_rng(number).integers(0, 255, (6, 8, 3), np.uint8)
        Image.fromarray(noise).resize((160, 120)).save(behind / f"{number}.jpg")
    return people, behind
