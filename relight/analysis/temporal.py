"""A bilateral filter in time: a frame's maps, averaged along the motion with those of the frames around it.

The networks see each frame by itself, and their errors flicker a little as the person moves. The maps of the
frames before and after are moved along the optical flow of the photographs. A pixel of them counts less where
the flow does not lead back, where the photographs differ, and where their shading differs much, under lights
from all around. Flicker averages out. A shadow that moves over the person, and what a limb uncovers, keep
their own frame's maps. (Tomasi and Manduchi 1998, for the filter.)

The weights do not depend on the lights of the relit picture, which stays linear in them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch
import torch.nn.functional as F

from relight.analysis.depth import WorldGeometry
from relight.analysis.light_field import LightField
from relight.analysis.maps import AnalysisMaps
from relight.media.optical_flow import Motion, motion
from shadow.directions import olat
from shadow.framing import affine_sample

SHADING_SIGMA = 0.3  # difference in shading at which a frame's weight falls to 60 %
COLOUR_SIGMA = 0.1  # difference of encoded colour at which it does
PROBE_LIGHTS = torch.from_numpy(olat())[::4]  # under which frames are compared
WINDOW = 5  # canvas pixels, the side of the square over which differences are averaged


def temporally_filtered(
    maps: AnalysisMaps, neighbours: Iterable[AnalysisMaps], shading_sigma: float = SHADING_SIGMA
) -> AnalysisMaps:
    """Average a frame's maps with those of frames before and after it, along the motion.

    `shading_sigma`: difference in shading, in [0, 1], at which a neighbour's weight falls to 60 %. Raises
    ValueError if the albedo was provided for some of the frames and inferred for others, and ImportError
    without OpenCV.
    """
    neighbours = list(neighbours)
    if not neighbours:
        return maps
    if any((other.light is None) is not (maps.light is None) for other in neighbours):
        raise ValueError("around: expected an albedo given for all of the frames, or for none")
    probed = maps.shading(PROBE_LIGHTS)
    motions = [_motion(maps, other) for other in neighbours]
    weights = [torch.ones(1, *maps.known.shape)]
    weights += [_weight(maps, probed, *pair, shading_sigma) for pair in zip(neighbours, motions, strict=True)]
    total = torch.stack(weights).sum(dim=0)
    frames = [maps, *neighbours]
    lights = [frame.light for frame in frames if frame.light is not None]  # of all, or of none
    mean = _AlignedMean((None, *motions), tuple(weight / total for weight in weights))
    return maps._replace(
        normals=F.normalize(mean(frame.normals for frame in frames), dim=0),
        field=mean.field([frame.field for frame in frames]),
        albedo=mean(frame.albedo for frame in frames),
        light=mean(lights) if lights else None,
        geometry=WorldGeometry(maps.geometry.camera, maps.framing, _MeanDepth(mean, frames)),
    )


@dataclass(frozen=True)
class _AlignedMean:
    """The weighted mean of the frames' maps (C, h, w), each moved onto this frame's canvas."""

    motions: tuple[Motion | None, ...]  # from this canvas to each frame's; None for its own
    weights: tuple[torch.Tensor, ...]  # (1, h, w), which sum to one

    def __call__(self, maps: Iterable[torch.Tensor]) -> torch.Tensor:
        frames = zip(maps, self.motions, self.weights, strict=True)
        moved = [weight * (own if way is None else way.moved(own)) for own, way, weight in frames]
        return torch.stack(moved).sum(dim=0)

    def field(self, fields: Sequence[LightField]) -> LightField:
        """Return the weighted mean of the arrays of the frames' fields, at the pixels of this frame's.

        Frames are averaged where they agree. There the function of the means is near the mean of functions.
        """
        own, *others = fields
        silhouette = own.silhouette
        total = own.rows * silhouette.take(self.weights[0]).T
        for other, way, weights in zip(others, self.motions[1:], self.weights[1:], strict=True):
            assert way is not None
            weight = silhouette.take(weights)[0]
            taking = weight.nonzero()[:, 0]
            positions = silhouette.take(way.positions)[:, taking]
            total.index_add_(0, taking, weight[taking, None] * other.sampled(positions))
        return own.with_rows(total)


@dataclass(frozen=True)
class _MeanDepth:
    """The mean of the frames' depths (h, w), computed when it is asked for."""

    mean: _AlignedMean
    frames: Sequence[AnalysisMaps]

    def __call__(self) -> torch.Tensor:
        depth = self.mean(frame.geometry.depth[None] for frame in self.frames)[0]
        return depth * self.frames[0].known


def _motion(maps: AnalysisMaps, other: AnalysisMaps) -> Motion:
    """Return the motion from this frame's canvas to the other's, which may be elsewhere on the plate."""
    matrix = maps.framing.onto(other.framing)
    image = affine_sample(other.image, matrix, maps.known.shape)
    moving, still = motion(maps.image, image), Motion.none(maps.known.shape)
    # On a smooth surface, noise moves the flow at random: where standing still explains the photograph as
    # well, nothing moves.
    moved, unmoved = (
        _box_mean(((way.moved(image) - maps.image) ** 2).mean(0, True)) for way in (moving, still)
    )
    stands = unmoved <= moved
    positions = torch.where(stands, still.positions, moving.positions)
    positions = torch.einsum("ij,jhw->ihw", matrix[:, :2], positions) + matrix[:, 2:, None]
    return Motion(positions, torch.where(stands, still.certainty, moving.certainty))


def _weight(
    maps: AnalysisMaps, probed: torch.Tensor, other: AnalysisMaps, way: Motion, shading_sigma: float
) -> torch.Tensor:
    """Return the weight (1, h, w) of another frame: 1 where it shows the same, 0 where it is unknown."""
    known = (way.moved(other.known[None]) > 0.99) & maps.known
    shading = (way.moved(other.shading(PROBE_LIGHTS)) - probed).abs().amax(dim=0, keepdim=True)
    colour = (way.moved(other.image) - maps.image).abs().mean(dim=0, keepdim=True)
    differences = (shading / shading_sigma) ** 2 + (colour / COLOUR_SIGMA) ** 2
    inside = _box_mean(known.float()).clamp_min(1e-3)
    return known * way.certainty * torch.exp(-_box_mean(differences * known) / inside / 2)


def _box_mean(image: torch.Tensor) -> torch.Tensor:
    return F.avg_pool2d(image, WINDOW, stride=1, padding=WINDOW // 2)
