"""Near lights: each point of the person has its own direction to them, and distance.

Positions are metres in the camera's axes, from the subject's middle (see `relight.analysis.camera`). The
lights are those of UsdLux, SphereLight and RectLight. Their intensity is the irradiance of a surface that
faces them from one metre, and it falls off with the square of the distance. Torch is imported where rays are
computed: texts of lights are checked without it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass, replace
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

import numpy as np
from annotated_types import Interval

from relight import quantities
from relight.arguments import About, Converted, default, required
from relight.lights.light import Light, Parts, Rays, Settings
from relight.media.photometry import PhotometricProfile, read_profile

if TYPE_CHECKING:
    import torch

    from shadow.files import AnyPath

SAMPLE_COUNT = 16  # over a light that has a size
FULL_CONE, HALF_CONE = 180.0, 90.0  # degrees from the axis to which a lamp, and a rectangle, shines
MIN_CONE = 1e-4  # degrees
GOLDEN = (math.sqrt(5) - 1) / 2
DISC_SAMPLES = 32  # over a sphere that shines, for the shadows that it casts

_CONE = About("Degrees from the axis beyond which there is no light.", unit="degrees")
Cone = Annotated[float, Interval(ge=MIN_CONE, le=FULL_CONE), _CONE]
AngleScale = Annotated[
    float,
    Interval(gt=-1, le=100),
    About("UsdLux's scale of a profile's angles: 0 leaves them, 1 doubles them."),
]
if TYPE_CHECKING:
    ProfileSource = Converted[AnyPath | PhotometricProfile | None, PhotometricProfile | None]
else:
    ProfileSource = Annotated[object, About("A lamp's profile: an .ies or .ldt file.")]
Anchor = Annotated[
    Literal["head", "hips", "left-hand", "right-hand"] | None,
    About("The part of the person that the light follows: position and toward are measured from there."),
]
Point = tuple[float, ...]
FlatCone = Annotated[float, Interval(ge=MIN_CONE, le=HALF_CONE), _CONE]


@dataclass(frozen=True)
class NearLight(Light):
    """What near lights have in common."""

    position: quantities.Position = required()
    _: KW_ONLY
    cone: Cone = FULL_CONE
    softness: quantities.Softness = 0.0
    at: Anchor = None

    is_near: ClassVar[bool] = True

    def _check_faces(self, toward: tuple[float, ...]) -> None:
        if math.dist(self.position, toward) < quantities.MIN_METRES:
            raise ValueError("toward: is at position, where the light stands; expected a point that it faces")

    def standing_at(self, point: Point) -> Self:
        """Return the light of one frame, where the part of the person that it follows is at a point (3,)."""
        there: Settings = {}
        for name in ("position", "toward"):
            if (own := getattr(self, name, None)) is not None:
                there[name] = tuple(np.add(own, point).tolist())
        return replace(self, at=None, **there)

    def check_placed(self) -> None:
        """Raise ValueError for a light that follows a part of a person, where nobody says where that is."""
        if self.at is not None:
            raise ValueError(
                f"{self.name or 'a light'}: at={self.at} is for pictures and shots; expected a position from "
                "the subject's middle"
            )

    @property
    def middle_irradiance(self) -> float:
        """Irradiance of a surface at the subject's middle that faces the light, for a power of 1."""
        import torch

        return sum(float(rays.irradiance.sum()) for rays in self.rays(torch.zeros(3, 1)))

    @property
    def points(self) -> np.ndarray:
        """(K, 3) metres: points that shine, or the centre of a sphere."""
        self.check_placed()
        return np.array([self.position])

    def parts(self) -> Parts:
        """Return the light as points: for a sphere those of its disc as the person sees it."""
        points, radius = self.points, self.extent
        if radius:
            points = _disc(points[0], radius)
        return self._parts(points, radius)

    def _parts(self, points: np.ndarray, radius: float) -> Parts:
        """Return even parts of a light that is as wide as a disc."""
        count = len(points)
        places = np.concatenate([np.float32(points), np.ones((count, 1), np.float32)], axis=1)
        powers = np.broadcast_to(np.float32(self.power / count), (count, 3))
        return Parts(places, powers, np.full(count, radius / math.sqrt(count)))

    @property
    def axis(self) -> np.ndarray:
        """The unit vector (3,) along which it shines."""
        raise NotImplementedError

    @property
    def has_cone(self) -> bool:
        """Whether a cone blocks some of its light."""
        raise NotImplementedError

    @property
    def cone_axis(self) -> np.ndarray | None:
        """The axis (3,) of its cone; None without one."""
        return self.axis if self.has_cone else None

    def transmission(self, directions: torch.Tensor) -> torch.Tensor:
        """Return the share (...) of the light that leaves the cone into unit directions (3, ...), in [0, 1].

        The cone's edge is UsdLux's: a smooth step from `cone * (1 - softness)` to `cone`.
        """
        if not self.has_cone:
            return directions.new_ones(directions.shape[1:])
        angles = _dot(self.axis, directions).clamp(-1, 1).acos().rad2deg()
        if self.softness == 0:
            return (angles <= self.cone).float()
        step = ((self.cone - angles) / (self.cone * self.softness)).clamp(0, 1)
        return step * step * (3 - 2 * step)


