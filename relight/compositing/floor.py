"""The floor that the person stands on, as a plane in front of the camera."""

import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, NamedTuple, Protocol, Self, TypeAlias

import torch
from annotated_types import Gt, Interval, Le

from relight.arguments import About, Checked, Converts, parameters, read_settings, shown
from shadow.framing import bounding_box

BELOW_GROUND_SHARE = 1e-4  # of the person's pixels, that may seem to be below the ground
FEET_DEPTH_METRES = 0.17  # difference in depth at which the feet decide half of the camera's tilt
HEIGHT_RATIO_WARNED = 1.4  # of the person's height by the floor to their own: a warning beyond it


class PlateCamera(Protocol):
    """What the floor needs of a plate's camera; see `relight.analysis.camera.Camera`."""

    @property
    def size(self) -> tuple[int, int]: ...  # (H, W) of the plate, pixels
    @property
    def focal(self) -> float: ...  # pixels
    @property
    def middle(self) -> tuple[float, float]: ...  # (x, y) of the subject's middle, pixels
    @property
    def distance(self) -> float: ...  # metres to the subject's middle
    @property
    def bottom(self) -> int: ...  # row at which the person ends

    def rays(self, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """Return vectors (3, ...) through pixels, scaled to z = -1."""


@dataclass(frozen=True)
class Floor(Checked):
    """The plane on which the person stands and casts a shadow. Give at least one parameter.

    The horizon determines the tilt of the camera. Without a horizon, the tilt follows from the camera's
    height, since the person's height is known (see `relight.Subject`). Without either, it follows from the
    feet if one is farther away than the other; side by side, they mean a level camera. The soles touch the
    floor. If the frame cuts the feet off, the floor is `height` below the camera, and both height and horizon
    are needed. Otherwise, if both are given, the height is only checked: a warning says if the person would
    be a giant or a dwarf.

    Parameters
    ----------
    height
        Height of the camera above the floor in metres, in (0, 1000].
    horizon
        Position of the horizon as a fraction of the picture's height, in [-4, 1]: 0 is the top, 1 the bottom,
        below 0 is above the picture.
    feet
        (x, y, x, y), the two points where the soles meet the ground, in pixels from the top left of the
        picture; by default the lowest points of the matte.

    Raises
    ------
    TypeError, ValueError
        Not numbers, out of range, none of the three.

    Examples
    --------
    >>> import relight
    >>> relight.Floor(horizon=0.4)
    Floor(height=None, horizon=0.4, feet=None)
    """

    height: Annotated[
        float | None, Gt(0), Le(1000), About("Height of the camera above the floor.", unit="metres")
    ] = None
    horizon: Annotated[
        float | None,
        Interval(ge=-4, le=1),
        About("The horizon as a fraction of the picture from top (0) to bottom (1)."),
    ] = None
    feet: Annotated[
        tuple[float, float, float, float] | None,
        Converts(),
        About("x/y/x/y of the points where the soles meet the ground.", unit="pixels"),
    ] = None

    def __post_init__(self) -> None:
        try:
            super().__post_init__()
        except (TypeError, ValueError) as error:
            raise type(error)(f"floor: {error}") from error
        if self.height is None and self.horizon is None and self.feet is None:
            raise ValueError("floor: expected height, horizon or feet")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read a floor from text: `height=1.5,horizon=0.45`, `feet=820/1010/900/1030`.

        Raises
        ------
        ValueError
            The text does not have this form.
        """
        try:
            return cls(**read_settings(text.split(","), parameters(cls)))
        except ValueError as error:
            raise ValueError(f"floor {text!r}: {error}") from error

    def check(self, matte: torch.Tensor) -> None:
        """Raise ValueError where a person cannot stand on the floor; `matte` (H, W) shows them."""
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

    def plane(self, camera: PlateCamera, points: torch.Tensor) -> "Plane":
        """Return the floor's plane, from the points (3, N) of the person in metres, the camera at the origin.

        The camera of a shot holds where the soles are in its first frame, so the floor does not move.
        """
        soles = self.soles(camera, points)
        normal = self._normal(soles, camera)
        below = -float((normal @ soles).mean())
        if self.height is None or self.horizon is None:
            return Plane(normal, below)
        if self.feet is None and camera.bottom == camera.size[0]:  # they are not in the picture
            return Plane(normal, self.height)
        ratio = self.height / below
        if not 1 / HEIGHT_RATIO_WARNED < ratio < HEIGHT_RATIO_WARNED:
            warnings.warn(
                f"floor: with height={self.height:g} and horizon={self.horizon:g} the person would be "
                f"{ratio:.2g} times as tall as they are taken to be; is one of the two mistaken?",
                stacklevel=4,  # the caller of `Subject.shadows`
            )
        return Plane(normal, below)

    def distance_scale(
        self, points: torch.Tensor, plane: "Plane", camera: PlateCamera, pixel: float
    ) -> float:
        """Return the factor of the person's distance with which their soles touch the plane.

        Points (3, N) scaled about the camera look the same in the picture. They are the middles of pixels,
        `pixel` metres wide. The lowest ones reach down to the ground.
        """
        if self.feet is None:
            lowest = pixel / 2 - float((plane.normal @ points).quantile(BELOW_GROUND_SHARE))
        else:
            lowest = -float((plane.normal @ self.soles(camera, points)).mean())
        return plane.below / lowest if lowest > 0 else 1.0

    def soles(self, camera: PlateCamera, points: torch.Tensor) -> torch.Tensor:
        """Return the two feet, or the middle of the matte's lower edge: (3, N) metres from the camera."""
        if self.feet is None:
            below = torch.tensor([camera.middle[0]]), torch.tensor([float(camera.bottom)])
            return camera.rays(*below) * camera.distance
        rays = camera.rays(*torch.tensor(self.feet).view(2, 2).T)
        apart = (points[:2] / -points[2])[:, None] - rays[:2, :, None]
        return rays * -points[2, apart.norm(dim=0).argmin(dim=1)]

    def _normal(self, soles: torch.Tensor, camera: PlateCamera) -> torch.Tensor:
        """Return the upward normal (3,) of the floor, with x zero: the camera is not rolled."""
        _, y, z = soles.mean(dim=1).tolist()
        if self.horizon is not None:
            tilt = math.atan2((0.5 - self.horizon) * camera.size[0], camera.focal)
        elif self.height is not None:
            far = math.hypot(y, z)
            if self.height >= far:
                raise ValueError(
                    f"floor: expected a height below {far:.2f} m, how far away the soles are, got "
                    f"{self.height:g}"
                )
            tilt = math.atan2(z, y) + math.acos(-self.height / far)
        else:
            _, y, z = (soles[:, 0] - soles[:, 1]).tolist()
            tilt = math.atan(-y * z / (z * z + FEET_DEPTH_METRES**2))
        return torch.tensor([0.0, math.cos(tilt), math.sin(tilt)])


def _given(value: object) -> Floor:
    if not isinstance(value, Floor):
        raise TypeError(f"expected a relight.Floor, got {shown(value)}")
    return value


if TYPE_CHECKING:
    GivenFloor: TypeAlias = Floor
else:
    GivenFloor = Annotated[object, About(expected="a relight.Floor", check=_given)]


class Plane(NamedTuple):
    """A plane in the axes of a camera at the origin."""

    normal: torch.Tensor  # (3,) unit, upward
    below: float  # metres of the camera above it

    def horizon(self, camera: PlateCamera) -> int:
        """Return the first row of a picture that shows the plane; the number of rows if none does."""
        row = camera.size[0] / 2 - camera.focal * float(self.normal[2] / self.normal[1])
        return min(max(math.floor(row), 0), camera.size[0])

    def visible_points(self, camera: PlateCamera, step: int) -> torch.Tensor:
        """Return what a camera sees of the plane: (h, w, 3) metres, the middles of `step` × `step` pixels."""
        (height, width), top = camera.size, self.horizon(camera)
        rows, columns = (
            torch.arange(low, high, step) + step / 2 for low, high in ((top, height), (0, width))
        )
        y, x = torch.meshgrid(rows, columns, indexing="ij")
        rays = camera.rays(x, y).permute(1, 2, 0)
        return rays * (-self.below / (rays @ self.normal).clamp_max(-1e-6))[..., None]

    def project_to_plane(
        self, points: torch.Tensor, light: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Follow the rays from a light (4,), homogeneous, through points (P, 3) to the plane.

        Returns the vectors (P, 3) from the light to the points, and the factors (P,) of these by which the
        plane lies beyond the points; infinite where a ray does not meet the plane.
        """
        rays = points * light[3] - light[:3]
        falling = -(rays @ self.normal)
        factors = (points @ self.normal + self.below).clamp_min(0) / falling.clamp_min(1e-6)
        return rays, torch.where(falling > 1e-6, factors, torch.inf)
