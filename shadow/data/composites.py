"""Pictures with a known matte: people in front of backdrops, with a rough mask of one of them.

Everything is composed in linear light, in the square around a person in which the matting network works. Some
pictures show other people before or behind the person, things that the person holds, or the person's shadow
on the wall or the floor. The camera adds blur, noise and compression. Some of the rough masks are those of a
pose network, if there is one; the others are made as wrong as they may be.
"""

import io
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from PIL import Image
from torch.utils.data import Dataset

from shadow.data import cutouts
from shadow.data.backdrops import Backdrops
from shadow.data.cutouts import Cutout
from shadow.data.rough_masks import blurred, rough_mask
from shadow.data.things import thing
from shadow.framing import affine_sample
from shadow.srgb import encode_srgb

GROUP, HOLDING, SHADOW, CLUTTER = 0.35, 0.35, 0.4, 0.4  # shares of the pictures with each
POSED = 0.6  # share of the rough masks that are a pose network's
EXTENT = 0.5, 1.4  # of the person, of the picture's side; a picture is a part of a larger one from 1 on


PoseMask = Callable[[torch.Tensor, torch.Tensor], torch.Tensor | None]


class Composite(NamedTuple):
    """A picture and its truth; all are (C, S, S) float32."""

    rgb: torch.Tensor  # (3, S, S) sRGB-encoded in [0, 1], in steps of 1/255
    mask: torch.Tensor  # (1, S, S) rough, in [0, 1]
    alpha: torch.Tensor  # (1, S, S) in [0, 1]
    contrast: torch.Tensor  # (1, S, S) difference of the person's own colour and what is behind, linear
    valid: torch.Tensor  # (1, S, S) 1 within the photograph, 0 beyond its frame


