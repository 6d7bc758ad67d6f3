"""The depth of a person on the networks' canvas, from one of three sources, and their positions in the world.

Depth is in metres along the camera's axis, from the subject's middle, larger farther away. It is integrated
from the normals, provided by the caller in metres, or a network's relative depth, aligned with that of the
normals.
"""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from relight.analysis.camera import DEFAULT_HEIGHT, Camera, canvas_grid
from relight.analysis.normal_integration import integrate
from relight.media.images.arrays import as_array
from shadow import inputs
from shadow.analysis import Analysis
from shadow.framing import Framing, bounding_box

MIN_CORRELATION = 0.2  # of relative depth with that of the normals: below it, it shows another picture
MAX_DEPTH = 1e6  # metres, of depth that the caller provides; renderers write more where there is nothing
MIN_COVERAGE = 0.5  # above it a pixel of provided depth is the person's

DepthSource = Callable[
    [], torch.Tensor
]  # computes depth (h, w) on the canvas, metres from the subject's middle


class WorldGeometry:
    """Where the person of a frame is in the world, on the networks' canvas; computed when first asked for."""

    def __init__(self, camera: Camera, framing: Framing, source: DepthSource) -> None:
        """Take the placement of the canvas on the whole plate, and the function that computes the depth."""
        self.camera, self.framing, self._source = camera, framing, source

    @classmethod
    def of(
        cls,
        analysis: Analysis,
        camera: Camera,
        framing: Framing,
        matte: torch.Tensor,
        provided: torch.Tensor | None = None,
        relative: bool = False,
        own_normals: bool = True,
    ) -> "WorldGeometry":
        """Choose the source of the depth of an analysed person.

        `camera` and the matte (H, W) are the plate's, and `framing` places the canvas on it. `provided`: (1,
        H, W) depth of the plate that replaces that of the normals, in metres or, if `relative`, known up to
        scale and offset only, either sign. `own_normals`: whether the normals are the network's. Those that
        the caller provided are integrated without the network's depth as an anchor, since that belongs to the
        network's normals.
        """
        known, anchor = analysis.framed.mask.cpu() > 0.5, analysis.canvas_depth if own_normals else None
        if anchor is not None:
            top, _, bottom, _ = bounding_box(matte)
            anchor = anchor.cpu() * (bottom - top) * camera.metres_per_pixel
        integrated = IntegratedDepth(camera, framing, analysis.canvas_normals.cpu(), known, anchor)
        if provided is None:
            return cls(camera, framing, integrated)
        provided = provided.cpu()
        # The mean of a canvas pixel is weighted by the matte: the background's depth takes no part. Renderers
        # do not filter depth at edges, where a pixel of less than half coverage may have the depth behind.
        weight = matte if relative else torch.where(matte > MIN_COVERAGE, matte, 0.0)
        shares = framing.crop(torch.cat([provided * weight, weight[None]]))
        depth = shares[0] / shares[1].clamp_min(1e-6)
        source = AlignedDepth(depth, known, integrated) if relative else ProvidedDepth(depth, known)
        return cls(camera, framing, source)

    @cached_property
    def depth(self) -> torch.Tensor:
        """(h, w) metres from the subject's middle along the camera's axis; zero off the person."""
        if self.camera.guessed:
            warnings.warn(
                "height: the frame cuts the person, and no height is given: taken to show "
                f"{DEFAULT_HEIGHT} m",
                stacklevel=2,
            )
        return self._source()

    @cached_property
    def positions(self) -> torch.Tensor:
        """(3, h, w) metres from the subject's middle; off the person, at the middle's depth."""
        return self.camera.positions(*canvas_grid(self.framing), self.depth)

    @property
    def metres_per_pixel(self) -> float:
        """Metres that a pixel of the canvas spans at the subject's middle."""
        return self.camera.metres_per_pixel / self.framing.scale

    def pixel_at(self, position: np.ndarray) -> tuple[int, int]:
        """Return the canvas pixel (row, column), perhaps beyond the canvas, that shows a position (3,).

        Raises ValueError for a position at the camera or behind it.
        """
        x, y = self.camera.on_plate(position)
        (height, width), scale = self.framing.canvas, self.framing.scale
        row = (y - self.framing.centre[1]) * scale + height / 2
        column = (x - self.framing.centre[0]) * scale + width / 2
        limit = 2.0**31  # a position beside the camera projects to infinity
        return math.floor(min(max(row, -limit), limit)), math.floor(min(max(column, -limit), limit))


