"""What is behind people in composed pictures: photographs, and rooms that are drawn."""

from pathlib import Path

import numpy as np
import torch
from PIL import Image

from shadow.data.cutouts import LINEAR
from shadow.data.rough_masks import blurred

LONGEST = 1100  # pixels, the longer side of the photographs that are kept in memory
PHOTOGRAPHS = 0.6  # share of the backdrops that are photographs; the others are rooms
FOCUS = 0.5  # share that is in focus
BLUR = 0.002, 0.03  # standard deviation of the others, of the picture's side
MEAN = 0.2  # of the median backdrop, linear


class Backdrops:
    """The photographs (JPEG) of a folder, from which parts are taken."""

    def __init__(self, folder: str | Path) -> None:
        self.pictures = [_reduced(path) for path in sorted(Path(folder).glob("*.jpg"))]
        if not self.pictures:
            raise FileNotFoundError(f"backdrops: no photographs (.jpg) in {folder}")

    def draw(self, rng: np.random.Generator, side: int) -> torch.Tensor:
        """Return a backdrop (3, side, side), linear."""
        picture = self.part(rng, side) if rng.random() < PHOTOGRAPHS else self.room(rng, side)
        if rng.random() > FOCUS:
            picture = blurred(picture, side * np.exp(rng.uniform(*np.log(BLUR))))
        return picture * (np.exp(rng.normal(np.log(MEAN), 0.6)) / max(float(picture.mean()), 1e-3))

    def part(self, rng: np.random.Generator, side: int, least: float = 0.35) -> torch.Tensor:
        """Return a random part (3, side, side), linear, of a random photograph.

        least: side of the smallest part, of the photograph's shorter side.
        """
        codes = self.pictures[rng.integers(len(self.pictures))]
        extent = int(min(codes.shape[:2]) * rng.uniform(least, 1))
        top, left = (int(rng.integers(0, length - extent + 1)) for length in codes.shape[:2])
        image = Image.fromarray(codes[top : top + extent, left : left + extent])
        part = np.asarray(image.resize((side, side), Image.Resampling.BILINEAR))
        part = part[:, ::-1] if rng.random() < 0.5 else part
        return torch.from_numpy(LINEAR[part].transpose(2, 0, 1).copy())

    def room(self, rng: np.random.Generator, side: int) -> torch.Tensor:
        """Draw a wall (3, side, side), linear, often with a floor, and things before it."""
        wall = surface(rng, side)
        if rng.random() < 0.6:
            edge = int(side * rng.uniform(0.55, 0.98))
            slope = rng.normal(0, 0.05) if rng.random() < 0.5 else 0.0
            rows, columns = torch.meshgrid(torch.arange(side), torch.arange(side), indexing="ij")
            below = (rows > edge + slope * (columns - side / 2)).float()
            wall = torch.lerp(wall, surface(rng, side), below)
        for _ in range(rng.poisson(3.0)):
            height, width = (max(4, int(side * np.exp(rng.uniform(np.log(0.03), np.log(0.8))))) for _ in "hw")
            top, left = rng.integers(-height // 2, side - height // 2, 2)
            down = slice(max(top, 0), max(top, 0) + min(height, side - max(top, 0)))
            across = slice(max(left, 0), max(left, 0) + min(width, side - max(left, 0)))
            inside = self.part(rng, side, 0.1) if rng.random() < 0.3 else surface(rng, side)
            wall[:, down, across] = inside[:, down, across]
            if rng.random() < 0.5:  # a frame or a ledge
                thick = max(1, int(side * rng.uniform(0.003, 0.02)))
                colour = torch.from_numpy(_colour(rng))[:, None, None]
                wall[:, down, across][:, :thick] = colour
                wall[:, down, across][:, -thick:] = colour
                wall[:, down, across][:, :, :thick] = colour
        return blurred(wall, 0.6)


def _reduced(path: Path) -> np.ndarray:
    with Image.open(path) as file:
        image = file.convert("RGB")
    image.thumbnail((LONGEST, LONGEST), Image.Resampling.LANCZOS)
    return np.asarray(image)


def _colour(rng: np.random.Generator) -> np.ndarray:
    """Return a linear colour (3,): mostly greyish and light, as walls are."""
    value, tint = np.exp(rng.uniform(np.log(0.03), np.log(0.8))), np.exp(rng.normal(0, 0.25, 3))
    return (value * tint / tint.mean()).astype(np.float32)


def surface(rng: np.random.Generator, side: int) -> torch.Tensor:
    """Return a plain, shaded, striped, tiled or rough surface (3, side, side), linear."""
    rows, columns = torch.meshgrid(torch.arange(side) / side, torch.arange(side) / side, indexing="ij")
    light = 1 + rng.normal(0, 0.35) * (rows - 0.5) + rng.normal(0, 0.35) * (columns - 0.5)
    if rng.random() < 0.4:  # a lamp on the wall
        y, x = rng.uniform(-0.2, 1.2, 2)
        light = light + rng.uniform(0.2, 2) * torch.exp(-((rows - y) ** 2 + (columns - x) ** 2) / 0.1)
    shown = light.clamp_min(0.05)[None] * torch.from_numpy(_colour(rng))[:, None, None]
    kind, angle = rng.random(), rng.choice([0, np.pi / 2, rng.uniform(0, np.pi)])
    along = (rows * np.sin(angle) + columns * np.cos(angle)) * np.exp(rng.uniform(np.log(3), np.log(60)))
    across = (columns * np.sin(angle) - rows * np.cos(angle)) * np.exp(rng.uniform(np.log(3), np.log(60)))
    other = torch.from_numpy(_colour(rng))[:, None, None] * light.clamp_min(0.05)
    if kind < 0.25:  # stripes
        shown = torch.lerp(shown, other, (along % 1 < rng.uniform(0.1, 0.6)).float())
    elif kind < 0.4:  # tiles, bricks
        shifted = across + 0.5 * (along.floor() % 2)
        joint = (along % 1 < 0.08) | (shifted % 1 < 0.08)
        shown = torch.lerp(shown, other, joint.float() * rng.uniform(0.2, 1))
    if rng.random() < 0.6:  # plaster, wood, carpet
        shape = (side, side) if rng.random() < 0.5 else (max(2, side // 20), side)
        noise = torch.from_numpy(rng.standard_normal(shape).astype(np.float32))
        noise = torch.nn.functional.interpolate(noise[None, None], (side, side), mode="bilinear")[0, 0]
        shown = shown * (1 + rng.uniform(0.02, 0.3) * noise).clamp_min(0.1)
    return shown
