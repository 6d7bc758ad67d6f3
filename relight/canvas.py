"""What the networks found of one frame, on their canvas, and sums of lights there."""

from collections.abc import Iterable
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
import torch
import torch.nn.functional as F
from scipy.ndimage import distance_transform_edt

from relight.depth import Space
from relight.lights.light import Light
from relight.lights.near import NearLight
from relight.media.colour import luminance
from shading import Analysis
from shading.diffuse import Shading
from shadow.directions import olat
from shadow.framing import Framing
from shadow.networks.field import FieldMaps, Visibility
from shadow.networks.mirror import Pixels

DARK = 1e-3  # squared albedo at which the photographed shading is as much guess as measurement
DEEPEST = 0.02  # least photographed shading, as a share of the mean: bounds the noise that delighting lifts
THICK = 1.5  # how deep a limb surely is, over the distance to its rim: 2 in the middle of a round one
BATCH = 64  # directions at a time


class Maps(Protocol):
    """What the networks found, as a function of light."""

    def __call__(self, directions: torch.Tensor) -> torch.Tensor:
        """Unit directions (D, 3) to maps (D, h, w) in [0, 1]."""

    def each(self, directions: torch.Tensor) -> torch.Tensor:
        """A unit direction a pixel (3, h, w) to a map (h, w) in [0, 1]."""


class Canvas(NamedTuple):
    """What the networks found of one frame, on their canvas of h x w pixels, in the computer's own memory."""

    framing: Framing  # where the canvas lies on the plate
    known: torch.Tensor  # (h, w) bool: shows the subject
    image: torch.Tensor  # (3, h, w) the photograph, display-encoded, in about [0, 1]
    normals: torch.Tensor  # (3, h, w) unit vectors
    visibility: Maps
    shading: Maps
    albedo: torch.Tensor  # (3, h, w) linear, in [0, 1]
    light: torch.Tensor | None  # (3, h, w) in which it was photographed; None if the albedo is given
    space: Space  # where the person is in the room

    @classmethod
    def of(
        cls, analysis: Analysis, image: torch.Tensor, albedo: torch.Tensor | None, space: Space
    ) -> "Canvas":
        """From an analysis on any device. `image` is display-encoded; `albedo` (3, h, w) takes the place of
        what was inferred; `space` says where the canvas lies on the whole plate."""
        known, light = analysis.framed.mask.cpu() > 0.5, None
        if albedo is None:
            albedo = analysis.canvas_albedo.cpu()
            light = _photographed_shading(analysis.framed.rgb.cpu(), albedo, known)
        place = analysis.framed.rgb.device
        visibility: Any
        shading: Any
        visibility, shading = (
            Elsewhere(maps, place) if place.type != "cpu" else maps
            for maps in (analysis.canvas_visibility, analysis.canvas_shading)
        )
        normals = analysis.canvas_normals.cpu()
        return cls(space.framing, known, image, normals, visibility, shading, albedo, light, space)

    def lit(self, lights: Iterable[Light]) -> torch.Tensor:
        """Σ intensity · shading (3, h, w); ValueError for a light in the room that touches the person."""
        several = list(lights)
        near = [light for light in several if isinstance(light, NearLight)]
        samples = [light.samples() for light in several if light not in near]
        total = weighted_sum(self.shading, samples, self.known.shape, channels=3)
        for light in near:
            check_outside(light, self.space, self.known)
            power = torch.from_numpy(np.float32(light.power))[:, None, None]
            total += power * near_sum(self.shading, light, self.space)[0]
        return total

    def unshadowed(self, light: Light) -> torch.Tensor:
        """The share (1, h, w) of a light that no part of the person blocks, see `Subject.unshadowed`."""
        if isinstance(light, NearLight):
            lit, whole = near_sum(self.visibility, light, self.space)
            return (lit / whole.clamp_min(1e-30))[None]
        directions, powers = light.samples()
        weights = luminance(powers).clip(0)
        weights = weights / max(weights.sum(), 1e-9)
        samples = [(directions, weights[:, None])]
        return weighted_sum(self.visibility, samples, self.known.shape, channels=1)


class Elsewhere(NamedTuple):
    """Maps that another device works out."""

    maps: Maps
    device: torch.device

    def __call__(self, directions: torch.Tensor) -> torch.Tensor:
        return self.maps(directions.to(self.device)).cpu()

    def each(self, directions: torch.Tensor) -> torch.Tensor:
        return self.maps.each(directions.to(self.device)).cpu()