@dataclass(frozen=True)
class IntegratedDepth:
    """Depth (h, w) that is integrated from normals."""

    camera: Camera
    framing: Framing
    normals: torch.Tensor  # (3, h, w)
    known: torch.Tensor  # (h, w) bool: shows the person
    anchor: torch.Tensor | None = None  # (h, w) metres, whose low frequencies the result keeps

    def __call__(self) -> torch.Tensor:
        rays = self.camera.rays(*canvas_grid(self.framing))
        focal = self.camera.focal * self.framing.scale
        anchor = None if self.anchor is None else (self.anchor / self.camera.distance).clamp_min(-0.9).log1p()
        ratios = integrate(self.normals, self.known, rays, focal, anchor)
        return centred(self.camera.distance * ratios.exp(), self.known)


@dataclass(frozen=True)
class ProvidedDepth:
    """Depth (h, w) in metres that the caller, or a file, provides; its offset does not matter."""

    depth: torch.Tensor
    known: torch.Tensor  # (h, w) bool: shows the person

    def __call__(self) -> torch.Tensor:
        return centred(self.depth, self.known)


@dataclass(frozen=True)
class AlignedDepth:
    """A network's relative depth (h, w), scaled to the depth of the normals, with either sign."""

    depth: torch.Tensor
    known: torch.Tensor  # (h, w) bool: shows the person
    reference: IntegratedDepth

    def __call__(self) -> torch.Tensor:
        metres, relative = self.reference()[self.known], self.depth[self.known]
        # Both have errors. The ratio of their standard deviations is not biased to zero, as a
        # regression is.
        correlation = float(torch.corrcoef(torch.stack([metres, relative]))[0, 1].nan_to_num())
        if abs(correlation) < MIN_CORRELATION:
            raise ValueError(
                "depth: does not go with the person's normals, neither as it is nor turned over "
                f"(correlation {correlation:.2f}); expected the depth of this photograph"
            )
        scale = math.copysign(float(metres.std() / relative.std()), correlation)
        return centred(self.depth * scale, self.known)


def centred(depth: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
    """Return depth (h, w) minus its median over the person; zero elsewhere."""
    return torch.where(known, depth - depth[known].median(), 0.0)


def checked_depth(depth: inputs.Array, matte: torch.Tensor) -> torch.Tensor:
    """Return the caller's depth as (1, H, W): float32 metres, or int32 for a picture of relative depth.

    The matte (H, W) shows where the person is. Elsewhere renderers write infinity or a large number, which is
    ignored. Raises TypeError or ValueError for another dtype or shape, and for NaN, infinity or more than
    MAX_DEPTH on the person.
    """
    values, size = as_array("depth", depth), tuple(matte.shape)
    picture = values.dtype in (np.uint8, np.uint16)
    if not picture and not np.issubdtype(values.dtype, np.floating):
        expected = "metres as floats, or a picture as uint8 or uint16"
        raise TypeError(f"depth: expected {expected}, got {values.dtype}")
    if values.shape != size:
        raise ValueError(f"depth: expected shape {size}, the size of the image, got {values.shape}")
    known = np.isfinite(values) & (np.abs(values) <= MAX_DEPTH)
    if (~known & (matte.cpu().numpy() > MIN_COVERAGE)).any():
        raise ValueError(
            f"depth: contains NaN, infinite values or more than {MAX_DEPTH:g} metres where the person is"
        )
    return torch.from_numpy(np.where(known, values, 0).astype(np.int32 if picture else np.float32))[None]
