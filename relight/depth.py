"""How far away the person is at each pixel, and where in the room that is.

Positions are metres in the camera's axes: x to image right, y up, z to the camera. Their origin is the
subject's middle: the centre of the matte's bounding box, at the median of the subject's depth, which an arm
that is held forward does not move.

Depth comes from the normals. Between neighbouring pixels it changes as the plane through either of them
says, along their rays (Milano et al., ICCV 2025: exact for planes, whatever the camera). Of its two sides
along a row or column a pixel trusts the one that fits: so depth may jump where a limb passes before the body
(bilateral normal integration, Cao et al., ECCV 2022). Written from the papers.
"""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from scipy import sparse
from scipy.sparse.linalg import splu

from relight.lights.environment import FIELD_OF_VIEW
from relight.lights.light import checked_number
from relight.media.images.edge import as_array
from shadow.analysis import Analysis
from shadow.framing import Framing, bounding_box

HEIGHT = 1.75  # metres of person that the matte shows, unless said
SOLVES = 4  # of the linear system, each with the weights of the depth before it
TRUST = 20.0  # how sharply a pixel decides between its two sides
STEEP = 0.05  # least cosine between a normal and the ray to the camera: beyond, depth could be anything
FLAT = 1e-5  # pull to a flat person, where nothing else says the low frequencies: normals drift
ANCHORED = 3e-4  # pull to a depth that says them
UNLIKE = 0.2  # correlation of a relative depth with that of the normals, below which it is another picture's

Found = Callable[[], torch.Tensor]  # to the depth (h, w) of a canvas, metres away from the middle


