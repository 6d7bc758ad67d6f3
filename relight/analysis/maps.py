"""The maps that the networks infer from one frame, on their canvas, and sums of lights over them."""

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np
import torch
import torch.nn.functional as F
from scipy.ndimage import distance_transform_edt

from relight.analysis import confidence, highlights
from relight.analysis.depth import WorldGeometry
from relight.analysis.light_field import LightField, LightMaps
from relight.analysis.old_light import OldLight
from relight.analysis.skin import Skin
from relight.lights.light import Light, Rays
from relight.media.colour import luminance
from shading import Analysis
from shadow.framing import Framing

DARK_ALBEDO = 1e-3  # squared albedo at which half of the photographed light is taken from around
MIN_LIGHT_SHARE = 0.02  # least photographed light, as a share of the mean: bounds the noise of delighting
LIMB_DEPTH = 1.5  # least depth of a limb over its distance to the rim; 2 in the middle of a round limb
DIRECTIONS_PER_BATCH = 64


class AnalysisMaps(NamedTuple):
    """What the networks infer from one frame, on their canvas of h x w pixels, in CPU memory."""

    framing: Framing  # of the canvas on the plate
    known: torch.Tensor  # (h, w) bool: shows the person
    image: torch.Tensor  # (3, h, w) the photograph as a guide, display-encoded, in about [0, 1]
    normals: torch.Tensor  # (3, h, w) unit vectors, camera frame
    field: LightField  # visibility and shading
    albedo: torch.Tensor  # (3, h, w) linear, in [0, 1]
    light: torch.Tensor | None  # (3, h, w) linear, that of the photograph; None if the albedo was provided
    geometry: WorldGeometry

    @classmethod
    def of(
        cls, analysis: Analysis, image: torch.Tensor, albedo: torch.Tensor | None, geometry: WorldGeometry
    ) -> "AnalysisMaps":
        """Collect the maps of an analysis on any device.

        `image` (3, h, w) is display-encoded. `albedo` (3, h, w) replaces the inferred one. The framing of
        `geometry` is that of the canvas on the whole plate.
        """
        known, light = analysis.framed.mask.cpu() > 0.5, None
        if albedo is None:
            assert analysis.canvas_albedo is not None
            albedo = analysis.canvas_albedo.cpu()
            light = photographed_light(analysis.framed.rgb.cpu(), albedo, known)
        normals, field = analysis.canvas_normals.cpu(), LightField.of(analysis, geometry.framing)
        return cls(geometry.framing, known, image, normals, field, albedo, light, geometry)

    @property
    def visibility(self) -> LightMaps:
        """Visibility as a function of the light's direction."""
        return self.field.visibility

    @property
    def shading(self) -> LightMaps:
        """Diffuse shading as a function of the light's direction."""
        return self.field.shading

    def without_tint(self, old_light: OldLight) -> Self:
        """Return the maps with an inferred albedo that lacks the colour of the photograph's light."""
        if self.light is None:
            return self
        tint = old_light.tint(self.light, self.albedo, self.normals, self.known)
        return self._replace(albedo=bounded(self.albedo / tint), light=self.light * tint)

    def without_highlights(self, seen: Skin) -> Self:
        """Return the maps with an inferred albedo without the highlights on skin."""
        if self.light is None:
            return self
        colour = highlights.tint(self.albedo, self.image, seen)
        return self._replace(albedo=bounded(self.albedo / colour), light=self.light * colour)

    def lightened(self, factor: float) -> Self:
        """Return the maps with an inferred albedo of `factor` times the lightness, in as much less light."""
        if self.light is None or factor == 1:
            return self
        return self._replace(albedo=bounded(self.albedo * factor), light=self.light / factor)

    def lit(self, lights: Iterable[Light]) -> torch.Tensor:
        """Return Σ intensity · shading (3, h, w).

        Raises ValueError for a near light that touches the person.
        """
        return self._summed(self.shading, lights)

    def reflected(self, lights: Iterable[Light]) -> torch.Tensor:
        """Return Σ intensity · gloss (3, h, w), see `relight.analysis.gloss`; raises as `lit` does."""
        return self._summed(self.field.gloss, lights)

    def _summed(self, maps: LightMaps, lights: Iterable[Light]) -> torch.Tensor:
        """Return Σ intensity · maps (3, h, w) over lights of all kinds."""
        total = torch.zeros(self.known.numel(), 3)  # a pixel's channels side by side, as upsampling wants
        for light in sorted(lights, key=lambda light: light.is_near):
            self.check_outside(light)
            add_light(total, maps, light, self._positions_for(light))
        return total.T.unflatten(1, self.known.shape)

    def unshadowed(self, light: Light) -> torch.Tensor:
        """Return the share (1, h, w) of a light that the person does not block, see `Subject.unshadowed`."""
        return self._mean(self.visibility, light)

    def confidence(self, light: Light | None = None) -> torch.Tensor:
        """Return the confidence (1, h, w) in a light's visibility, or in that of all directions."""
        if light is None:
            return confidence.overall(self.field)[None]
        return 1 - self._mean(confidence.Doubt(self.visibility), light)

    def _mean(self, maps: LightMaps, light: Light) -> torch.Tensor:
        """Return the mean (1, h, w) of maps over a light's directions, weighted by the light from there."""
        if light.is_near:
            lit, whole = near_sum(maps, light.rays(self.geometry.positions))
            return (lit / whole.clamp_min(1e-30))[None]
        if not light.power.any():  # it is out: its visibility is that of the light when it is on
            light = replace(light, intensity=1, colour=(1, 1, 1), exposure=0)
        ((directions, intensities),) = light.rays(self._positions_for(light))
        powers = (intensities.numpy() * light.power).astype(np.float32)
        weights = luminance(powers.astype(np.float64)).clip(0)
        if not weights.any():  # a black map
            weights = np.ones_like(weights)
        shares = torch.from_numpy(np.float32(weights / weights.sum()))[:, None]
        total = torch.zeros(self.known.numel(), 1)
        add_parallel(total, maps, directions, shares)
        return total.T.unflatten(1, self.known.shape)

    def _positions_for(self, light: Light) -> torch.Tensor:
        """Return the positions (3, h, w) that a near light needs; of no pixel for others.

        Depth is integrated only where it is needed: that takes as long as a network.
        """
        return self.geometry.positions if light.is_near else torch.empty(3, 0)

    def check_outside(self, light: Light) -> None:
        """Raise ValueError for a near light that touches the person or lies inside.

        The far side of the person is not seen. A limb is taken to be about as thick as it is wide.
        """
        if not light.is_near or not self.known.any():
            return
        geometry, known = self.geometry, self.known
        name, surface = light.name or "light", geometry.positions[:, known]
        for point in light.points:
            gap = float((surface - torch.tensor(point, dtype=torch.float32)[:, None]).norm(dim=0).min())
            if gap <= max(light.extent, geometry.metres_per_pixel / 2):
                raise ValueError(f"{name}: position: touches the person; expected a light beside them")
            if point[2] >= geometry.camera.distance:  # at the camera or behind it: no pixel shows it
                continue
            row, column = geometry.pixel_at(point)
            if not (0 <= row < len(known) and 0 <= column < known.shape[1] and known[row, column]):
                continue
            behind = -point[2] - float(geometry.depth[row, column])
            rim = distance_transform_edt(np.pad(known.numpy(), 1, mode="edge"))[row + 1, column + 1]
            if 0 < behind < LIMB_DEPTH * rim * geometry.metres_per_pixel:
                raise ValueError(
                    f"{name}: position: is inside the person, {behind:.2f} m behind what is seen of them "
                    "there; expected a light outside"
                )


