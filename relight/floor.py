"""The floor that the person stands on: the shadow that they throw on it, and what they hide of the sky.

The floor is a plane. Light that reaches a point of it is the sum over the samples of all lights of
power times cosine times visibility. A sample is visible unless the person, as `relight.solid` has them, is in
between.
What the floor is made of and how it was lit is not known. So its picture is multiplied by the ratio of that
light with the person there to the light without them.
"""

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import NamedTuple, Self

import numpy as np
import torch
import torch.nn.functional as F

from relight.depth import Camera
from relight.foreground import matte_of, plate_of
from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light, checked_number, checked_numbers
from relight.lights.near import NearLight, RectLight
from relight.solid import Silhouette, Solid, pixel_of
from shadow.framing import bounding_box
from shadow.mattes import person_in

LOOKUPS = 2**23  # of silhouettes, for one light: more samples are looked up on a coarser grid of pixels
COARSE = 0.015  # metres between the points of a solid that one of many samples sees
DISC = 32  # points over a sphere that shines
SOLES = 1e-4  # share of the person's pixels that may seem to be below the ground
STEPS = 0.17  # metres: feet so far apart in depth say half of how the camera is tilted
UNLIKELY = 1.4  # times as tall or as small as the person is taken to be: the floor's numbers are doubted


