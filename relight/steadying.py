"""Steadier frames: what the networks found in one, averaged with the frames around it where they agree.

The networks see each frame by itself, and what they find trembles a little as the person moves across their
canvas. A bilateral filter in time takes that out: of the frames before and after, moved to where the person
is now, each pixel counts as much as its shading is alike under lights from all over. Trembling is small and
averages out; a shadow that moves, or a limb, is a large change and keeps its own frame's maps. (Tomasi and
Manduchi 1998, for the filter; Kuglin and Hines 1975, phase correlation, for the motion.)

The weights do not depend on the lights that the person is relit with, so relighting stays linear in them.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F

from relight.canvas import Canvas, Field, Maps
from relight.depth import Space
from shadow.directions import olat
from shadow.framing import affine_sample

AROUND = 2  # frames before and after that take part
ALIKE = 0.07  # difference in shading at which a frame counts 60 % of one that is equal
PROBES = torch.from_numpy(olat())[::4]  # lights under which frames are compared
REFINEMENTS = 3  # times that the motion between frames is corrected by less than a pixel
SMOOTH = 5  # canvas pixels, the side of the square over which differences are averaged


def steadied(canvas: Canvas, around: Iterable[Canvas], alike: float = ALIKE) -> Canvas:
    """A frame's canvas, averaged with those of the frames `around` it as far as they are `alike`.

    Raises ValueError where some frames' albedo was given and that of others was found.
    """
    around = list(around)
    if any((other.light is None) is not (canvas.light is None) for other in around):
        raise ValueError("around: expected an albedo given for all of the frames, or for none")
    probed = canvas.shading(PROBES)
    seen: list[tuple[Canvas, torch.Tensor | None, torch.Tensor]] = [
        (canvas, None, torch.ones(1, *canvas.known.shape))
    ]
    for other in around:
        matrix = _motion(canvas, other)
        seen.append((other, matrix, _weight(canvas, probed, other, matrix, alike)))
    frames, matrices, weights = zip(*seen, strict=True)
    total = torch.stack(weights).sum(dim=0)
    mean = _Mean(matrices, tuple(weight / total for weight in weights))
    return canvas._replace(
        normals=F.normalize(mean(frame.normals for frame in frames), dim=0),
        visibility=_MeanMaps(mean, tuple(frame.visibility for frame in frames)),
        shading=_MeanMaps(mean, tuple(frame.shading for frame in frames)),
        albedo=mean(frame.albedo for frame in frames),
        light=None if canvas.light is None else mean(frame.light for frame in frames),
        space=Space(canvas.space.camera, canvas.framing, _MeanDepth(mean, frames)),
    )


@dataclass(frozen=True)
class _Mean:
    """The weighted mean of maps (C, h, w), one a frame, each moved to where the person is on the canvas."""

    matrices: tuple[torch.Tensor | None, ...]
    weights: tuple[torch.Tensor, ...]  # (1, h, w), which sum to one

    def __call__(self, maps: Iterable[Any]) -> torch.Tensor:
        moved = map(_moved, maps, self.matrices)
        return torch.stack([weight * one for weight, one in zip(self.weights, moved, strict=True)]).sum(dim=0)


@dataclass(frozen=True)
class _MeanMaps:
    """The mean of what the frames have for light directions (D, 3)."""

    mean: _Mean
    maps: tuple[Maps, ...]

    def __call__(self, directions: torch.Tensor) -> torch.Tensor:
        return self.mean(maps(directions) for maps in self.maps)

    def field(self) -> Field:
        """One field that is nearly this mean: the mean of the frames' own maps, whatever the light.

        Frames are averaged where they agree; there the mean of functions is near the function of the means.
        """
        fields = [Field.of(maps) for maps in self.maps]
        silhouette = fields[0].silhouette

        def mean(name: str) -> torch.Tensor:
            maps = (field.silhouette.scatter(getattr(field, name)) for field in fields)
            return silhouette.take(self.mean(maps))

        normals, *others = map(mean, Field._fields[1:])
        return Field(silhouette, F.normalize(normals, dim=0), *others)

    def each(self, directions: torch.Tensor) -> torch.Tensor:
        """A direction a pixel (3, h, w), which goes to where the pixel is in each frame, to a map (h, w)."""
        moved = (_moved(directions, _inverse(matrix)) for matrix in self.mean.matrices)
        found = (
            maps.each(F.normalize(toward, dim=0))[None] for maps, toward in zip(self.maps, moved, strict=True)
        )
        return self.mean(found)[0]


@dataclass(frozen=True)
class _MeanDepth:
    """The mean of the frames' depths (h, w), worked out when it is asked for."""

    mean: _Mean
    frames: tuple[Canvas, ...]

    def __call__(self) -> torch.Tensor:
        depth = self.mean(frame.space.depth[None] for frame in self.frames)[0]
        return depth * self.frames[0].known


def _moved(maps: torch.Tensor, matrix: torch.Tensor | None) -> torch.Tensor:
    """Maps (C, h, w) of another canvas where they belong on this one."""
    return maps if matrix is None else affine_sample(maps, matrix, maps.shape[1:])


def _inverse(matrix: torch.Tensor | None) -> torch.Tensor | None:
    """(2, 3) from positions on the other canvas to those on this one."""
    if matrix is None:
        return None
    turned = torch.linalg.inv(matrix[:, :2])
    return torch.cat([turned, -turned @ matrix[:, 2:]], dim=1)


def _motion(canvas: Canvas, other: Canvas) -> torch.Tensor:
    """(2, 3) from a position on the canvas to where the same part of the person is on the other."""
    here, there = canvas.image * canvas.known, other.image * other.known

    def error(matrix: torch.Tensor) -> float:
        return float((_moved(there, matrix) - here).abs().mean())

    still = canvas.framing.onto(other.framing)
    jump = _translated(still, _shift(here, _moved(there, still)))
    best = min((still, jump), key=error)
    for _ in range(REFINEMENTS):
        best = min((best, _translated(best, _step(here, _moved(there, best)))), key=error)
    return best


def _translated(matrix: torch.Tensor, shift: torch.Tensor) -> torch.Tensor:
    """The matrix after a shift (2,) on the canvas that it comes from."""
    return torch.cat([matrix[:, :2], matrix[:, 2:] + matrix[:, :2] @ shift[:, None]], dim=1)


def _shift(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """(x, y) in whole pixels by which the content moved from one image (C, h, w) to the next."""
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


def _step(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """(x, y) by which the content moved, where that is less than a pixel (Lucas and Kanade 1981)."""
    gradients = torch.stack(torch.gradient(second, dim=(2, 1))).flatten(1)
    normal = gradients @ gradients.T + 1e-6 * torch.eye(2)
    return torch.linalg.solve(normal, gradients @ (first - second).flatten()).clamp(-1, 1)


def _weight(
    canvas: Canvas, probed: torch.Tensor, other: Canvas, matrix: torch.Tensor, alike: float
) -> torch.Tensor:
    """The weight (1, h, w) of another frame at each pixel: 1 where its shading is equal, 0 where unknown."""
    known = (_moved(other.known[None].float(), matrix) > 0.99) & canvas.known
    difference = (_moved(other.shading(PROBES), matrix) - probed).abs().amax(dim=0, keepdim=True)
    squared = _blurred(difference**2 * known) / _blurred(known.float()).clamp_min(1e-3)
    return known * torch.exp(-squared / (2 * alike**2))


def _blurred(image: torch.Tensor) -> torch.Tensor:
    return F.avg_pool2d(image, SMOOTH, stride=1, padding=SMOOTH // 2)
