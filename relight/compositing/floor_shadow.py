"""The shadow of the person on the floor.

The irradiance of a point of the floor is the sum over the samples of all lights of power, cosine and
visibility. A sample is visible unless the person, a `relight.compositing.shadow_caster.ShadowCaster`, is in
between. The floor's material and its light in the plate are not known. So its picture is multiplied by the
ratio of the irradiance with the person to that without them.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F

from relight.compositing.floor import Floor, Plane, PlateCamera
from relight.compositing.shadow_caster import CasterSilhouette, ShadowCaster, pixel_spacing
from relight.lights.light import Light

MAX_LOOKUPS = 2**23  # in silhouettes, for one light: more samples are looked up on a coarser grid of pixels
COARSE_METRES = 0.015  # between the points of a shadow caster for one of many samples


class LightSample(NamedTuple):
    """A point that stands for a part of a light."""

    light: torch.Tensor  # (4,) homogeneous position, see `CasterSilhouette`
    power: torch.Tensor  # (3,) linear Rec.709
    radius: float = 0.0  # of the part that it stands for: radians, or metres for a near light
    axis: torch.Tensor | None = None  # (3,) in which a near light shines most; None for all directions
    spotlight: Light | None = None  # whose cone it keeps within

    def reaches(self, plane: Plane) -> bool:
        """Return whether it lights the plane from above."""
        return float(plane.normal @ self.light[:3] + plane.below * self.light[3]) > 1e-6

    def irradiance(self, plane: Plane, points: torch.Tensor) -> torch.Tensor:
        """Return the unblocked irradiance of a plane, (3,), or (h, w, 3) at points for a near light."""
        if not self.light[3]:
            return self.power * (plane.normal @ self.light[:3]).clamp_min(0)
        vector = self.light[:3] - points
        squared = (vector * vector).sum(dim=-1)
        irradiance = (vector @ plane.normal).clamp_min(0) / squared**1.5
        if self.axis is not None:
            irradiance = irradiance * -(vector @ self.axis).clamp_max(0) / squared.sqrt()
        if self.spotlight is not None:
            leaving = (-vector / squared.sqrt()[..., None]).movedim(-1, 0)
            irradiance = irradiance * self.spotlight.transmission(leaving)
        return irradiance[..., None] * self.power

    def blur(self, rays: torch.Tensor, factors: torch.Tensor) -> torch.Tensor | None:
        """Return the blur (P,) of the shadow of points, see `CasterSilhouette`, from what `project_to_plane`
        returns.

        The standard deviation of a disc along one axis is half its radius.
        """
        if not self.radius:
            return None
        factors = torch.where(factors.isinf(), 0.0, factors)
        if not self.light[3]:
            return self.radius / 2 * factors
        return self.radius / 2 / rays.norm(dim=1).clamp_min(1e-6) * factors / (1 + factors)


class FloorShadow(NamedTuple):
    """The shadow of a person on their floor."""

    camera: PlateCamera
    plane: Plane
    caster: ShadowCaster
    distance_scale: float  # factor of the person's distance with which their soles touch the floor

    @classmethod
    def of(
        cls, floor: Floor, camera: PlateCamera, positions: torch.Tensor, known: torch.Tensor, cut: bool
    ) -> "FloorShadow":
        """Put a person on a floor, before the plate's camera.

        `positions`: (3, h, w) metres from the subject's middle, what the camera sees of the person, where
        `known` (h, w) is true. `cut`: whether the frame cuts the feet off.
        """
        positions = positions + middle(camera)[:, None, None]
        points = positions[:, known]
        plane = floor.plane(camera, points)
        scale = 1.0
        if not cut:
            scale = floor.distance_scale(points, plane, camera, pixel_spacing(positions, known))
        return cls(camera, plane, ShadowCaster.of(positions * scale, known), scale)

    def shadows(self, lights: Mapping[str, Light]) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Return the shadow of each light and of all, see `relight.Subject.shadows`."""
        shadows, full, blocked = {}, torch.zeros(3), torch.zeros(*self.camera.size, 3)
        for name, light in lights.items():
            unblocked, lost = self.irradiance(_samples(light, self.camera))
            shadows[name] = _ratio(unblocked, lost)
            full, blocked = full + unblocked, blocked + lost
        return shadows, _ratio(full, blocked)

    def irradiance(self, samples: list[LightSample]) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the floor's irradiance without the person, and the part of it that they block.

        Both are (H, W, 3), zero above the horizon; the first is (3,) if it is the same everywhere.
        """
        samples = [sample for sample in samples if sample.reaches(self.plane)]
        top = self.plane.horizon(self.camera)
        pixels = (self.camera.size[0] - top) * self.camera.size[1]
        step = max(1, round(math.sqrt(pixels * len(samples) / MAX_LOOKUPS)))
        points = self.plane.visible_points(self.camera, step)
        sharp = len(samples) == 1 and samples[0].radius == 0
        caster = self.caster if sharp else self.caster.coarser(COARSE_METRES)
        full, blocked = torch.zeros(3), torch.zeros(points.shape)
        for sample in samples:
            arriving = sample.irradiance(self.plane, points)
            full = full + arriving
            rays, factors = self.plane.project_to_plane(caster.points, sample.light)
            part = self._shadowed_part(caster.points, rays, factors, sample.radius, top, step)
            if part is not None:
                silhouette = CasterSilhouette(caster, sample.light, sample.blur(rays, factors))
                hidden = silhouette.at(points[part])[..., None]
                blocked[part] += hidden * (arriving if arriving.ndim == 1 else arriving[part])
        size = self.camera.size
        full = full if full.ndim == 1 else _enlarged(full, top, step, size)
        return full, _enlarged(blocked, top, step, size)

    def _shadowed_part(
        self,
        points: torch.Tensor,
        rays: torch.Tensor,
        factors: torch.Tensor,
        radius: float,
        top: int,
        step: int,
    ) -> tuple[slice, slice] | None:
        """Return the part of `Plane.visible_points` that the shadow of points can reach; None if none."""
        falls = factors.isfinite()
        shadow = (points + rays * factors[:, None])[falls]
        if not len(shadow):
            return None
        spread = 2 * radius * float(factors[falls].max()) + self.caster.spacing
        if float(shadow[:, 2].max()) > -spread - 0.1:  # some of it is behind the camera
            return slice(None), slice(None)
        (height, width), focal = self.camera.size, self.camera.focal
        places = shadow[:, :2] / -shadow[:, 2:] * focal * torch.tensor([1, -1])
        margin = spread * focal / float(-shadow[:, 2].max())
        places = places + torch.tensor([width / 2, height / 2 - top])
        low, high = (
            ((places.amin(dim=0) - margin) / step).floor(),
            ((places.amax(dim=0) + margin) / step).ceil(),
        )
        (left, up), (right, down) = low.clamp_min(0).long().tolist(), high.clamp_min(0).long().tolist()
        seen = -(-(height - top) // step), -(-width // step)
        part = slice(up, min(down, seen[0])), slice(left, min(right, seen[1]))
        return None if any(side.start >= side.stop for side in part) else part


def _samples(light: Light, camera: PlateCamera) -> list[LightSample]:
    """Return the samples of a light, the camera at the origin."""
    parts = light.parts()
    places = torch.from_numpy(parts.places)
    places[:, :3] += places[:, 3:] * middle(camera)  # directions stay
    axis = None if light.flat_axis is None else torch.from_numpy(np.float32(light.flat_axis))
    spotlight = None if light.cone_axis is None else light
    each = zip(places, torch.tensor(parts.powers), parts.radii, strict=True)
    return [LightSample(place, power, float(radius), axis, spotlight) for place, power, radius in each]


def middle(camera: PlateCamera) -> torch.Tensor:
    """Return the subject's middle (3,) in metres, the camera at the origin."""
    return camera.rays(*torch.tensor(camera.middle)) * camera.distance


def _enlarged(values: torch.Tensor, top: int, step: int, size: tuple[int, int]) -> torch.Tensor:
    """Enlarge values (h, w, 3), on a grid of `step` pixels below row `top`, to a picture (H, W, 3)."""
    picture = torch.zeros(*size, 3)
    if values.numel():
        fine = values.permute(2, 0, 1)[None]
        if step > 1:
            fine = F.interpolate(fine, scale_factor=step, mode="bilinear", align_corners=False)
        picture[top:] = fine[0, :, : size[0] - top, : size[1]].permute(1, 2, 0)
    return picture


def _ratio(full: torch.Tensor, blocked: torch.Tensor) -> np.ndarray:
    """Return the share of light that is left (H, W, 3); 1 where there is no light."""
    share = torch.where(full > 0, blocked / full.clamp_min(1e-30), 0.0)
    return (1 - share).clamp(0, 1).numpy()