@dataclass(frozen=True)
class PointLight(NearLight):
    """A lamp near the person: a point or a sphere, like UsdLux's SphereLight; a spotlight if it has a cone.

    Parameters
    ----------
    position
        (x, y, z) in metres from the subject's middle, along the axes of the camera.
    at
        "head", "hips", "left-hand" or "right-hand": the light follows that part of the person, and `position`
        and `toward` are measured from there. Left is the person's left.
    radius
        Radius in metres, in [0, 1e6], of a uniformly bright sphere. A larger sphere is softer, not brighter.
    toward
        (x, y, z) in metres of a point that a spotlight faces.
    cone
        Angle in degrees from a spotlight's axis, in (0, 180], beyond which there is no light; 180 is no cone.
    softness
        Share of the cone, in [0, 1], over which the light fades to its edge.
    profile
        How the lamp shines into each direction: the file of an IES profile (.ies) or of EULUMDAT (.ldt), see
        `relight.media.photometry`. It needs `toward`. The `intensity` is that of the brightest direction.
    angle_scale
        UsdLux's scale of the profile's angles from the axis, above -1: 0 leaves them, 1 doubles them.
    intensity
        At least 0. At 1, a white surface that faces the lamp has the value 1 at one metre, 1/4 at two.
    colour, exposure, temperature, locus, tint, source, gel, name
        See `relight.DirectionalLight`.

    Raises
    ------
    FileNotFoundError
        No such profile.
    TypeError, ValueError
        Not numbers, NaN or infinite, out of range; a cone or a profile without a point that it faces; a
        profile that cannot be read, or a scale of its angles without one.

    Examples
    --------
    >>> import relight
    >>> lamp = relight.PointLight((-0.6, 0.4, 0.8), radius=0.1, temperature=3200)
    >>> lamp.position
    (-0.6, 0.4, 0.8)
    """

    _: KW_ONLY
    radius: quantities.Radius = 0.0
    toward: quantities.OptionalPosition = default(None)
    profile: ProfileSource = default(None)
    angle_scale: AngleScale = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.profile is not None and not isinstance(self.profile, PhotometricProfile):
            object.__setattr__(self, "profile", _read_profile(self.profile))
        if self.angle_scale and self.profile is None:
            raise ValueError("angle_scale: expected a profile, whose angles it scales")
        if self.toward is not None:
            self._check_faces(self.toward)
        elif self.has_cone or self.profile is not None:
            shape = "cone" if self.has_cone else "profile"
            raise ValueError(f"toward: is missing; expected a point that the {shape} faces")

    def settings(self) -> Settings:
        """Return {parameter: value} of the constructor, without those that have their defaults."""
        settings = super().settings()
        if self.profile is not None:
            if self.profile.path is None:
                raise ValueError("profile: is in no file; write it to one and make the light of that")
            settings["profile"] = str(self.profile.path)
        return settings

    @property
    def cone_axis(self) -> np.ndarray | None:
        return self.axis if self.has_cone or self.profile is not None else None

    def transmission(self, directions: torch.Tensor) -> torch.Tensor:
        """Return the share (...) of the light that leaves into unit directions (3, ...), in [0, 1]."""
        import torch

        shared = super().transmission(directions)
        if self.profile is None:
            return shared
        z = -self.axis
        x = np.cross((0.0, 1.0, 0.0), z)
        x = _unit(x) if np.linalg.norm(x) > 1e-6 else np.array([1.0, 0.0, 0.0])
        axes = np.stack([x, np.cross(z, x), -z])
        own = torch.einsum("lc,c...->l...", torch.from_numpy(np.float32(axes)).to(directions), directions)
        tilted = math.degrees(math.acos(min(1.0, max(-1.0, float(-self.axis[1])))))  # from straight down
        factor = self.profile.tilt_factor(tilted) / self.profile.peak
        return shared * self.profile.at(own, self.angle_scale).to(directions) * factor

    @property
    def extent(self) -> float:
        return self.radius

    @property
    def axis(self) -> np.ndarray:
        """The unit vector (3,) along which a spotlight shines."""
        toward = (0.0, 0.0, -1.0) if self.toward is None else np.subtract(self.toward, self.position)
        return _unit(np.asarray(toward))

    @property
    def has_cone(self) -> bool:
        return self.cone < FULL_CONE

    def rays(self, positions: torch.Tensor) -> Iterator[Rays]:
        """Yield one ray to a point, or SAMPLE_COUNT rays to a sphere, within the cone."""
        for directions, irradiance in self._rays(positions):
            if self.cone_axis is not None:
                irradiance = irradiance * self.transmission(-directions)
            yield Rays(directions, irradiance)

    def _rays(self, positions: torch.Tensor) -> Iterator[Rays]:
        """Yield one ray to a point, or SAMPLE_COUNT rays to a sphere.

        A surface point sees a sphere as a cap of directions. The samples are in equal steps along the cap's
        axis, which are equal solid angles (Archimedes).
        """
        import torch
        import torch.nn.functional as F

        self.check_placed()
        axis, squared = _toward(self.position, positions)
        if self.radius == 0:
            yield Rays(axis, 1 / squared)
            return
        aside = F.normalize(torch.cross(axis, _aside(self.position, axis), dim=0), dim=0)
        other = torch.cross(axis, aside, dim=0)
        depth = 1 - (1 - self.radius**2 / squared).clamp_min(0).sqrt()  # of the cap, on the unit sphere
        steps = [(step + 0.5) / SAMPLE_COUNT for step in range(SAMPLE_COUNT)]
        irradiance = 1 / (squared * sum(1 - depth * step for step in steps))
        for number, step in enumerate(steps):
            along, angle = 1 - depth * step, 2 * math.pi * GOLDEN * number
            around = aside * math.cos(angle) + other * math.sin(angle)
            yield Rays(axis * along + around * (1 - along**2).clamp_min(0).sqrt(), irradiance)


