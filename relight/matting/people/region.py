"""A person in a picture, as the landmark network sees them: the circle around them, and the square in it.

The square is turned so that the person is upright. What is sampled from it, and the mask that comes back,
are those of `relight.matting.people.finder`.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
import torch.nn.functional as F

from relight.media.resampling import resize, size_within
from shadow.framing import affine_sample

LANDMARK_SIDE = 256  # pixels of the landmark network's square input
REDUCED_SIDE = 1024  # pixels, the longer side of the copy on which the detector runs
ROOM = 1.25  # side of the square that the landmark network sees, in diameters of the circle
PART = 0.6  # of a person's radius: a smaller circle whose middle is on them is around a part of them


@dataclass(frozen=True)
class Circle:
    """The circle around a person: `centre` (x, y) and `radius` in pixels, and the unit vector `up` (x, y)."""

    centre: np.ndarray
    radius: float
    up: np.ndarray

    @classmethod
    def of(cls, hips: np.ndarray, rim: np.ndarray) -> "Circle":
        """Return the circle around the hips (x, y) whose upper end is at `rim` (x, y)."""
        radius = max(float(np.hypot(*(rim - hips))), 1e-3)
        return cls(np.asarray(hips, float), radius, (rim - hips) / radius)

    def square(self, side: int) -> np.ndarray:
        """Return the matrix (2, 3) from a canvas of `side` pixels, on which the person is upright."""
        step = 2 * ROOM * self.radius / side
        x, y = self.up
        turn = step * np.array([[-y, -x], [x, -y]])
        return np.concatenate([turn, (self.centre - turn @ [side / 2, side / 2])[:, None]], axis=1)

    def of_size(self, share: float) -> "Circle":
        """Return a circle around the same place, `share` times as large."""
        return replace(self, radius=self.radius * share)

    def reduced(self, scale: np.ndarray) -> "Circle":
        """Return the circle on a copy of the picture, from which `scale` (x, y) leads to the picture."""
        return Circle(self.centre / scale, self.radius / float(scale.mean()), self.up)

    def distance(self, other: "Circle") -> float:
        """Return how unlike another circle is, in place and in size: 0 for the same."""
        moved = float(np.hypot(*(self.centre - other.centre))) / other.radius
        return moved + abs(float(np.log(self.radius / other.radius)))


@dataclass(frozen=True)
class DetectedPerson:
    """Somebody in a picture: their circle, and their mask (256, 256) in [0, 1] in the square around it.

    presence: the landmark network's opinion, in [0, 1], that somebody is there, a mean of its last views;
    landmarks: where it sees the joints, (N, 2) as (x, y) in the picture; rivals: the mask of the people
    beside them, in the same square, or None.
    """

    circle: Circle
    mask: np.ndarray
    presence: float = 1.0
    landmarks: np.ndarray | None = None
    rivals: np.ndarray | None = None

    @property
    def certainty(self) -> float:
        """The presence, and less for who is not upright, as what only resembles somebody seldom is."""
        return self.presence * ((1.5 - float(self.circle.up[1])) / 2.5) ** 2

    @property
    def area(self) -> float:
        """Pixels of the picture that the mask covers."""
        return float(self.mask.mean()) * (2 * ROOM * self.circle.radius) ** 2

    def has_part(self, circle: Circle) -> bool:
        """Return whether a smaller circle is around a part of this person, such as an arm."""
        square = self.circle.square(len(self.mask))
        column, row = np.floor(np.linalg.solve(square[:, :2], circle.centre - square[:, 2])).astype(int)
        inside = 0 <= row < len(self.mask) and 0 <= column < len(self.mask)
        return inside and circle.radius < PART * self.circle.radius and bool(self.mask[row, column] > 0.5)

    def within(self, corner: Sequence[float], scale: float) -> "DetectedPerson":
        """Return the person in a crop of the picture that begins at `corner` (top, left) and is scaled."""
        centre = (self.circle.centre - [corner[1], corner[0]]) * scale
        return replace(
            self, circle=Circle(centre, self.circle.radius * scale, self.circle.up), landmarks=None
        )

    def on(self, size: tuple[int, int]) -> np.ndarray:
        """Return the mask on the picture: (H, W) float32 in [0, 1]."""
        return _placed(self.mask, self.circle, size)

    def rivals_on(self, size: tuple[int, int]) -> np.ndarray:
        """Return the mask of the people beside them on the picture: (H, W) float32 in [0, 1]."""
        return np.zeros(size, np.float32) if self.rivals is None else _placed(self.rivals, self.circle, size)


def _placed(mask: np.ndarray, circle: Circle, size: tuple[int, int]) -> np.ndarray:
    """Return a mask in the square around a circle on the picture: (H, W) float32 in [0, 1]."""
    side = len(mask)
    square = circle.square(side)
    corners = square @ np.array([[0, side, 0, side], [0, 0, side, side], [1, 1, 1, 1]])
    limits = np.array([size[1], size[0]])
    left, top = np.floor(corners.min(axis=1)).clip(0, limits).astype(int)
    right, bottom = np.ceil(corners.max(axis=1)).clip(0, limits).astype(int)
    found = np.zeros(size, np.float32)
    if right > left and bottom > top:
        turn = np.linalg.inv(square[:, :2])
        offset = turn @ (np.array([left, top]) - square[:, 2])
        matrix = torch.tensor(np.concatenate([turn, offset[:, None]], axis=1), dtype=torch.float32)
        part = affine_sample(torch.from_numpy(mask)[None], matrix, (bottom - top, right - left))
        found[top:bottom, left:right] = part[0].numpy()
    return found


@dataclass(frozen=True)
class View:
    """What the landmark network sees in the square around a circle, and in its mirror image turned back.

    masks: two of (256, 256) in [0, 1]; presences: its two opinions that somebody is there; landmarks: (N, 2)
    in the picture, as the first one shows them; next: the circle around them as both see it; size: (h, w) of
    the picture on which the circles are.
    """

    circle: Circle
    masks: tuple[np.ndarray, np.ndarray]
    presences: tuple[float, float]
    landmarks: np.ndarray
    next: Circle
    size: Sequence[int]

    @property
    def mask(self) -> np.ndarray:
        """The mean of both masks."""
        return (self.masks[0] + self.masks[1]) / 2

    @property
    def uncertainty(self) -> float:
        """How grey the mask is, and how much both differ, as shares of its area within the picture."""
        rows, columns = np.mgrid[:LANDMARK_SIDE, :LANDMARK_SIDE] + 0.5
        square = self.circle.square(LANDMARK_SIDE)
        places = np.stack([columns, rows], axis=-1) @ square[:, :2].T + square[:, 2]
        inside = ((places > 0) & (places < [self.size[1], self.size[0]])).all(axis=-1)
        mask = self.mask
        grey = 4 * mask * (1 - mask) + np.abs(self.masks[0] - self.masks[1])
        return float(grey[inside].sum() / max(mask[inside].sum(), 1.0))


def joined(
    views: Sequence[View], circle: Circle, side: int, weights: Sequence[float] | None = None
) -> np.ndarray:
    """Return the weighted mean (side, side) of the masks of views, in the square around a circle."""
    canvas = np.vstack([circle.square(side), [0, 0, 1]])
    sums = torch.zeros(2, side, side)  # of masks, and of the weights of those that show a pixel
    for view, weight in zip(views, weights if weights is not None else np.ones(len(views)), strict=True):
        onto = np.linalg.inv(np.vstack([view.circle.square(LANDMARK_SIDE), [0, 0, 1]])) @ canvas
        mask = torch.from_numpy(view.mask.astype(np.float32))
        matrix = torch.tensor(onto[:2], dtype=torch.float32)
        sums += float(weight) * affine_sample(
            torch.stack([mask, torch.ones_like(mask)]), matrix, (side, side)
        )
    return (sums[0] / sums[1].clamp(min=1e-6)).numpy()


@dataclass(frozen=True)
class Copies:
    """A picture (H, W, 3), and a copy of 1024 pixels (3, h, w); `scale` (x, y) leads from it to the other."""

    picture: np.ndarray
    reduced: torch.Tensor
    scale: np.ndarray

    @classmethod
    def of(cls, encoded: np.ndarray) -> "Copies":
        """Return the copies of a picture (H, W, 3)."""
        reduced = resize(encoded, size_within(encoded.shape, REDUCED_SIDE), "triangle")
        scale = np.array(encoded.shape[1::-1]) / reduced.shape[1::-1]
        return cls(encoded, planes(reduced), scale)

    @functools.cached_property
    def full(self) -> torch.Tensor:
        """The picture as planes (3, H, W): small people alone need them, and large pictures take time."""
        return planes(self.picture)

    @property
    def size(self) -> tuple[int, int]:
        """(H, W) of the full picture."""
        return (self.picture.shape[0], self.picture.shape[1])

    def for_circle(self, circle: Circle) -> tuple[torch.Tensor, np.ndarray]:
        """Return the copy to look at, and the scale (x, y) from it to the full one.

        A circle that is large on the reduced copy has all the detail there that its mask needs.
        """
        large = 2 * ROOM * circle.radius >= LANDMARK_SIDE * float(self.scale.mean())
        return (self.reduced, self.scale) if large else (self.full, np.ones(2))


def planes(picture: np.ndarray) -> torch.Tensor:
    """Return a picture (H, W, 3) as planes (3, H, W)."""
    return torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1), np.float32))


def sampled(picture: torch.Tensor, matrix: np.ndarray, side: int, beyond: str = "zeros") -> np.ndarray:
    """Sample a picture (3, H, W) on a canvas, (1, side, side, 3). The detector expects black beyond it.

    Where the canvas is much coarser than the picture, a mean of blocks comes first: `affine_sample` takes
    the mean of as many samples as there are pixels, which is slow beyond a few.
    """
    block = min(int(np.hypot(*matrix[:, 0]) / 2), *picture.shape[1:])
    if block > 1:
        picture, matrix = F.avg_pool2d(picture[None], block, ceil_mode=True)[0], matrix / block
    canvas = affine_sample(picture, torch.tensor(matrix, dtype=torch.float32), (side, side), beyond)
    return np.ascontiguousarray(canvas.permute(1, 2, 0)[None].numpy())
