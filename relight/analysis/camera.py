"""The camera of a plate: how pixels and depth become positions in metres.

Positions are in the camera's axes: x to image right, y up, z from the scene toward the camera. The origin is
the subject's middle: the centre of the matte's bounding box, at the median of the subject's depth. An arm
that is held forward does not move the median.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch

from relight.arguments import checked_number
from relight.lights.environment import FIELD_OF_VIEW
from shadow.framing import Framing, bounding_box

Place = TypeVar("Place", float, torch.Tensor)
DEFAULT_HEIGHT = 1.75  # metres of person that the matte shows, unless the caller gives a height


@dataclass(frozen=True)
class Camera:
    """The plate's pinhole camera, and the scale of the person before it. A shot has one for all frames.

    It looks along -z, through the middle of the plate.

    >>> import torch
    >>> matte = torch.zeros(64, 48)
    >>> matte[8:56, 12:36] = 1
    >>> camera = Camera.of(matte, height=1.8)
    >>> round(camera.distance, 2)  # metres to a person of 1.8 m who fills 48 of 64 rows
    3.3
    """

    size: tuple[int, int]  # (H, W) of the plate, pixels
    focal: float  # focal length, pixels
    middle: tuple[float, float]  # (x, y) of the subject's middle on the plate, pixels
    distance: float  # metres to the subject's middle, along z
    bottom: int  # row of the plate at which the person ends
    guessed: bool = False  # the frame cuts the person, and the caller did not give their height

    @classmethod
    def of(
        cls, matte: torch.Tensor, height: float | None = None, field_of_view: float = FIELD_OF_VIEW
    ) -> "Camera":
        """Make the camera that sees a person's matte (H, W) in [0, 1].

        `height`: metres of the person that the matte shows, in [0.01, 100]; DEFAULT_HEIGHT unless given.
        `field_of_view`: vertical, degrees, in [0.001, 170]. Raises TypeError or ValueError for no number, or
        one out of range.
        """
        angle = checked_number("field_of_view", field_of_view, 1e-3, 170)
        metres = DEFAULT_HEIGHT if height is None else checked_number("height", height, 0.01, 100)
        top, left, bottom, right = bounding_box(matte)
        size = (matte.shape[0], matte.shape[1])
        focal = focal_length(size[0], angle)
        middle = ((left + right) / 2, (top + bottom) / 2)
        cut = top == 0 or bottom == size[0]
        return cls(size, focal, middle, metres * focal / (bottom - top), bottom, cut and height is None)

    @property
    def field_of_view(self) -> float:
        """Vertical, degrees."""
        return math.degrees(2 * math.atan(self.size[0] / 2 / self.focal))

    @property
    def metres_per_pixel(self) -> float:
        """Metres that a pixel of the plate spans at the subject's middle."""
        return self.distance / self.focal

    @property
    def eye(self) -> tuple[float, float, float]:
        """Where the camera is: (x, y, z) in metres from the subject's middle."""
        across, down = self._slopes(*self.middle)
        return -across * self.distance, down * self.distance, self.distance

    def positions(self, x: torch.Tensor, y: torch.Tensor, depth: torch.Tensor) -> torch.Tensor:
        """Return where a surface is, (3, ...) in metres from the subject's middle.

        x, y: (...) tensors, pixels of the plate, whose centres are at halves. depth: (...) metres from the
        subject's middle along the camera's axis, larger farther away.
        """
        across, down = self._slopes(x, y)
        middle = self._slopes(*self.middle)
        away = depth + self.distance
        return torch.stack(
            [across * away - middle[0] * self.distance, middle[1] * self.distance - down * away, -depth]
        )

    def on_plate(self, position: Sequence[float] | np.ndarray) -> tuple[float, float]:
        """Return where (x, y), in pixels, the plate shows a position (3,) in front of the camera.

        Raises ValueError for a position at the camera or behind it.
        """
        middle, away = self._slopes(*self.middle), self.distance - position[2]
        if away <= 0:
            raise ValueError(f"position: expected z < {self.distance:g} m, in front of the camera")
        across = (position[0] + middle[0] * self.distance) / away
        down = (middle[1] * self.distance - position[1]) / away
        return across * self.focal + self.size[1] / 2, down * self.focal + self.size[0] / 2

    def rays(self, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """Return vectors (3, ...) from the camera through pixels (x, y), scaled to z = -1."""
        across, down = self._slopes(x, y)
        return torch.stack([across, -down, -torch.ones_like(across)])

    def _slopes(self, x: Place, y: Place) -> tuple[Place, Place]:
        return (x - self.size[1] / 2) / self.focal, (y - self.size[0] / 2) / self.focal


def focal_length(rows: int, field_of_view: float) -> float:
    """Return the focal length, in pixels, of a plate of `rows` pixels and a vertical angle in degrees."""
    return rows / 2 / math.tan(math.radians(field_of_view / 2))


def canvas_grid(framing: Framing) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the plate positions x and y, in pixels, of the centres of the canvas's pixels: (h, w) each."""
    (height, width), (x, y) = framing.canvas, framing.centre
    rows = (torch.arange(height) + 0.5 - height / 2) / framing.scale + y
    columns = (torch.arange(width) + 0.5 - width / 2) / framing.scale + x
    down, across = torch.meshgrid(rows, columns, indexing="ij")
    return across, down