class Composites(Dataset):
    """Pictures from number `start` on, of the cutouts in folders before backdrops.

    `pose_mask` sees a picture and the matte of whom it should look for, and returns their mask (S, S), or
    None where it does not see them.
    """

    def __init__(
        self,
        folders: list[Path],
        backdrops: Backdrops,
        seed: int,
        side: int,
        start: int,
        count: int,
        pose_mask: PoseMask | None = None,
    ) -> None:
        self.paths = sorted(path for folder in folders for path in folder.glob("[!.]*.png"))
        if not self.paths:
            raise FileNotFoundError(f"cutouts: none (.png) in {', '.join(map(str, folders))}")
        self.backdrops, self.seed, self.side, self.start, self.count = backdrops, seed, side, start, count
        self.pose_mask = pose_mask

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> Composite:
        epoch, position = divmod(self.start + index, len(self.paths))
        order = np.random.default_rng((self.seed, epoch)).permutation(len(self.paths))
        rng = np.random.default_rng((self.seed, epoch, position))
        return self.compose(self.paths[order[position]], rng)

    def compose(self, path: Path, rng: np.random.Generator) -> Composite:
        """Compose a random picture of the person of a file."""
        side = self.side
        behind = self.backdrops.draw(rng, side)
        frame = Frame(*framed(rng, cutouts.read(path), side))
        person, hands = frame.placed(rng, frame.person)
        for _ in range(rng.poisson(1.5) if rng.random() < CLUTTER else 0):
            x, y = rng.uniform(0, side, 2)
            behind = over(thing(rng, side, x, y, side * rng.uniform(0.02, 0.12), self.backdrops), behind)
        if rng.random() < SHADOW:
            behind = behind * _shadow(rng, person[3:])
        others, before = self._others(rng, frame, person)
        behind = over(others, behind)
        bare = person[3]
        if hands and rng.random() < HOLDING:
            held = thing(rng, side, *hands[rng.integers(len(hands))], self.backdrops)
            person = over(held, person) if rng.random() < 0.4 else over(person, held)
            bare = bare if rng.random() < 0.8 else person[3]
        if before is not None:
            person, bare = person * (1 - before[3:]), bare * (1 - before[3])
        person = _spill(rng, person, behind)
        sigma = rng.uniform(0, 1.0) * side / 512 if rng.random() < 0.8 else rng.uniform(1, 3) * side / 512
        person = blurred(person, sigma)
        picture = over(person, behind)
        if before is not None:
            picture = over(blurred(before, sigma), picture)
        neighbours = others[3] if before is None else torch.maximum(others[3], before[3])
        mask = rough_mask(bare, rng, neighbours if neighbours.any() else None)
        rgb = frame.filled(_camera(rng, picture))
        if self.pose_mask is not None and rng.random() < POSED:
            posed = self.pose_mask(rgb, bare)
            mask = mask if posed is None else posed
        valid = frame.valid()
        contrast = (person[:3] / person[3:].clamp_min(1e-2) - behind).abs().mean(dim=0, keepdim=True)
        return Composite(rgb, mask[None] * valid, person[3:].clamp(0, 1), contrast.clamp(0, 1), valid)

    def _others(
        self, rng: np.random.Generator, frame: "Frame", person: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Return the people (4, S, S) behind the person, and somebody before them or None."""
        others, before = torch.zeros_like(person), None
        if rng.random() > GROUP:
            return others, None
        for _ in range(1 if rng.random() < 0.7 else 2):
            path = self.paths[rng.integers(len(self.paths))]
            other, _ = frame.placed(rng, cutouts.read(path), aside=True)
            shared = float((other[3] * person[3]).sum() / person[3].sum().clamp_min(1))
            if before is None and shared < 0.3 and rng.random() < 0.3:
                before = other
            else:
                others = over(other, others)
        return others, before


class Frame(NamedTuple):
    """The photograph's frame within the square of `side` pixels, and the person in it.

    Where the square reaches beyond the photograph, as it does around people whom the frame cuts, the
    photograph's outermost pixels are repeated.
    """

    side: int
    top: int
    bottom: int
    left: int
    right: int
    person: Cutout

    def placed(
        self, rng: np.random.Generator, who: Cutout, aside: bool = False
    ) -> tuple[torch.Tensor, list[tuple[float, float, float]]]:
        """Return somebody in the square (4, S, S), premultiplied and linear, and where their hands are."""
        rows, columns = np.nonzero(who.alpha > 127)
        if not len(rows):
            return torch.zeros(4, self.side, self.side), []
        low, high = np.array([columns.min(), rows.min()]), np.array([columns.max() + 1, rows.max() + 1])
        extent = np.exp(rng.uniform(*np.log(EXTENT)))
        scale = self.side * extent / max(high - low)
        cut_top, cut_bottom, cut_left, cut_right = who.frame
        size = (high - low) * scale
        spread = (0.04 + max(0.0, extent - 0.9) / 2) * self.side
        x = rng.normal((self.left + self.right - size[0]) / 2, spread)
        y = rng.normal((self.top + self.bottom - size[1]) / 2, spread)
        if aside:
            x += rng.choice([-1, 1]) * rng.uniform(0.3, 0.8) * self.side
        # Where the frame cut somebody it does so again, or cuts more of them.
        y = self.bottom - size[1] + rng.uniform(0, 0.03) * self.side if cut_bottom else y
        y = self.top if cut_top and not cut_bottom else y
        flip = rng.random() < 0.5
        cut_left, cut_right = (cut_right, cut_left) if flip else (cut_left, cut_right)
        if not aside:
            x = self.left if cut_left else self.right - size[0] if cut_right else x
        elif cut_left or cut_right:
            x = self.left if cut_left and not cut_right else self.right - size[0]
        width, height = np.maximum(1, np.round(size)).astype(int).tolist()
        image = Image.fromarray(np.dstack([who.colour, who.alpha])[low[1] : high[1], low[0] : high[0]])
        part = np.asarray(image.resize((width, height), Image.Resampling.BILINEAR))
        layer = Cutout(part[..., :3], part[..., 3], []).linear
        hands = [((hx - low[0]) * scale, (hy - low[1]) * scale, r * scale) for hx, hy, r in who.hands]
        if flip:
            layer, hands = layer.flip(2), [(width - hx, hy, r) for hx, hy, r in hands]
        hands = [(hx + round(x), hy + round(y), r) for hx, hy, r in hands]
        inside = [hand for hand in hands if 0 < hand[0] < self.side and 0 < hand[1] < self.side]
        return _pasted(layer, round(x), round(y), self.side) * self.valid(), inside

    def valid(self) -> torch.Tensor:
        """Return (1, S, S), 1 within the photograph."""
        inside = torch.zeros(1, self.side, self.side)
        inside[:, self.top : self.bottom, self.left : self.right] = 1
        return inside

    def filled(self, picture: torch.Tensor) -> torch.Tensor:
        """Repeat a picture's outermost pixels beyond the frame."""
        rows = torch.arange(self.side).clamp(self.top, self.bottom - 1)
        columns = torch.arange(self.side).clamp(self.left, self.right - 1)
        return picture[:, rows][:, :, columns]


def framed(rng: np.random.Generator, person: Cutout, side: int) -> tuple[int, int, int, int, int, Cutout]:
    beyond = (rng.random(4) < 0.15) | np.array(person.frame)
    top, bottom, left, right = (beyond * rng.uniform(0, 0.22, 4) * side).astype(int).tolist()
    return side, top, side - bottom, left, side - right, person


def _pasted(layer: torch.Tensor, x: int, y: int, side: int) -> torch.Tensor:
    """Return a square (C, side, side), zero but for a layer (C, h, w) whose corner is at (x, y)."""
    canvas = layer.new_zeros(len(layer), side, side)
    top, left = max(0, -y), max(0, -x)
    part = layer[:, top : max(0, side - y), left : max(0, side - x)]
    canvas[:, y + top : y + top + part.shape[1], x + left : x + left + part.shape[2]] = part
    return canvas


def over(front: torch.Tensor, behind: torch.Tensor) -> torch.Tensor:
    """Put a premultiplied layer (4, H, W) over a picture (3, H, W) or a layer (4, H, W)."""
    return front[: len(behind)] + (1 - front[3:]) * behind


def _shadow(rng: np.random.Generator, alpha: torch.Tensor) -> torch.Tensor:
    """Return the factor (1, S, S) of a person's shadow on the wall, or on the floor."""
    side = alpha.shape[1]
    if rng.random() < 0.6:  # the wall
        grown, shear, squash = rng.uniform(0.95, 1.25), rng.normal(0, 0.1), 1.0
        moved = rng.normal(0, 0.08, 2) * side
    else:
        grown, shear, squash = 1.0, rng.normal(0, 0.8), rng.uniform(2, 6)
        moved = np.array([rng.normal(0, 0.02) * side, 0.0])
    rows = torch.nonzero(alpha[0].amax(dim=1) > 0.5)
    feet = float(rows.max()) if len(rows) else side
    matrix = [
        [1 / grown, shear, side / 2 * (1 - 1 / grown) - shear * feet - moved[0]],
        [0, squash / grown, feet * (1 - squash / grown) - moved[1]],
    ]
    cast = affine_sample(alpha, torch.tensor(matrix).float(), (side, side))
    return 1 - rng.uniform(0.15, 0.85) * blurred(
        cast, side * np.exp(rng.uniform(np.log(0.004), np.log(0.06)))
    )


def _spill(rng: np.random.Generator, person: torch.Tensor, behind: torch.Tensor) -> torch.Tensor:
    """Add the backdrop's light to the person's edge, and its colour to all of them."""
    if rng.random() < 0.5:
        return person
    alpha, side = person[3:], person.shape[1]
    around = blurred((1 - alpha) * behind, side * rng.uniform(0.005, 0.03))
    tint = behind.mean(dim=(1, 2), keepdim=True)
    tint = (tint / tint.mean().clamp_min(1e-3)) ** rng.uniform(0, 0.6)
    return torch.cat([person[:3] * tint + rng.uniform(0, 0.4) * around * alpha, alpha])


def _camera(rng: np.random.Generator, picture: torch.Tensor) -> torch.Tensor:
    """Return a linear picture (3, S, S) as a camera writes it: sRGB-encoded in [0, 1]."""
    tint = np.exp(rng.normal(0, 0.08, 3)) * np.exp(rng.normal(0.1, 0.35))
    picture = picture * torch.from_numpy(np.float32(tint))[:, None, None]
    if rng.random() < 0.6:
        noise = torch.from_numpy(rng.standard_normal(picture.shape, np.float32))
        noise = blurred(noise, 0.7) * 2 if rng.random() < 0.5 else noise
        shot, read = np.exp(rng.uniform(np.log([1e-4, 1e-4]), np.log([3e-2, 6e-3])))
        picture = picture + noise * (shot**2 * picture.clamp_min(0) + read**2).sqrt()
    encoded = encode_srgb(picture.clamp(0, 1).permute(1, 2, 0).numpy())
    if rng.random() < 0.3:  # a tone curve
        steepness = rng.uniform(2, 6)
        low, high = (1 / (1 + np.exp(-steepness * (end - 0.5))) for end in (0, 1))
        encoded = (1 / (1 + np.exp(-steepness * (encoded - 0.5))) - low) / (high - low)
    codes = np.round(encoded.clip(0, 1) * 255).astype(np.uint8)
    if rng.random() < 0.6:
        file = io.BytesIO()
        Image.fromarray(codes).save(file, "JPEG", quality=int(rng.uniform(40, 96)))
        codes = np.asarray(Image.open(file))
    return torch.from_numpy(codes.transpose(2, 0, 1).astype(np.float32) / 255)
