"""A person as a solid that stands in a light's way: the front that the camera saw, and a back to go with it."""

import math
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from scipy.ndimage import distance_transform_edt

THICKEST = 0.2  # metres of body behind what the camera sees; measured by benchmarks/floor.py
GAIN = 1.5  # points a cell at which a silhouette is full is one over this: a sheet of points has no holes
CUBES = 2**20  # more than there are in a row
BEHIND = 0.05  # of the way from a light to the solid's middle, within which nothing is seen by the light


class Solid(NamedTuple):
    """The closed shell of a body. The camera is at the origin of its frame."""

    points: torch.Tensor  # (P, 3) metres
    spacing: float  # metres from point to point

    @classmethod
    def of(cls, positions: torch.Tensor, known: torch.Tensor) -> "Solid":
        """From what the camera saw: positions (3, h, w) in metres, where `known` (h, w) bool.

        No picture shows the back. It is taken to lie as far behind the front as a circle of diameter THICKEST
        is wide that touches the outline from within: limbs come out round, a chest flat.
        """
        inside = known.numpy()
        distance = np.linalg.norm(positions.numpy(), axis=0)
        rays = positions.numpy()[:, inside].T / distance[inside, None]
        pixel = _pixel(positions.numpy(), inside)
        front = np.where(inside, distance, np.nan)
        back = front + _thickness(inside, pixel)
        # A sheet ends where its neighbour lies deeper, or nowhere: a wall goes down to that, so that the shell
        # is closed from whichever side light comes.
        walls = [
            (front, np.fmin(_neighbours(front, np.inf).max(axis=0), back)),
            (np.fmax(_neighbours(back, -np.inf).min(axis=0), front), back),
        ]
        points = [_walls(rays, *(end[inside] for end in wall), pixel) for wall in walls]
        return cls(torch.from_numpy(np.concatenate(points, dtype=np.float32)), pixel)

    def coarser(self, spacing: float) -> "Solid":
        """The same with one point a cube of that side, where it was finer."""
        if spacing <= self.spacing:
            return self
        columns, rows, layers = (self.points / spacing).floor().long().T
        _, cube = torch.unique((columns * CUBES + rows) * CUBES + layers, return_inverse=True)
        count = torch.bincount(cube)
        sums = torch.zeros(len(count), 3).index_add_(0, cube, self.points)
        return Solid(sums / count[:, None], spacing)


class Silhouette:
    """What a point of light sees of a solid: 1 where the solid is in the way, 0 where light passes.

    Parameters
    ----------
    solid: Solid.
    light: (4,) homogeneous position, camera frame: (x, y, z, 1) in metres, or (x, y, z, 0) the direction of a
        light whose rays are parallel.
    """

    def __init__(self, solid: Solid, light: torch.Tensor) -> None:
        self._near, self._place = bool(light[3]), light[:3]
        middle = solid.points.mean(dim=0)
        axis = F.normalize(middle - self._place if self._near else -self._place, dim=0)
        aside = F.normalize(torch.linalg.cross(axis, torch.eye(3)[axis.abs().argmin()]), dim=0)
        self._axes = torch.stack([aside, torch.linalg.cross(axis, aside), axis])
        reach = float((middle - self._place).norm()) if self._near else 1.0
        self._least = BEHIND * reach
        seen, front = self._project(solid.points)
        if self._near:
            seen = seen[front]
        self._cell = solid.spacing / reach
        self._low = seen.amin(dim=0) - 2 * self._cell
        cells = (seen - self._low) / self._cell
        columns, rows = (cells.amax(dim=0).ceil().long() + 3).tolist()
        self.image = _splat(cells, (rows, columns))[None, None]

    def _project(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Where the light sees points (..., 3): (..., 2), and of a near one which are before it."""
        if not self._near:
            return points @ self._axes[:2].T, None
        seen = (points - self._place) @ self._axes.T
        return seen[..., :2] / seen[..., 2:].clamp_min(1e-9), seen[..., 2] > self._least

    def at(self, points: torch.Tensor) -> torch.Tensor:
        """How much of the light is blocked on its way to points (h, w, 3) behind the solid: (h, w)."""
        seen, front = self._project(points)
        size = torch.tensor([self.image.shape[-1], self.image.shape[-2]])
        grid = (
            (seen - self._low) / self._cell * 2 + 1
        ) / size - 1  # a cell's own place is its pixel's centre
        found = F.grid_sample(self.image, grid[None], padding_mode="zeros", align_corners=False)[0, 0]
        return found if front is None else found * front


def _pixel(positions: np.ndarray, inside: np.ndarray) -> float:
    """Metres from one pixel to the next, at the middle of what the camera saw."""
    steps = np.linalg.norm(np.diff(positions[:2], axis=2), axis=0)
    return float(np.median(steps[inside[:, 1:] & inside[:, :-1]]))


def _thickness(inside: np.ndarray, pixel: float) -> np.ndarray:
    """How far behind the front the back lies (h, w), metres."""
    edge = distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1] * pixel
    edge = edge.clip(0, THICKEST / 2)
    return 2 * np.sqrt(edge * (THICKEST - edge))


def _neighbours(depth: np.ndarray, outside: float) -> np.ndarray:
    """The four neighbours (4, h, w) of each pixel; `outside` where there are none."""
    padded = np.pad(np.where(np.isnan(depth), outside, depth), 1, constant_values=outside)
    return np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])


def _walls(rays: np.ndarray, near: np.ndarray, far: np.ndarray, spacing: float) -> np.ndarray:
    """Points along unit rays (N, 3) from one distance (N,) to another, as dense as `spacing`: (P, 3)."""
    count = np.ceil((far - near).clip(0) / spacing).astype(int) + 1
    ray = np.repeat(np.arange(len(rays)), count)
    step = np.arange(len(ray)) - np.repeat(np.cumsum(count) - count, count)
    distance = near[ray] + (far - near).clip(0)[ray] * step / np.maximum(count[ray] - 1, 1)
    return rays[ray] * distance[:, None]


def _splat(places: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    """Coverage (rows, columns) by points at places (P, 2), in cells, each shared by the four nearest."""
    corner = places.floor()
    right, down = (places - corner).T
    first = (corner[:, 1] * size[1] + corner[:, 0]).long()
    shares = ((1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right)
    index = torch.cat([first + offset for offset in (0, 1, size[1], size[1] + 1)])
    total = torch.bincount(index, torch.cat(shares), minlength=math.prod(size))
    return (total * GAIN).clamp(0, 1).view(size)
