"""A person in a picture, as the landmark network sees them: the circle around them, and the square in it.

The square is turned so that the person is upright. What is sampled from it, and the mask that comes back,
are those of `relight.matting.person`.
"""

from dataclasses import dataclass

import numpy as np
import torch

from shadow.framing import affine_sample

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

    def distance(self, other: "Circle") -> float:
        """Return how unlike another circle is, in place and in size: 0 for the same."""
        moved = float(np.hypot(*(self.centre - other.centre))) / other.radius
        return moved + abs(float(np.log(self.radius / other.radius)))


@dataclass(frozen=True)
class DetectedPerson:
    """Somebody in a picture: their circle, and their mask (256, 256) in [0, 1] in the square around it.

    presence: the landmark network's opinion, in [0, 1], that somebody is there, a mean of its last looks.
    """

    circle: Circle
    mask: np.ndarray
    presence: float = 1.0

    @property
    def certainty(self) -> float:
        """The presence, and less for who is not upright, as what only looks like somebody seldom is."""
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

    def on(self, size: tuple[int, int]) -> np.ndarray:
        """Return the mask on the picture: (H, W) float32 in [0, 1]."""
        side = len(self.mask)
        square = self.circle.square(side)
        corners = square @ np.array([[0, side, 0, side], [0, 0, side, side], [1, 1, 1, 1]])
        limits = np.array([size[1], size[0]])
        left, top = np.floor(corners.min(axis=1)).clip(0, limits).astype(int)
        right, bottom = np.ceil(corners.max(axis=1)).clip(0, limits).astype(int)
        found = np.zeros(size, np.float32)
        if right > left and bottom > top:
            turn = np.linalg.inv(square[:, :2])
            offset = turn @ (np.array([left, top]) - square[:, 2])
            matrix = torch.tensor(np.concatenate([turn, offset[:, None]], axis=1), dtype=torch.float32)
            part = affine_sample(torch.from_numpy(self.mask)[None], matrix, (bottom - top, right - left))
            found[top:bottom, left:right] = part[0].numpy()
        return found


def planes(picture: np.ndarray) -> torch.Tensor:
    """Return a picture (H, W, 3) as planes (3, H, W)."""
    return torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1), np.float32))


def sampled(picture: torch.Tensor, matrix: np.ndarray, side: int, beyond: str = "zeros") -> np.ndarray:
    """Sample a picture (3, H, W) on a canvas, (1, side, side, 3). The detector expects black beyond it."""
    canvas = affine_sample(picture, torch.tensor(matrix, dtype=torch.float32), (side, side), beyond)
    return np.ascontiguousarray(canvas.permute(1, 2, 0)[None].numpy())
