"""A bilateral filter in time: a frame's maps, averaged with those of the frames around it where they agree.

The networks see each frame by itself, and their errors flicker a little as the person moves across the
canvas. The frames before and after are moved to where the person is now, and each pixel of them is weighted
by how similar its shading is, under lights from all around. Flicker is small and averages out. A moving
shadow or limb is a large change and keeps its own frame's maps. (Tomasi and Manduchi 1998, for the filter;
Kuglin and Hines 1975, phase correlation, and Lucas and Kanade 1981, for the motion.)

The weights do not depend on the lights of the relit picture, which stays linear in them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F

from relight.analysis.depth import WorldGeometry
from relight.analysis.light_field import LightField
from relight.analysis.maps import AnalysisMaps
from shadow.directions import olat
from shadow.framing import affine_sample

RADIUS = 2  # frames before and after that take part
RANGE_SIGMA = 0.07  # difference in shading at which a frame's weight falls to 60 %
PROBE_LIGHTS = torch.from_numpy(olat())[::4]  # under which frames are compared
SUBPIXEL_STEPS = 3  # corrections of the motion by less than a pixel
WINDOW = 5  # canvas pixels, the side of the square over which differences are averaged


def temporally_filtered(
    maps: AnalysisMaps, neighbours: Iterable[AnalysisMaps], range_sigma: float = RANGE_SIGMA
) -> AnalysisMaps:
    """Average a frame's maps with those of frames before and after it where they agree.

    `range_sigma`: difference in shading, in [0, 1], at which a neighbour's weight falls to 60 %. Raises
    ValueError if the albedo was provided for some of the frames and inferred for others.
    """
    neighbours = list(neighbours)
    if not neighbours:
        return maps
    if any((other.light is None) is not (maps.light is None) for other in neighbours):
        raise ValueError("around: expected an albedo given for all of the frames, or for none")
    probed = maps.shading(PROBE_LIGHTS)
    aligned: list[tuple[AnalysisMaps, torch.Tensor | None, torch.Tensor]] = [
        (maps, None, torch.ones(1, *maps.known.shape))
    ]
    for other in neighbours:
        matrix = _motion(maps, other)
        aligned.append((other, matrix, _weight(maps, probed, other, matrix, range_sigma)))
    frames, matrices, weights = zip(*aligned, strict=True)
    total = torch.stack(weights).sum(dim=0)
    mean = _AlignedMean(matrices, tuple(weight / total for weight in weights))
    return maps._replace(
        normals=F.normalize(mean(frame.normals for frame in frames), dim=0),
        field=mean.field([frame.field for frame in frames]),
        albedo=mean(frame.albedo for frame in frames),
        light=None if maps.light is None else mean(frame.light for frame in frames),
        geometry=WorldGeometry(maps.geometry.camera, maps.framing, _MeanDepth(mean, frames)),
    )


@dataclass(frozen=True)
class _AlignedMean:
    """The weighted mean of the frames' maps (C, h, w), each aligned with the person on this frame's
    canvas."""

    matrices: tuple[torch.Tensor | None, ...]  # (2, 3) from this canvas to each frame's; None for itself
    weights: tuple[torch.Tensor, ...]  # (1, h, w), which sum to one

    def __call__(self, maps: Iterable[Any]) -> torch.Tensor:
        aligned = map(_aligned, maps, self.matrices)
        weighted = [weight * each for weight, each in zip(self.weights, aligned, strict=True)]
        return torch.stack(weighted).sum(dim=0)

    def field(self, fields: Sequence[LightField]) -> LightField:
        """Return the weighted mean of the arrays of the frames' fields, at the pixels of this frame's.

        Frames are averaged where they agree. There the function of the means is near the mean of functions.
        """
        own, *others = fields
        silhouette, width = own.silhouette, own.silhouette.shape[1]
        place = torch.stack([silhouette.pixels % width, silhouette.pixels // width]) + 0.5
        total = own.rows * silhouette.take(self.weights[0]).T
        for other, matrix, weights in zip(others, self.matrices[1:], self.weights[1:], strict=True):
            assert matrix is not None
            weight = silhouette.take(weights)[0]
            taking = weight.nonzero()[:, 0]
            moved = matrix[:, :2] @ place[:, taking] + matrix[:, 2:]
            total.index_add_(0, taking, weight[taking, None] * other.sampled(moved))
        return own.with_rows(total)


@dataclass(frozen=True)
class _MeanDepth:
    """The mean of the frames' depths (h, w), computed when it is asked for."""

    mean: _AlignedMean
    frames: tuple[AnalysisMaps, ...]

    def __call__(self) -> torch.Tensor:
        depth = self.mean(frame.geometry.depth[None] for frame in self.frames)[0]
        return depth * self.frames[0].known