@dataclass(frozen=True)
class RectLight(NearLight):
    """A softbox or window near the person, like UsdLux's RectLight: one side is uniformly bright.

    Parameters
    ----------
    position
        (x, y, z) of its centre, in metres from the subject's middle, along the axes of the camera.
    toward
        (x, y, z) in metres of a point that it faces.
    at
        See `relight.PointLight`.
    width, height
        Metres, in [0.0001, 1e6]. The width is horizontal (to image right, if it faces straight up or down).
    cone, softness
        See `relight.PointLight`; a flat light shines up to 90 degrees from its axis.
    intensity
        At least 0. At 1, a small light gives the value 1 to a white surface that faces it at one metre. From
        far away, a large light is as bright as a small one.
    colour, exposure, temperature, locus, tint, source, gel, name
        See `relight.DirectionalLight`.

    Raises
    ------
    TypeError, ValueError
        Not numbers, NaN or infinite, out of range, no size, `toward` at `position`.

    Examples
    --------
    >>> import relight
    >>> softbox = relight.RectLight((-1.5, 0.5, 2), toward=(0, 0, 0), width=0.6, height=1.2, intensity=4)
    >>> softbox.axis.round(2).tolist()  # the direction in which it shines
    [0.59, -0.2, -0.78]
    """

    toward: quantities.Position = required()
    width: quantities.Side = required()
    height: quantities.Side = required()
    _: KW_ONLY
    cone: FlatCone = HALF_CONE

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_faces(self.toward)

    @property
    def axis(self) -> np.ndarray:
        """The unit vector (3,) along which it shines."""
        return _unit(np.subtract(self.toward, self.position))

    @property
    def has_cone(self) -> bool:
        return self.cone < HALF_CONE or self.softness > 0

    @property
    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors (3,) along its width and along its height."""
        right = np.cross(self.axis, (0.0, 1.0, 0.0))
        length = np.linalg.norm(right)
        right = right / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
        return right, np.cross(right, self.axis)

    @property
    def points(self) -> np.ndarray:
        """Points (SAMPLE_COUNT, 3) of a golden-ratio lattice, uniform along both sides of the rectangle."""
        self.check_placed()
        right, up = self.sides
        u, v = _lattice().T - 0.5
        return np.array(self.position) + self.width * u[:, None] * right + self.height * v[:, None] * up

    @property
    def flat_axis(self) -> np.ndarray | None:
        return self.axis

    def parts(self) -> Parts:
        return self._parts(self.points, math.sqrt(self.width * self.height / math.pi))

    def rays(self, positions: torch.Tensor) -> Iterator[Rays]:
        """Yield SAMPLE_COUNT rays of equal solid angle, seen from a surface point.

        The irradiance is then correct at any distance. Samples of equal area would be too sparse close to the
        light.
        """
        import torch
        import torch.nn.functional as F

        from relight.lights.spherical_rectangle import SphericalRectangle

        self.check_placed()
        axes = torch.from_numpy(np.stack([*self.sides, self.axis]))
        centre = torch.tensor(self.position, dtype=torch.float64).view(3, *[1] * (positions.ndim - 1))
        x, y, z = torch.einsum("lc,c...->l...", axes, centre - positions.double())
        rectangle = SphericalRectangle(
            x, y, self.width, self.height, -z.abs().clamp_min(quantities.MIN_METRES)
        )
        share = rectangle.solid_angle / (self.width * self.height * SAMPLE_COUNT)
        irradiance = share.masked_fill(z >= 0, 0).to(positions)  # nothing shines behind the light's plane
        for u, v in _lattice().tolist():
            directions = torch.einsum("lc,l...->c...", axes, rectangle.sample(u, v))
            directions = F.normalize(directions, dim=0).to(positions)
            if self.has_cone:
                yield Rays(directions, irradiance * self.transmission(-directions))
            else:
                yield Rays(directions, irradiance)


def _lattice() -> np.ndarray:
    """Return (SAMPLE_COUNT, 2) points, evenly spread over the unit square: a golden-ratio lattice."""
    number = np.arange(SAMPLE_COUNT)
    return np.stack([(number + 0.5) / SAMPLE_COUNT, (number + 0.5) * GOLDEN % 1], axis=1)


def _disc(centre: np.ndarray, radius: float) -> np.ndarray:
    """Return points (DISC_SAMPLES, 3) over a disc that faces the origin: an even golden-angle spiral."""
    along = centre / np.linalg.norm(centre)
    aside = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    aside /= np.linalg.norm(aside)
    step = np.arange(DISC_SAMPLES)
    out, angle = radius * np.sqrt((step + 0.5) / DISC_SAMPLES), math.pi * (3 - math.sqrt(5)) * step
    across = np.stack([out * np.cos(angle), out * np.sin(angle)], axis=1)
    return centre + across @ np.stack([aside, np.cross(along, aside)])


def _read_profile(source: object) -> PhotometricProfile:
    """Return the profile of a file; raises as `read_profile`, and TypeError for what is no name of one."""
    try:
        return read_profile(quantities.file_name(source))
    except (TypeError, ValueError) as error:
        raise type(error)(f"profile: {error}") from error


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _dot(axis: np.ndarray, directions: torch.Tensor) -> torch.Tensor:
    """Return the dot products (...) of an axis (3,) with directions (3, ...)."""
    import torch

    return torch.einsum("c,c...->...", torch.from_numpy(axis).to(directions), directions)


def _toward(point: Point, positions: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return unit directions (3, ...) from positions (3, ...) to a point (3,), and the squared distances."""
    import torch

    vectors = torch.tensor(np.asarray(point, np.float32)).view(3, *[1] * (positions.ndim - 1)) - positions
    squared = (vectors**2).sum(dim=0).clamp_min(quantities.MIN_METRES**2)
    return vectors / squared.sqrt(), squared


def _aside(position: tuple[float, ...], like: torch.Tensor) -> torch.Tensor:
    """Return the axis (3, ...) farthest from the direction to a light, the same for all pixels."""
    import torch

    axis = torch.zeros(3, *[1] * (like.ndim - 1))
    axis[int(np.argmin(np.abs(position)))] = 1
    return axis.expand_as(like)