class Field(NamedTuple):
    """The maps that a canvas's functions of light are made of, at its N pixels."""

    silhouette: Pixels
    normals: torch.Tensor  # (3, N) unit vectors
    sharpness: torch.Tensor  # (1, N)
    cast: torch.Tensor  # (K, N) of each anchor direction
    residual: torch.Tensor  # (K, N)

    @classmethod
    def of(cls, shading: Any) -> Self:
        """Of what `Canvas.shading` holds, in the computer's own memory."""
        if isinstance(shading, Elsewhere):
            return cls.of(shading.maps)
        if not isinstance(shading, Shading):
            return shading.field()
        visible: Any = shading.visibility
        maps = visible.maps
        tensors = (maps.normals, maps.sharpness, maps.cast, shading.residual)
        inside = shading.silhouette.scatter(torch.ones_like(maps.sharpness))[0].cpu()
        place = Pixels(inside)
        order = torch.argsort(shading.silhouette.pixels.cpu())
        return cls(place, *(tensor.cpu()[:, order] for tensor in tensors))

    def functions(self) -> tuple[Any, Any]:
        """Visibility and shading of any light."""
        anchors = torch.from_numpy(olat(behind=True))
        maps = FieldMaps(self.normals, self.cast, self.sharpness, self.sharpness[:0])
        visibility: Any = Visibility(maps, self.silhouette, anchors)
        return visibility, Shading(
            self.residual, self.normals, visibility, self.silhouette, anchors, known=True
        )


def weighted_sum(
    maps: Maps, samples: Iterable[tuple[np.ndarray, np.ndarray]], shape: torch.Size, channels: int
) -> torch.Tensor:
    """Σ power · maps(direction) on the canvas: (channels, h, w).

    `samples` are directions (D, 3) and powers (D, channels). The result's channels lie together in memory, as
    the lookup of the enlargement wants them.
    """
    total = torch.zeros(shape.numel(), channels)
    for directions, powers in samples:
        batches = (torch.from_numpy(np.float32(values)).split(BATCH) for values in (directions, powers))
        for batch, power in zip(*batches, strict=True):
            total.addmm_(maps(batch).flatten(1).T, power)
    return total.T.unflatten(1, shape)


def near_sum(maps: Maps, light: NearLight, space: Space) -> tuple[torch.Tensor, torch.Tensor]:
    """Σ irradiance · maps over the parts of a light in the room, and Σ irradiance: (h, w) each.

    Both are of intensity 1. The second is what a surface would get that faces each part, and sees it.
    """
    lit = whole = torch.zeros(space.framing.canvas)
    for directions, irradiance in light.rays(space.positions):
        lit, whole = lit + irradiance * maps.each(directions), whole + irradiance
    return lit, whole


def check_outside(light: NearLight, space: Space, known: torch.Tensor) -> None:
    """ValueError for a light that touches the person, or stands inside.

    The far side of the person is not seen. A limb is taken to be about as thick as it is wide.
    """
    name, surface = light.name or "light", space.positions[:, known]
    for point in light.points:
        gap = float((surface - torch.tensor(point, dtype=torch.float32)[:, None]).norm(dim=0).min())
        if gap <= max(light.reach, space.metres_per_pixel / 2):
            raise ValueError(f"{name}: position: touches the person; expected a light beside them")
        row, column = space.place(point)
        seen = point[2] < space.camera.distance and 0 <= row < len(known) and 0 <= column < known.shape[1]
        if not seen or not known[row, column]:
            continue
        behind = -point[2] - float(space.depth[row, column])
        rim = distance_transform_edt(np.pad(known.numpy(), 1, mode="edge"))[row + 1, column + 1]
        if 0 < behind < THICK * rim * space.metres_per_pixel:
            raise ValueError(
                f"{name}: position: is inside the person, {behind:.2f} m behind what is seen of them there; "
                "expected a light outside"
            )


def _photographed_shading(framed: torch.Tensor, albedo: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
    """The light that the person was photographed in, on the canvas (3, h, w): image over albedo.

    Least squares of image = shading · albedo over 3 x 3 pixels: of the three colours together, drawn toward
    the mean light where the albedo is too dark to tell, and then of each colour, drawn toward that of all. So
    of a colour that a material hardly has, the light is as strong as of the others. Positive everywhere on
    the subject.
    """
    mean = (framed[:, known].mean() / albedo[:, known].mean().clamp_min(1e-6)).clamp_min(1e-6)
    explained, squared = (
        F.avg_pool2d(product * known, 3, stride=1, padding=1) for product in (framed * albedo, albedo**2)
    )
    grey = (explained.mean(dim=0) + DARK * mean) / (squared.mean(dim=0) + DARK)
    light = (explained + DARK * grey) / (squared + DARK)
    return torch.maximum(light, DEEPEST * mean)