@dataclass(frozen=True)
class Floor:
    """The plane that the person stands on.

    Parameters
    ----------
    height: of the camera above the floor, metres.
    horizon: where the floor's horizon is, as the share of the picture's height from the top: 0 at the top, 1
        at the bottom; below 0 it lies above the picture.
    feet: (x, y, x, y), the two points where the soles meet the ground, pixels of the picture from its top
        left; instead of the lowest points of the matte.

    The horizon says how the floor is tilted. Where it is not given, the height does, since the person's own
    is known (see `relight.Subject`). Or else the feet do, if one is before the other; side by side, they
    say that it is level. The floor lies where the soles touch it. Where the frame cuts the feet off, it lies
    `height` below the camera; otherwise the height beside a horizon is only compared, and a warning says so
    if the person would be a giant or a dwarf.

    Raises
    ------
    TypeError, ValueError: not numbers, out of range, none of the three.
    """

    height: float | None = None
    horizon: float | None = None
    feet: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if self.height is None and self.horizon is None and self.feet is None:
            raise ValueError("floor: expected height, horizon or feet")
        try:
            if self.height is not None and checked_number("height", self.height, 0, 1000) == 0:
                raise ValueError("height: expected metres > 0, got 0")
            if self.horizon is not None:
                checked_number("horizon", self.horizon, -4, 1)
            if self.feet is not None:
                object.__setattr__(self, "feet", checked_numbers("feet", self.feet, 4))
        except (TypeError, ValueError) as error:
            raise type(error)(f"floor: {error}") from error

    @classmethod
    def parse(cls, text: str) -> Self:
        """A floor from text: `height=1.5,horizon=0.45`, `feet=820/1010/900/1030`; ValueError if it does not
        read so."""
        names = [field.name for field in fields(cls)]
        values: dict[str, float | tuple[float, ...]] = {}
        for setting in text.split(","):
            name, equals, value = (part.strip() for part in setting.partition("="))
            if name not in names or not equals or name in values:
                expected = f"parameter=value,... with {', '.join(names)}"
                raise ValueError(f"floor {text!r}: {setting!r} is not understood; expected {expected}")
            try:
                numbers = tuple(map(float, value.split("/")))
            except ValueError as error:
                raise ValueError(f"floor {text!r}: {name} expects numbers, got {value!r}") from error
            if name != "feet" and len(numbers) > 1:
                raise ValueError(f"floor {text!r}: {name} expects one number, got {value!r}")
            values[name] = numbers if name == "feet" else numbers[0]
        return cls(**values)  # type: ignore[arg-type]

    def check(self, image: np.ndarray, mask: np.ndarray | None) -> None:
        """ValueError where the person that an image and a mask show, as `relight.Subject` takes them, cannot
        stand on it."""
        with warnings.catch_warnings():  # the Subject says what there is to say of the matte
            warnings.simplefilter("ignore")
            matte = person_in(matte_of(plate_of(image), mask))
        rows, columns = matte.shape
        bottom = bounding_box(matte)[2]
        soles = [bottom] if self.feet is None else list(self.feet[1::2])
        if self.feet is not None and not all(
            0 <= x <= columns and 0 <= y <= rows for x, y in (self.feet[:2], self.feet[2:])
        ):
            raise ValueError(f"floor: feet: expected points in the picture, {columns} x {rows} pixels")
        if self.horizon is not None and min(soles) <= self.horizon * rows:
            raise ValueError(
                f"floor: expected the horizon above the soles, which are at {min(soles) / rows:.2f} of the "
                f"picture's height, got {self.horizon:g}"
            )
        if self.feet is None and bottom == rows and (self.height is None or self.horizon is None):
            raise ValueError("floor: the frame cuts the feet off; expected both height and horizon")

    def under(self, camera: Camera, points: torch.Tensor) -> "Plane":
        """Where it lies under a person of whom the camera, at the origin, sees points (3, N) in metres.

        In a shot the camera knows where the soles are in its first frame. So the floor stands still.
        """
        soles = self.soles(camera, points)
        normal = self._normal(soles, camera)
        below = -float((normal @ soles).mean())
        if self.height is None or self.horizon is None:
            return Plane(normal, below)
        if self.feet is None and camera.bottom == camera.size[0]:  # they are not in the picture
            return Plane(normal, self.height)
        times = self.height / below
        if not 1 / UNLIKELY < times < UNLIKELY:
            warnings.warn(
                f"floor: with height={self.height:g} and horizon={self.horizon:g} the person would be "
                f"{times:.2g} times as tall as they are taken to be; is one of the two mistaken?",
                stacklevel=4,  # the caller of `Subject.shadows`
            )
        return Plane(normal, below)

    def stand(self, points: torch.Tensor, plane: "Plane", camera: Camera, pixel: float) -> float:
        """How many times farther away the person stands whose soles touch the plane.

        Points (3, N) that are scaled about the camera look the same in the picture. They are the middles of
        pixels, `pixel` metres wide, of which the lowest reach down to the ground.
        """
        if self.feet is None:
            lowest = pixel / 2 - float((plane.normal @ points).quantile(SOLES))
        else:
            lowest = -float((plane.normal @ self.soles(camera, points)).mean())
        return plane.below / lowest if lowest > 0 else 1.0

    def soles(self, camera: Camera, points: torch.Tensor) -> torch.Tensor:
        """The two feet, or the middle of the matte's lower edge: (3, N), camera at the origin, metres."""
        if self.feet is None:
            below = torch.tensor([camera.middle[0]]), torch.tensor([float(camera.bottom)])
            return camera.rays(*below) * camera.distance
        rays = camera.rays(*torch.tensor(self.feet).view(2, 2).T)
        apart = (points[:2] / -points[2])[:, None] - rays[:2, :, None]
        return rays * -points[2, apart.norm(dim=0).argmin(dim=1)]

    def _normal(self, soles: torch.Tensor, camera: Camera) -> torch.Tensor:
        """Upward from the floor (3,), in the plane of y and z, since the camera is not rolled."""
        _, y, z = soles.mean(dim=1).tolist()
        if self.horizon is not None:
            tilt = math.atan2((0.5 - self.horizon) * camera.size[0], camera.focal)
        elif self.height is not None:
            reach = math.hypot(y, z)
            if self.height >= reach:
                far = f"{reach:.2f} m, how far away the soles are"
                raise ValueError(f"floor: expected a height below {far}, got {self.height:g}")
            tilt = math.atan2(z, y) + math.acos(-self.height / reach)
        else:
            _, y, z = (soles[:, 0] - soles[:, 1]).tolist()
            tilt = math.atan(-y * z / (z * z + STEPS**2))
        return torch.tensor([0.0, math.cos(tilt), math.sin(tilt)])