def _aligned(maps: torch.Tensor, matrix: torch.Tensor | None) -> torch.Tensor:
    """Resample maps (C, h, w) of another frame onto this frame's canvas."""
    return maps if matrix is None else affine_sample(maps, matrix, maps.shape[1:])


def _motion(maps: AnalysisMaps, other: AnalysisMaps) -> torch.Tensor:
    """Return the matrix (2, 3) from a position on this canvas to the same part of the person on the other."""
    here, there = maps.image * maps.known, other.image * other.known

    def error(matrix: torch.Tensor) -> float:
        return float((_aligned(there, matrix) - here).abs().mean())

    unmoved = maps.framing.onto(other.framing)
    jump = _translated(unmoved, _whole_pixel_shift(here, _aligned(there, unmoved)))
    best = min((unmoved, jump), key=error)
    for _ in range(SUBPIXEL_STEPS):
        shift = _subpixel_shift(here, _aligned(there, best))
        best = min((best, _translated(best, shift)), key=error)
    return best


def _translated(matrix: torch.Tensor, shift: torch.Tensor) -> torch.Tensor:
    """Return the matrix preceded by a shift (2,) on this canvas."""
    return torch.cat([matrix[:, :2], matrix[:, 2:] + matrix[:, :2] @ shift[:, None]], dim=1)


def _whole_pixel_shift(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """Return (x, y), whole pixels, by which content moved between images (C, h, w): phase correlation."""
    cross = (torch.fft.rfft2(first).conj() * torch.fft.rfft2(second)).sum(dim=0)
    peaks = torch.fft.irfft2(cross / cross.abs().clamp_min(1e-9), s=first.shape[-2:])
    height, width = peaks.shape
    row, column = divmod(int(peaks.argmax()), width)
    return torch.tensor(
        [
            (column + width // 2) % width - width // 2,
            (row + height // 2) % height - height // 2,
        ]
    ).float()


def _subpixel_shift(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """Return (x, y) by which the content moved, if by less than a pixel (Lucas and Kanade 1981)."""
    gradients = torch.stack(torch.gradient(second, dim=(2, 1))).flatten(1)
    normal = gradients @ gradients.T + 1e-6 * torch.eye(2)
    return torch.linalg.solve(normal, gradients @ (first - second).flatten()).clamp(-1, 1)


def _weight(
    maps: AnalysisMaps, probed: torch.Tensor, other: AnalysisMaps, matrix: torch.Tensor, range_sigma: float
) -> torch.Tensor:
    """Return the weight (1, h, w) of another frame: 1 where its shading is equal, 0 where it is unknown."""
    known = (_aligned(other.known[None].float(), matrix) > 0.99) & maps.known
    difference = (_aligned(other.shading(PROBE_LIGHTS), matrix) - probed).abs().amax(dim=0, keepdim=True)
    squared = _box_mean(difference**2 * known) / _box_mean(known.float()).clamp_min(1e-3)
    return known * torch.exp(-squared / (2 * range_sigma**2))


def _box_mean(image: torch.Tensor) -> torch.Tensor:
    return F.avg_pool2d(image, WINDOW, stride=1, padding=WINDOW // 2)
