"""A person as a solid in the way of light: the front that the camera saw, and a back to go with it."""

import math
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from scipy.ndimage import distance_transform_edt

THICKEST = 0.2  # metres of body behind what the camera sees; measured by benchmarks/floor.py
GAIN = 1.5  # points a cell at which a silhouette is full is one over this: a sheet of points has no holes
CUBES = 2**20  # more than there are in a row
WIDE = 2.5  # standard deviations of a Gaussian that are looked at
MOST = 8.0  # cells of blur: beyond, a shadow is so faint that the gain is not worth the time
FINEST = 1.0  # cells: what is blurred less is sharp
LAP = 0.5  # octaves by which what is blurred alike overlaps the next, so that no light is seen between
BEHIND = 0.05  # of the way from a light to the solid's middle, within which nothing is seen by the light


def pixel_of(positions: torch.Tensor, known: torch.Tensor) -> float:
    """Metres from one pixel to the next, in the middle of what the camera saw, as of `Solid.of`."""
    steps = positions.diff(dim=2)[:2].norm(dim=0)
    return float(steps[known[:, 1:] & known[:, :-1]].median())


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
        pixel = pixel_of(positions, known)
        front = np.where(inside, distance, np.nan)
        back = front + _thickness(inside, pixel)
        # Where its neighbour lies deeper, or there is none, a sheet ends: a wall goes down from there, so
        # that the shell is closed from whichever side light comes.
        walls = [
            (front, np.fmin(_neighbours(front, np.inf).max(axis=0), back)),
            (np.fmax(_neighbours(back, -np.inf).min(axis=0), front), back),
        ]
        points = [_walls(rays, near[inside], far[inside], pixel) for near, far in walls]
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
    blur: (P,) how far the edge of each point's shadow is spread, as a standard deviation in metres; of a near
        light in metres at one metre from it. None for a sharp one.
    """

    def __init__(self, solid: Solid, light: torch.Tensor, blur: torch.Tensor | None = None) -> None:
        self._near, self._place = bool(light[3]), light[:3]
        middle = solid.points.mean(dim=0)
        axis = F.normalize(middle - self._place if self._near else -self._place, dim=0)
        aside = F.normalize(torch.linalg.cross(axis, torch.eye(3)[axis.abs().argmin()]), dim=0)
        self._axes = torch.stack([aside, torch.linalg.cross(axis, aside), axis])
        reach = float((middle - self._place).norm()) if self._near else 1.0
        self._least = BEHIND * reach
        seen, front = self._project(solid.points)
        blur = torch.zeros(len(seen)) if blur is None else blur
        if front is not None:
            seen, blur = seen[front], blur[front]
        self._cell = solid.spacing / reach
        blur = (blur / self._cell).clamp_max(MOST)
        margin = 2 + math.ceil(WIDE * float(blur.max())) if len(blur) else 2
        self._low = (seen.amin(dim=0) if len(seen) else torch.zeros(2)) - margin * self._cell
        cells = (seen - self._low) / self._cell
        columns, rows = (
            (cells.amax(dim=0) if len(cells) else cells.sum(dim=0)).ceil().long() + 1 + margin
        ).tolist()
        self.image = _spread(cells, blur, (rows, columns))[None, None]

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


def _spread(places: torch.Tensor, blur: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    """Coverage (rows, columns) by points at places (P, 2), each spread by its own blur (P,), all in cells.

    From the most blurred octave to the sharpest: what there is of it so far is blurred by what the octave has
    more than the next, so that the shadow of a leg stays whole from the heel, where it is sharp, upward.
    """
    octave = (blur / FINEST).clamp_min(1).log2()
    image = torch.zeros(size)
    for step in range(int(octave.max().ceil()) if len(blur) else 0, -1, -1):
        here = (octave <= step) & (octave > step - 1 - LAP)
        image = torch.maximum(image, _splat(places[here], size))
        if step:
            image = _blurred(image, FINEST * 2**step * math.sqrt(1 / 2 - 1 / 8))
    return image


def _blurred(image: torch.Tensor, sigma: float) -> torch.Tensor:
    """An image (h, w) under a Gaussian of that standard deviation in pixels; zero beyond its frame."""
    reach = math.ceil(WIDE * sigma)
    weights = torch.exp(-(torch.arange(-reach, reach + 1) ** 2) / (2 * sigma**2))
    weights = (weights / weights.sum())[None, None, None]
    across = F.conv2d(image[None, None], weights, padding=(0, reach))
    return F.conv2d(across, weights.mT, padding=(reach, 0))[0, 0]


def _splat(places: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    """Coverage (rows, columns) by points at places (P, 2), in cells, each shared by the four nearest."""
    corner = places.floor()
    right, down = (places - corner).T
    first = (corner[:, 1] * size[1] + corner[:, 0]).long()
    shares = ((1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right)
    index = torch.cat([first + offset for offset in (0, 1, size[1], size[1] + 1)])
    total = torch.bincount(index, torch.cat(shares), minlength=math.prod(size))
    covered = (total * GAIN).clamp(0, 1).view(1, 1, *size)
    # Points at the outline reach most of a cell beyond it. There 0.8 of the cells around are covered.
    around = F.avg_pool2d(covered, 3, stride=1, padding=1)[0, 0]
    return ((around - 0.8) / 0.4 + 0.5).clamp(0, 1)