def bounded(albedo: torch.Tensor, dim: int = 0) -> torch.Tensor:
    """Return an albedo in [0, 1] whose colour is kept where a channel, of the axis `dim`, exceeded 1."""
    albedo = albedo.clamp_min(0)
    return albedo / albedo.amax(dim=dim, keepdim=True).clamp_min(1)


def add_light(total: torch.Tensor, maps: LightMaps, light: Light, positions: torch.Tensor) -> None:
    """Add Σ power · irradiance · maps(direction), over a light's rays, to `total` (h w, 3)."""
    rays = light.rays(positions)
    if light.is_near:
        power = torch.from_numpy(np.float32(light.power))
        total += near_sum(maps, rays)[0].flatten()[:, None] * power
        return
    for directions, intensities in rays:
        with np.errstate(over="ignore"):  # infinite values are refused where the light is used
            powers = (intensities.numpy() * light.power).astype(np.float32)
        add_parallel(total, maps, directions, torch.from_numpy(powers))


def add_parallel(
    total: torch.Tensor, maps: LightMaps, directions: torch.Tensor, powers: torch.Tensor
) -> None:
    """Add Σ power · maps(direction) to `total` (h w, C), for directions (K, 3) and powers (K, C)."""
    batches = (values.split(DIRECTIONS_PER_BATCH) for values in (directions, powers))
    for batch, power in zip(*batches, strict=True):
        total.addmm_(maps(batch).flatten(1).T, power)


def near_sum(maps: LightMaps, rays: Iterable[Rays]) -> tuple[torch.Tensor, torch.Tensor]:
    """Return Σ irradiance · maps over the rays of a near light, and Σ irradiance: (h, w) each.

    Both are for a power of 1. The second is the irradiance of a surface that faces each ray, unblocked.
    """
    lit = whole = torch.zeros(())
    for directions, irradiance in rays:
        lit, whole = lit + irradiance * maps.per_pixel(directions), whole + irradiance
    return lit, whole


def photographed_light(framed: torch.Tensor, albedo: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
    """Return the light in which the person was photographed, on the canvas (3, h, w): image over albedo.

    It is grey, as the network's gain is: least squares of image = light · albedo over the colours of 3 x 3
    pixels, drawn toward the mean where the albedo is too dark to tell. It is positive everywhere.
    """
    mean = (framed[:, known].mean() / albedo[:, known].mean().clamp_min(1e-6)).clamp_min(1e-6)
    products = torch.stack([framed * albedo, albedo**2]).mean(dim=1) * known
    explained, squared = F.avg_pool2d(products, 3, stride=1, padding=1)
    light = (explained + DARK_ALBEDO * mean) / (squared + DARK_ALBEDO)
    return torch.maximum(light, MIN_LIGHT_SHARE * mean).expand_as(framed)
