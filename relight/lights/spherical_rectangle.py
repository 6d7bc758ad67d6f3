"""Sampling a rectangle by the solid angle that a point sees of it."""

import math

import torch

MIN_SOLID_ANGLE = 1e-5  # steradians: a smaller rectangle is sampled by area, where rounding matters less


class SphericalRectangle:
    """A rectangle seen from the origin, for sampling by solid angle (Ureña et al., EGSR 2013). In float64.

    It is parallel to the axes x and y, around (x, y, z), with z < 0; these are (...) tensors, for as many
    surface points. A rectangle of less than MIN_SOLID_ANGLE is sampled by area.
    """

    def __init__(
        self, x: torch.Tensor, y: torch.Tensor, width: float, height: float, z: torch.Tensor
    ) -> None:
        self._x0, self._x1, self._y0, self._y1 = x - width / 2, x + width / 2, y - height / 2, y + height / 2
        self._z = z
        # The z components of the normals of the planes through the origin and each side. The angles between
        # these planes are those of the spherical quadrilateral, whose excess over 2π is its solid angle.
        lower, upper = -self._y0 / torch.hypot(self._y0, z), self._y1 / torch.hypot(self._y1, z)
        left, right = -self._x0 / torch.hypot(self._x0, z), self._x1 / torch.hypot(self._x1, z)
        angles = [
            torch.acos(-a * b) for a, b in ((lower, right), (right, upper), (upper, left), (left, lower))
        ]
        self._lower, self._upper = lower, upper
        self._start = 2 * math.pi - angles[2] - angles[3]
        excess = angles[0] + angles[1] - self._start
        by_area = width * height * z.abs() / (x**2 + y**2 + z**2) ** 1.5
        self._small = by_area < MIN_SOLID_ANGLE
        self.solid_angle = torch.where(self._small, by_area, excess)

    def sample(self, u: float, v: float) -> torch.Tensor:
        """Return the point (3, ...) of the rectangle for u and v in (0, 1), uniform in solid angle."""
        angle = self._start + u * self.solid_angle
        slope = (angle.cos() * self._lower - self._upper) / angle.sin()
        cosine = torch.where(slope > 0, 1.0, -1.0).to(slope) / torch.hypot(slope, self._lower)
        cosine = cosine.clamp(-1 + 1e-12, 1 - 1e-12)
        x = -cosine * self._z / (1 - cosine**2).sqrt()
        x = torch.where(self._small, torch.lerp(self._x0, self._x1, u), x)
        x = torch.minimum(torch.maximum(x, self._x0), self._x1)
        distance = torch.hypot(x, self._z)
        low, high = self._y0 / torch.hypot(self._y0, distance), self._y1 / torch.hypot(self._y1, distance)
        sine = torch.lerp(low, high, v).clamp(-1 + 1e-12, 1 - 1e-12)
        y = sine * distance / (1 - sine**2).sqrt()
        return torch.stack([x, torch.minimum(torch.maximum(y, self._y0), self._y1), self._z])
