"""A person as a closed shell in the way of light: the front that the camera sees, and an assumed back."""

import math
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from scipy.ndimage import distance_transform_edt

MAX_THICKNESS = 0.2  # metres of body behind what the camera sees; measured by benchmarks/floor.py
COVERAGE_GAIN = 1.5  # a cell that holds at least 1 / this points is covered, so a surface has no holes
CUBES_PER_ROW = 2**20  # more than any row has
GAUSSIAN_SIGMAS = 2.5  # standard deviations at which a Gaussian is cut off
MAX_BLUR_CELLS = 8.0  # standard deviation: beyond it a shadow is too faint for more to matter
SHARP_CELLS = 1.0  # standard deviation below which a shadow is not blurred
OCTAVE_OVERLAP = 0.5  # octaves that two levels of blur share, so that no light is seen between them
NEAR_SHARE = 0.05  # of the distance from a light to the caster's middle: nearer points are behind the light


def pixel_spacing(positions: torch.Tensor, known: torch.Tensor) -> float:
    """Return the median distance in metres of neighbouring pixels; arguments as for `ShadowCaster.of`."""
    steps = positions.diff(dim=2)[:2].norm(dim=0)
    return float(steps[known[:, 1:] & known[:, :-1]].median())


class ShadowCaster(NamedTuple):
    """The closed shell of a body. The camera is at the origin of its frame."""

    points: torch.Tensor  # (P, 3) metres
    spacing: float  # metres from point to point

    @classmethod
    def of(cls, positions: torch.Tensor, known: torch.Tensor) -> "ShadowCaster":
        """Make the shell from positions (3, h, w) in metres that the camera sees where `known` (h, w) bool.

        The back is not seen. It is taken to lie behind the front by the width of a circle of diameter
        MAX_THICKNESS that touches the outline from within: limbs come out round, a chest flat.
        """
        inside = known.numpy()
        distance = np.linalg.norm(positions.numpy(), axis=0)
        rays = positions.numpy()[:, inside].T / distance[inside, None]
        pixel = pixel_spacing(positions, known)
        front = np.where(inside, distance, np.nan)
        edge = distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1] * pixel
        back = front + thickness(edge)
        # A sheet ends where its neighbour lies deeper or is missing. A wall from there closes the shell, for
        # light from any side.
        walls = [
            (front, np.fmin(_neighbours(front, np.inf).max(axis=0), back)),
            (np.fmax(_neighbours(back, -np.inf).min(axis=0), front), back),
        ]
        points = [_walls(rays, near[inside], far[inside], pixel) for near, far in walls]
        return cls(torch.from_numpy(np.concatenate(points, dtype=np.float32)), pixel)

    def coarser(self, spacing: float) -> "ShadowCaster":
        """Return the shell with one point for each cube of this side, in metres, if it is finer than that."""
        if spacing <= self.spacing:
            return self
        columns, rows, layers = (self.points / spacing).floor().long().T
        _, cube = torch.unique((columns * CUBES_PER_ROW + rows) * CUBES_PER_ROW + layers, return_inverse=True)
        count = torch.bincount(cube)
        sums = torch.zeros(len(count), 3).index_add_(0, cube, self.points)
        return ShadowCaster(sums / count[:, None], spacing)


