"""The maps that the networks infer from one frame, on their canvas, and sums of lights over them."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple, Self

import numpy as np
import torch
import torch.nn.functional as F
from scipy.ndimage import distance_transform_edt

from relight.analysis.depth import WorldGeometry
from relight.analysis.gloss import Gloss
from relight.analysis.light_field import LightField, LightMaps
from relight.analysis.old_light import OldLight
from relight.lights.light import Light
from relight.lights.near import NearLight
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
            albedo = analysis.canvas_albedo.cpu()
            light = _photographed_light(analysis.framed.rgb.cpu(), albedo, known)
        normals, field = analysis.canvas_normals.cpu(), LightField.of(analysis)
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
        tint = old_light.tint(self.light, self.albedo, self.normals)
        return self._replace(albedo=(self.albedo / tint).clamp(0, 1), light=self.light * tint)

    def lit(self, lights: Iterable[Light]) -> torch.Tensor:
        """Return Σ intensity · shading (3, h, w).

        Raises ValueError for a near light that touches the person.
        """
        return self._summed(self.shading, lights)

    def reflected(self, lights: Iterable[Light]) -> torch.Tensor:
        """Return Σ intensity · gloss (3, h, w), see `relight.analysis.gloss`; raises as `lit` does."""
        return self._summed(Gloss.of(self.visibility, self.normals, self.known), lights)

    def _summed(self, maps: LightMaps, lights: Iterable[Light]) -> torch.Tensor:
        """Return Σ intensity · maps (3, h, w) over lights of all kinds."""
        several = list(lights)
        near = [light for light in several if isinstance(light, NearLight)]
        samples = [light.samples() for light in several if light not in near]
        total = weighted_sum(maps, samples, self.known.shape, channels=3)
        for light in near:
            self.check_outside(light)
            power = torch.from_numpy(np.float32(light.power))[:, None, None]
            total += power * near_sum(maps, light, self.geometry)[0]
        return total

    def unshadowed(self, light: Light) -> torch.Tensor:
        """Return the share (1, h, w) of a light that the person does not block, see `Subject.unshadowed`."""
        if isinstance(light, NearLight):
            lit, whole = near_sum(self.visibility, light, self.geometry)
            return (lit / whole.clamp_min(1e-30))[None]
        directions, powers = light.samples()
        if not powers.any():  # it is out: its visibility is that of the light when it is on
            on: Any = light  # every light is a dataclass with these fields
            directions, powers = replace(on, intensity=1, colour=(1, 1, 1), exposure=0).samples()
        weights = luminance(powers.astype(np.float64)).clip(0)
        if not weights.any():  # a black map
            weights = np.ones_like(weights)
        weights = weights / weights.sum()
        samples = [(directions, weights[:, None])]
        return weighted_sum(self.visibility, samples, self.known.shape, channels=1)

    def check_outside(self, light: NearLight) -> None:
        """Raise ValueError for a light that touches the person or lies inside.

        The far side of the person is not seen. A limb is taken to be about as thick as it is wide.
        """
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


def weighted_sum(
    maps: LightMaps, samples: Iterable[tuple[np.ndarray, np.ndarray]], shape: torch.Size, channels: int
) -> torch.Tensor:
    """Return Σ power · maps(direction) on the canvas, (channels, h, w).

    `samples` are pairs of directions (D, 3) and powers (D, channels). The channels of the result lie together
    in memory, as the lookup of the upsampling wants them.
    """
    total = torch.zeros(shape.numel(), channels)
    for directions, powers in samples:
        batches = (
            torch.from_numpy(np.float32(values)).split(DIRECTIONS_PER_BATCH)
            for values in (directions, powers)
        )
        for batch, power in zip(*batches, strict=True):
            total.addmm_(maps(batch).flatten(1).T, power)
    return total.T.unflatten(1, shape)


def near_sum(maps: LightMaps, light: NearLight, geometry: WorldGeometry) -> tuple[torch.Tensor, torch.Tensor]:
    """Return Σ irradiance · maps over the samples of a near light, and Σ irradiance: (h, w) each.

    Both are for intensity 1. The second is the irradiance of a surface that faces each sample, unblocked.
    """
    lit = whole = torch.zeros(geometry.framing.canvas)
    for directions, irradiance in light.rays(geometry.positions):
        lit, whole = lit + irradiance * maps.per_pixel(directions), whole + irradiance
    return lit, whole


def _photographed_light(framed: torch.Tensor, albedo: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
    """Return the light in which the person was photographed, on the canvas (3, h, w): image over albedo.

    Least squares of image = light · albedo over 3 x 3 pixels, in two steps. First one light for all three
    colours, drawn toward the mean where the albedo is too dark to tell. Then each colour by itself, drawn
    toward the first: a colour that a material hardly reflects gets the light of the others. The result is
    positive everywhere on the person.
    """
    mean = (framed[:, known].mean() / albedo[:, known].mean().clamp_min(1e-6)).clamp_min(1e-6)
    explained, squared = (
        F.avg_pool2d(product * known, 3, stride=1, padding=1) for product in (framed * albedo, albedo**2)
    )
    grey = (explained.mean(dim=0) + DARK_ALBEDO * mean) / (squared.mean(dim=0) + DARK_ALBEDO)
    light = (explained + DARK_ALBEDO * grey) / (squared + DARK_ALBEDO)
    return torch.maximum(light, MIN_LIGHT_SHARE * mean)