class Plane(NamedTuple):
    """A plane in the axes of a camera that is at the origin."""

    normal: torch.Tensor  # (3,) unit, upward
    below: float  # metres of the camera above it

    def horizon(self, camera: Camera) -> int:
        """The first row of a camera's picture that shows some of it; as many as there are if none does."""
        row = camera.size[0] / 2 - camera.focal * float(self.normal[2] / self.normal[1])
        return min(max(math.floor(row), 0), camera.size[0])

    def seen(self, camera: Camera, step: int) -> torch.Tensor:
        """What a camera sees of it below the horizon, the middles of `step` × `step` pixels: (h, w, 3)
        metres."""
        (height, width), top = camera.size, self.horizon(camera)
        rows, columns = (
            torch.arange(low, high, step) + step / 2 for low, high in ((top, height), (0, width))
        )
        y, x = torch.meshgrid(rows, columns, indexing="ij")
        rays = camera.rays(x, y).permute(1, 2, 0)
        return rays * (-self.below / (rays @ self.normal).clamp_max(-1e-6))[..., None]

    def fall(self, points: torch.Tensor, light: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The ways (P, 3) from a light, as of `Silhouette`, to points (P, 3), and how many times (P,) as long
        they are from there to the plane; infinite where they do not get there."""
        away = points * light[3] - light[:3]
        falling = -(away @ self.normal)
        times = (points @ self.normal + self.below).clamp_min(0) / falling.clamp_min(1e-6)
        return away, torch.where(falling > 1e-6, times, torch.inf)


class Sample(NamedTuple):
    """A point of a light, and what it stands for."""

    light: torch.Tensor  # (4,) homogeneous position, as of `Silhouette`
    power: torch.Tensor  # (3,)
    radius: float = 0.0  # of the part of the light that it stands for: radians, of a near one metres
    axis: torch.Tensor | None = None  # (3,) along which a near one shines most; None for all around

    def reaches(self, plane: Plane) -> bool:
        """Whether it lights the plane from above."""
        return float(plane.normal @ self.light[:3] + plane.below * self.light[3]) > 1e-6

    def irradiance(self, plane: Plane, points: torch.Tensor) -> torch.Tensor:
        """Of points of a plane, none being in between: (3,), or of a near light (h, w, 3) at (h, w, 3)."""
        if not self.light[3]:
            return self.power * (plane.normal @ self.light[:3]).clamp_min(0)
        way = self.light[:3] - points
        squared = (way * way).sum(dim=-1)
        irradiance = (way @ plane.normal).clamp_min(0) / squared**1.5
        if self.axis is not None:
            irradiance = irradiance * -(way @ self.axis).clamp_max(0) / squared.sqrt()
        return irradiance[..., None] * self.power

    def blur(self, away: torch.Tensor, times: torch.Tensor) -> torch.Tensor | None:
        """How far (P,) edges of the shadow are spread, as of `Silhouette`; `away`, `times`: `Plane.fall`.

        The standard deviation of a disc along one axis is half its radius.
        """
        if not self.radius:
            return None
        times = torch.where(times.isinf(), 0.0, times)
        if not self.light[3]:
            return self.radius / 2 * times
        return self.radius / 2 / away.norm(dim=1).clamp_min(1e-6) * times / (1 + times)


class Stance(NamedTuple):
    """A person on their floor."""

    camera: Camera
    plane: Plane
    solid: Solid
    times: float  # how many times farther away they stand than they were taken to

    @classmethod
    def of(
        cls, floor: Floor, camera: Camera, positions: torch.Tensor, known: torch.Tensor, cut: bool
    ) -> "Stance":
        """From the `positions` (3, h, w) that the camera sees of them, in metres from the subject's middle,
        where `known` (h, w); `cut`: the frame cuts the feet off."""
        positions = positions + middle(camera)[:, None, None]
        points = positions[:, known]
        plane = floor.under(camera, points)
        times = 1.0 if cut else floor.stand(points, plane, camera, pixel_of(positions, known))
        solid = Solid.of(positions * times, known)
        return cls(camera, plane, solid, times)

    def shadows(self, lights: Mapping[str, Light]) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """As `relight.Subject.shadows` returns them."""
        each, full, blocked = {}, torch.zeros(3), torch.zeros(*self.camera.size, 3)
        for name, light in lights.items():
            without, kept = self.light(_samples(light, self.camera))
            each[name] = _ratio(without, kept)
            full, blocked = full + without, blocked + kept
        return each, _ratio(full, blocked)

    def light(self, samples: list[Sample]) -> tuple[torch.Tensor, torch.Tensor]:
        """The irradiance of the floor: what there would be without the person, and what they keep off.

        Both (H, W, 3); zero above the horizon, and the first (3,) where it is the same all over.
        """
        samples = [sample for sample in samples if sample.reaches(self.plane)]
        top = self.plane.horizon(self.camera)
        pixels = (self.camera.size[0] - top) * self.camera.size[1]
        step = max(1, round(math.sqrt(pixels * len(samples) / LOOKUPS)))
        points = self.plane.seen(self.camera, step)
        sharp = len(samples) == 1 and samples[0].radius == 0
        solid = self.solid if sharp else self.solid.coarser(COARSE)
        full, blocked = torch.zeros(3), torch.zeros(points.shape)
        for sample in samples:
            reaching = sample.irradiance(self.plane, points)
            full = full + reaching
            away, times = self.plane.fall(solid.points, sample.light)
            part = self._shaded(solid.points, away, times, sample.radius, top, step)
            if part is not None:
                silhouette = Silhouette(solid, sample.light, sample.blur(away, times))
                hidden = silhouette.at(points[part])[..., None]
                blocked[part] += hidden * (reaching if reaching.ndim == 1 else reaching[part])
        size = self.camera.size
        full = full if full.ndim == 1 else _enlarged(full, top, step, size)
        return full, _enlarged(blocked, top, step, size)

    def _shaded(
        self,
        points: torch.Tensor,
        away: torch.Tensor,
        times: torch.Tensor,
        radius: float,
        top: int,
        step: int,
    ) -> tuple[slice, slice] | None:
        """The part of what `Plane.seen` gives that a shadow of points can reach; None if it is
        out of sight."""
        falls = times.isfinite()
        shadow = (points + away * times[:, None])[falls]
        if not len(shadow):
            return None
        spread = 2 * radius * float(times[falls].max()) + self.solid.spacing
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


def _samples(light: Light, camera: Camera) -> list[Sample]:
    """The points of a light, in the axes of the camera."""
    if isinstance(light, NearLight):
        return _near_samples(light, camera)
    directions, powers = (torch.from_numpy(np.float32(values)) for values in light.samples())
    radii = np.zeros(len(directions))
    if isinstance(light, EnvironmentLight):
        radii = light.image.spreads
    elif isinstance(light, DirectionalLight):
        radii += math.radians(light.angle / 2) / math.sqrt(len(directions))
    lights = torch.cat([directions, torch.zeros(len(directions), 1)], dim=1)
    samples = zip(lights, powers, radii, strict=True)
    return [Sample(place, power, float(radius)) for place, power, radius in samples]


def _near_samples(light: NearLight, camera: Camera) -> list[Sample]:
    """The points of a light in the room: of a sphere those of its disc, as the person sees it."""
    points, size, axis = light.points, 0.0, None
    if isinstance(light, RectLight):
        size, axis = math.sqrt(light.width * light.height / math.pi), torch.from_numpy(np.float32(light.axis))
    elif light.reach:
        size, points = light.reach, _disc(points[0], light.reach)
    places = torch.from_numpy(np.float32(points)) + middle(camera)
    power = torch.from_numpy(np.float32(light.power / len(places)))
    radius = size / math.sqrt(len(places))
    return [Sample(F.pad(place, (0, 1), value=1.0), power, radius, axis) for place in places]


def _disc(centre: np.ndarray, radius: float) -> np.ndarray:
    """Points (DISC, 3) over a disc that faces the origin: a golden-angle spiral of even density."""
    along = centre / np.linalg.norm(centre)
    aside = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    aside /= np.linalg.norm(aside)
    step = np.arange(DISC)
    out, angle = radius * np.sqrt((step + 0.5) / DISC), math.pi * (3 - math.sqrt(5)) * step
    across = np.stack([out * np.cos(angle), out * np.sin(angle)], axis=1)
    return centre + across @ np.stack([aside, np.cross(along, aside)])


def middle(camera: Camera) -> torch.Tensor:
    """Where (3,) the subject's middle is, the camera being at the origin."""
    return camera.rays(*torch.tensor(camera.middle)) * camera.distance


def _enlarged(values: torch.Tensor, top: int, step: int, size: tuple[int, int]) -> torch.Tensor:
    """What lies below row `top` on a grid of `step` pixels (h, w, 3), as a picture (H, W, 3)."""
    picture = torch.zeros(*size, 3)
    if values.numel():
        fine = values.permute(2, 0, 1)[None]
        if step > 1:
            fine = F.interpolate(fine, scale_factor=step, mode="bilinear", align_corners=False)
        picture[top:] = fine[0, :, : size[0] - top, : size[1]].permute(1, 2, 0)
    return picture


def _ratio(full: torch.Tensor, blocked: torch.Tensor) -> np.ndarray:
    """The share of light that is left (H, W, 3); all of it where there is none."""
    share = torch.where(full > 0, blocked / full.clamp_min(1e-30), 0.0)
    return (1 - share).clamp(0, 1).numpy()