@dataclass(frozen=True)
class Camera:
    """The plate's camera, and how large the person before it is. In a shot, one for all frames.

    It looks along -z, through the middle of the plate.
    """

    size: tuple[int, int]  # (H, W) of the plate, pixels
    focal: float  # pixels
    middle: tuple[float, float]  # (x, y) of the subject's middle on the plate, pixels
    distance: float  # metres to the subject's middle, along z
    bottom: int  # row of the plate at which the person ends
    guessed: bool = False  # the frame cuts the person, and nobody has said how many metres it shows

    @classmethod
    def of(
        cls, matte: torch.Tensor, height: float | None = None, field_of_view: float = FIELD_OF_VIEW
    ) -> "Camera":
        """From the person's matte (H, W).

        `height`: metres of the person that the matte shows, HEIGHT unless given; `field_of_view`: vertical,
        degrees. ValueError for what is out of range.
        """
        angle = checked_number("field_of_view", field_of_view, 1e-3, 170)
        metres = HEIGHT if height is None else checked_number("height", height, 0.01, 100)
        top, left, bottom, right = bounding_box(matte)
        size = (matte.shape[0], matte.shape[1])
        focal = size[0] / 2 / math.tan(math.radians(angle / 2))
        middle = ((left + right) / 2, (top + bottom) / 2)
        cut = top == 0 or bottom == size[0]
        return cls(size, focal, middle, metres * focal / (bottom - top), bottom, cut and height is None)

    @property
    def metres_per_pixel(self) -> float:
        """Of the plate, at the subject's middle."""
        return self.distance / self.focal

    def positions(self, x: Any, y: Any, depth: Any) -> torch.Tensor:
        """Where (3, ...) a surface is, in metres from the subject's middle.

        x, y: (...) tensors on the plate, pixels, of which centres are at halves. depth: (...) metres away
        from the middle, along the camera's axis.
        """
        across, down = self._slopes(x, y)
        middle = self._slopes(*self.middle)
        away = depth + self.distance
        return torch.stack(
            [across * away - middle[0] * self.distance, middle[1] * self.distance - down * away, -depth]
        )

    def on_plate(self, position: Any) -> tuple[float, float]:
        """Where (x, y) on the plate a position (3,) is seen, in pixels; it lies before the camera."""
        middle, away = self._slopes(*self.middle), self.distance - position[2]
        across = (position[0] + middle[0] * self.distance) / away
        down = (middle[1] * self.distance - position[1]) / away
        return across * self.focal + self.size[1] / 2, down * self.focal + self.size[0] / 2

    def rays(self, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """(3, ...) toward what pixels show, as long as one metre of distance takes."""
        across, down = self._slopes(x, y)
        return torch.stack([across, -down, -torch.ones_like(across)])

    def _slopes(self, x: Any, y: Any) -> tuple[Any, Any]:
        return (x - self.size[1] / 2) / self.focal, (y - self.size[0] / 2) / self.focal


class Space:
    """Where the person of a frame is in the room, on their canvas; worked out when first asked for."""

    def __init__(self, camera: Camera, framing: Framing, found: Found) -> None:
        """`framing`: of the canvas on the whole plate. `found`: says the depth."""
        self.camera, self.framing, self._found = camera, framing, found

    @classmethod
    def of(
        cls,
        analysis: Analysis,
        camera: Camera,
        framing: Framing,
        matte: torch.Tensor,
        given: torch.Tensor | None = None,
        relative: bool = False,
        own_normals: bool = True,
    ) -> "Space":
        """From the analysis of a person with this matte (H, W) on the whole plate.

        `given`: depth (1, H, W) of the plate that takes the place of what was found, in metres or `relative`.
        `own_normals`: the normals are the network's. Those that somebody gave are integrated as they are,
        since the network's depth belongs to its own.
        """
        known, anchor = analysis.framed.mask.cpu() > 0.5, analysis.canvas_depth if own_normals else None
        if anchor is not None:
            top, _, bottom, _ = bounding_box(matte)
            anchor = anchor.cpu() * (bottom - top) * camera.metres_per_pixel
        integrated = Integrated(camera, framing, analysis.canvas_normals.cpu(), known, anchor)
        if given is None:
            return cls(camera, framing, integrated)
        given = given.cpu()
        # Pixels beside the person, of whatever depth, take no part in the mean of a canvas pixel.
        shares = framing.crop(torch.cat([given * matte, matte[None]]))
        depth = shares[0] / shares[1].clamp_min(1e-6)
        return cls(camera, framing, Fitted(depth, known, integrated) if relative else Given(depth, known))

    @cached_property
    def depth(self) -> torch.Tensor:
        """(h, w) metres away from the subject's middle, along the camera's axis; zero off the subject."""
        if self.camera.guessed:
            warnings.warn(
                f"height: the frame cuts the person, and no height is given: taken to show {HEIGHT} m",
                stacklevel=2,
            )
        return self._found()

    @cached_property
    def positions(self) -> torch.Tensor:
        """(3, h, w) metres from the subject's middle; off the subject, at the middle's depth."""
        return self.camera.positions(*grid(self.framing), self.depth)

    @property
    def metres_per_pixel(self) -> float:
        """Of the canvas, at the subject's middle."""
        return self.camera.metres_per_pixel / self.framing.scale

    def place(self, position: np.ndarray) -> tuple[int, int]:
        """(row, column) of the canvas pixel where a position (3,) before the camera is seen, which may lie
        beyond the canvas."""
        x, y = self.camera.on_plate(position)
        (height, width), scale = self.framing.canvas, self.framing.scale
        row = (y - self.framing.centre[1]) * scale + height / 2
        column = (x - self.framing.centre[0]) * scale + width / 2
        return math.floor(row), math.floor(column)


def grid(framing: Framing) -> tuple[torch.Tensor, torch.Tensor]:
    """Where the centres of the canvas's pixels are on the plate: x and y, (h, w) each, pixels."""
    (height, width), (x, y) = framing.canvas, framing.centre
    rows = (torch.arange(height) + 0.5 - height / 2) / framing.scale + y
    columns = (torch.arange(width) + 0.5 - width / 2) / framing.scale + x
    down, across = torch.meshgrid(rows, columns, indexing="ij")
    return across, down


@dataclass(frozen=True)
class Integrated:
    """Depth from normals: what `Space` finds it by."""

    camera: Camera
    framing: Framing
    normals: torch.Tensor  # (3, h, w)
    known: torch.Tensor  # (h, w) bool: shows the subject
    anchor: torch.Tensor | None = None  # (h, w) metres: its low frequencies are right

    def __call__(self) -> torch.Tensor:
        rays = self.camera.rays(*grid(self.framing))
        focal = self.camera.focal * self.framing.scale
        anchor = None if self.anchor is None else (self.anchor / self.camera.distance).clamp_min(-0.9).log1p()
        ratios = integrate(self.normals, self.known, rays, focal, anchor)
        return centred(self.camera.distance * ratios.exp(), self.known)


@dataclass(frozen=True)
class Given:
    """Depth that something else made (h, w): metres, of which differences alone count."""

    depth: torch.Tensor
    known: torch.Tensor  # (h, w) bool: shows the subject

    def __call__(self) -> torch.Tensor:
        return centred(self.depth, self.known)


@dataclass(frozen=True)
class Fitted:
    """Relative depth (h, w), such as a network says it: scaled to the depth of the normals, either way up."""

    depth: torch.Tensor
    known: torch.Tensor  # (h, w) bool: shows the subject
    reference: Integrated

    def __call__(self) -> torch.Tensor:
        metres, relative = self.reference()[self.known], self.depth[self.known]
        # Both are rough: the line through both spreads is not flattened by the errors of one.
        spreads = torch.stack([metres, relative])
        correlation = float(torch.corrcoef(spreads)[0, 1].nan_to_num())
        if abs(correlation) < UNLIKE:
            raise ValueError(
                "depth: does not go with the person's normals, neither as it is nor turned over "
                f"(correlation {correlation:.2f}); expected the depth of this photograph"
            )
        scale = math.copysign(float(metres.std() / relative.std()), correlation)
        return centred(self.depth * scale, self.known)


def centred(depth: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
    """Depth (h, w) from its median over the subject; zero elsewhere."""
    return torch.where(known, depth - depth[known].median(), 0.0)


def integrate(
    normals: torch.Tensor,
    known: torch.Tensor,
    rays: torch.Tensor,
    focal: float,
    anchor: torch.Tensor | None = None,
) -> torch.Tensor:
    """The surface that has these normals, as the logarithm of its distance.

    Parameters
    ----------
    normals: (3, h, w) unit vectors, camera frame. known: (h, w) bool, where the subject is.
    rays: (3, h, w) from the camera toward what the pixels show, their z -1. focal: pixels.
    anchor: (h, w), the logarithm of a depth over its middle, whose low frequencies the result keeps.

    Returns
    -------
    (h, w) float32, relative to about zero; zero off the subject. 0.25 s of one core for 25,000 pixels.
    """
    surface, seen = (maps[:, known].T.double().numpy() for maps in (normals, rays))
    count = len(surface)
    confidence = (focal * _facing(surface, seen)) ** 2
    pull = np.full(count, (FLAT if anchor is None else ANCHORED) * focal**2)
    toward = np.zeros(count) if anchor is None else anchor[known].double().numpy()
    lines = [_Line.of(first, second, surface, seen) for first, second in _neighbours(known.numpy())]
    found = np.zeros(count)
    for _ in range(SOLVES):
        found = _solved(lines, confidence, pull, toward, found)
    result = torch.zeros(known.shape)
    result[known] = torch.from_numpy(found - found.mean()).float()
    return result


@dataclass(frozen=True)
class _Line:
    """Neighbours along all rows, or all columns: M pairs of pixels."""

    first: np.ndarray  # (M,) indices
    second: np.ndarray
    ahead: np.ndarray  # (M,) change of log depth from first to second, by the plane through the first
    behind: np.ndarray  # by the plane through the second

    @classmethod
    def of(cls, first: np.ndarray, second: np.ndarray, normals: np.ndarray, rays: np.ndarray) -> "_Line":
        steps = [
            np.log(_facing(normals[plane], rays[first]) / _facing(normals[plane], rays[second]))
            for plane in (first, second)
        ]
        return cls(first, second, *steps)

    def weights(self, confidence: np.ndarray, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(M,) each, how much the planes of the first and of the second count, after a depth was found."""
        change, count = found[self.second] - found[self.first], len(found)
        misfit = np.full((2, count), np.inf)
        misfit[0, self.first] = confidence[self.first] * (change - self.ahead) ** 2
        misfit[1, self.second] = confidence[self.second] * (change - self.behind) ** 2
        alone = np.isinf(misfit).any(axis=0)  # with a neighbour on one side, or none
        difference = np.where(alone, 0.0, misfit[1] - np.where(alone, 0.0, misfit[0]))
        share = 1 / (1 + np.exp((-TRUST * difference).clip(-50, 50)))
        ahead, behind = np.where(alone, 1.0, share), np.where(alone, 1.0, 1 - share)
        return ahead[self.first] * confidence[self.first], behind[self.second] * confidence[self.second]


def _facing(normals: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """How much normals (N, 3) turn against rays (N, 3)."""
    return np.maximum(-np.einsum("nc,nc->n", normals, rays), STEEP)


def _neighbours(known: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pairs of known pixels, by their number: one beside the other, and one above the other."""
    number = np.full(known.shape, -1)
    number[known] = np.arange(known.sum())
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    return [(a[both], b[both]) for a, b in pairs for both in [(a >= 0) & (b >= 0)]]


def _solved(
    lines: list[_Line], confidence: np.ndarray, pull: np.ndarray, toward: np.ndarray, found: np.ndarray
) -> np.ndarray:
    """The least squares of all changes, weighted by how they fit the log depth found before, (N,)."""
    count = len(found)
    diagonal, right = pull.copy(), pull * toward
    entries, rows, columns = [], [], []
    for line in lines:
        ahead, behind = line.weights(confidence, found)
        weight, change = ahead + behind, ahead * line.ahead + behind * line.behind
        for end, sign in ((line.first, -1), (line.second, 1)):
            diagonal += np.bincount(end, weight, count)
            right += sign * np.bincount(end, change, count)
        entries += [-weight, -weight]
        rows += [line.first, line.second]
        columns += [line.second, line.first]
    diagonals = np.arange(count)
    places = np.concatenate([*rows, diagonals]), np.concatenate([*columns, diagonals])
    matrix = sparse.csc_matrix((np.concatenate([*entries, diagonal]), places), shape=(count, count))
    # The matrix is symmetric and positive: it needs no pivots, and an order made for that.
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return factors.solve(right)


def given_depth(depth: Any, size: tuple[int, ...]) -> torch.Tensor:
    """The caller's depth as (1, H, W), checked: TypeError or ValueError for another shape or dtype, NaN, or
    values that no float32 holds."""
    values = as_array("depth", depth)
    if not np.issubdtype(values.dtype, np.floating):
        raise TypeError(f"depth: expected a floating dtype, metres, got {values.dtype}")
    if values.shape != tuple(size):
        raise ValueError(f"depth: expected shape {tuple(size)}, the size of the image, got {values.shape}")
    if not np.isfinite(values).all() or np.abs(values).max() > 1e6:
        raise ValueError("depth: contains NaN, infinite values or more than 1e6 metres")
    return torch.from_numpy(np.ascontiguousarray(values, np.float32))[None]