class CasterSilhouette:
    """The image of a shadow caster from a point light: 1 where it blocks the light, 0 where light passes.

    `light`: (4,) homogeneous position, camera frame: (x, y, z, 1) in metres, or (x, y, z, 0) for the
    direction of a light whose rays are parallel. `blur`: (P,) standard deviation of the edge of each point's
    shadow, metres; for a near light metres at one metre from it. None for a sharp shadow.
    """

    def __init__(self, caster: ShadowCaster, light: torch.Tensor, blur: torch.Tensor | None = None) -> None:
        self._near, self._place = bool(light[3]), light[:3]
        middle = caster.points.mean(dim=0)
        axis = F.normalize(middle - self._place if self._near else -self._place, dim=0)
        aside = F.normalize(torch.linalg.cross(axis, torch.eye(3)[axis.abs().argmin()]), dim=0)
        self._axes = torch.stack([aside, torch.linalg.cross(axis, aside), axis])
        distance = float((middle - self._place).norm()) if self._near else 1.0
        self._least = NEAR_SHARE * distance
        seen, front = self._project(caster.points)
        blur = torch.zeros(len(seen)) if blur is None else blur
        if front is not None:
            seen, blur = seen[front], blur[front]
        self._cell = caster.spacing / distance
        blur = (blur / self._cell).clamp_max(MAX_BLUR_CELLS)
        margin = 2 + math.ceil(GAUSSIAN_SIGMAS * float(blur.max())) if len(blur) else 2
        self._low = (seen.amin(dim=0) if len(seen) else torch.zeros(2)) - margin * self._cell
        cells = (seen - self._low) / self._cell
        columns, rows = (
            (cells.amax(dim=0) if len(cells) else cells.sum(dim=0)).ceil().long() + 1 + margin
        ).tolist()
        self.image = _spread(cells, blur, (rows, columns))[None, None]

    def _project(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Return the image positions (..., 2) of points (..., 3), and which are before a near light."""
        if not self._near:
            return points @ self._axes[:2].T, None
        seen = (points - self._place) @ self._axes.T
        return seen[..., :2] / seen[..., 2:].clamp_min(1e-9), seen[..., 2] > self._least

    def at(self, points: torch.Tensor) -> torch.Tensor:
        """Return the share (h, w) of the light that is blocked on its way to points (h, w, 3)."""
        seen, front = self._project(points)
        size = torch.tensor([self.image.shape[-1], self.image.shape[-2]])
        # The position of a cell is the centre of its pixel.
        grid = ((seen - self._low) / self._cell * 2 + 1) / size - 1
        blocked = F.grid_sample(self.image, grid[None], padding_mode="zeros", align_corners=False)[0, 0]
        return blocked if front is None else blocked * front


def thickness(edge: np.ndarray) -> np.ndarray:
    """Return how far behind the front the back lies, `edge` metres inside the person's outline; metres."""
    edge = edge.clip(0, MAX_THICKNESS / 2)
    return 2 * np.sqrt(edge * (MAX_THICKNESS - edge))


def _neighbours(depth: np.ndarray, outside: float) -> np.ndarray:
    """Return the four neighbours (4, h, w) of each pixel; `outside` where there are none."""
    padded = np.pad(np.where(np.isnan(depth), outside, depth), 1, constant_values=outside)
    return np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])


def _walls(rays: np.ndarray, near: np.ndarray, far: np.ndarray, spacing: float) -> np.ndarray:
    """Return points (P, 3) along unit rays (N, 3) from one distance (N,) to another, `spacing` apart."""
    count = np.ceil((far - near).clip(0) / spacing).astype(int) + 1
    ray = np.repeat(np.arange(len(rays)), count)
    step = np.arange(len(ray)) - np.repeat(np.cumsum(count) - count, count)
    distance = near[ray] + (far - near).clip(0)[ray] * step / np.maximum(count[ray] - 1, 1)
    return rays[ray] * distance[:, None]


def _spread(places: torch.Tensor, blur: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    """Return the coverage (rows, columns) by points at places (P, 2), each with its own blur (P,), in cells.

    From the most blurred octave to the sharpest, the image so far is blurred by the difference of an octave
    to the next. So the shadow of a leg has no gap from the heel, where it is sharp, upward.
    """
    octave = (blur / SHARP_CELLS).clamp_min(1).log2()
    image = torch.zeros(size)
    for step in range(int(octave.max().ceil()) if len(blur) else 0, -1, -1):
        here = (octave <= step) & (octave > step - 1 - OCTAVE_OVERLAP)
        image = torch.maximum(image, _splat(places[here], size))
        if step:
            image = _blurred(image, SHARP_CELLS * 2**step * math.sqrt(1 / 2 - 1 / 8))
    return image


def _blurred(image: torch.Tensor, sigma: float) -> torch.Tensor:
    """Blur an image (h, w) by a Gaussian of this standard deviation in pixels; zero beyond its frame."""
    radius = math.ceil(GAUSSIAN_SIGMAS * sigma)
    weights = torch.exp(-(torch.arange(-radius, radius + 1) ** 2) / (2 * sigma**2))
    weights = (weights / weights.sum())[None, None, None]
    across = F.conv2d(image[None, None], weights, padding=(0, radius))
    return F.conv2d(across, weights.mT, padding=(radius, 0))[0, 0]


def _splat(places: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    """Return the coverage (rows, columns) by points at places (P, 2), each shared by four cells."""
    corner = places.floor()
    right, down = (places - corner).T
    first = (corner[:, 1] * size[1] + corner[:, 0]).long()
    shares = ((1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right)
    index = torch.cat([first + offset for offset in (0, 1, size[1], size[1] + 1)])
    total = torch.bincount(index, torch.cat(shares), minlength=math.prod(size))
    covered = (total * COVERAGE_GAIN).clamp(0, 1).view(1, 1, *size)
    # Points at the outline cover most of a cell beyond it. There 0.8 of the cells around are covered.
    around = F.avg_pool2d(covered, 3, stride=1, padding=1)[0, 0]
    return ((around - 0.8) / 0.4 + 0.5).clamp(0, 1)
