"""Make random places: streets by day and at dusk, parks and rooms. Used by other benchmarks; it has no
command.

The camera sees the same radiance that lights a person in the place, so a place is the truth for light that is
estimated from a plate. A place has a ground, boxes and tree crowns around a camera 1.5 m above the floor, in
the camera frame and in metres. Surfaces are lit by the sky, by the sun or lamps, and by a constant bounce.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import map_coordinates

from relight.lights.environment import FIELD_OF_VIEW
from shadow.directions import from_spherical
from shadow.srgb import encode_srgb

FLOOR = -1.5
SUN = 1.5  # degrees, the sun's radius: as wide as a map's pixels resolve, of the true sun's light
SUNLIGHT = np.array([1.0, 0.88, 0.72])  # its colour
FAR = 1e4
WINDOW = 24  # samples of a room's window, along each side
KINDS = ("street", "park", "dusk", "room")


@dataclass
class Place:
    """A place. `kind` is one of KINDS; the same seed is the same place."""

    kind: str
    seed: int
    boxes: list = field(default_factory=list)  # (lowest corner, highest corner, colour, what it is)
    crowns: list = field(default_factory=list)  # (centre, radius, colour)
    lamps: list = field(default_factory=list)  # (position, power, radius)
    exposure: float = 1.0

    def __post_init__(self):
        self.random = random = np.random.default_rng((self.seed, KINDS.index(self.kind)))
        self.noise = random.uniform(-1, 1, (32, 32, 32))
        self.sun, self.power = from_spherical(random.uniform(-180, 180), random.uniform(15, 60)), 0.0
        self.sky = np.array([0.28, 0.42, 0.75]) * random.uniform(0.8, 1.2)
        self.haze = np.array([0.8, 0.85, 0.95])
        self.ground = np.array([0.16, 0.15, 0.14]) * random.uniform(0.7, 1.6)
        getattr(self, f"_{self.kind}")(random)
        plate = self._radiance(self._rays((48, 72), FIELD_OF_VIEW))
        self.exposure = 0.2 / np.median(plate.mean(axis=-1)) * np.exp(random.normal(0, 0.2))

    def plate(self, size, field_of_view=FIELD_OF_VIEW):
        """What a camera records of the place (H, W, 3): uint8, sRGB, exposed for the middle of its tones,
        and clipped."""
        light = self.seen(size, field_of_view).clip(0, 1)
        return np.round(encode_srgb(light) * 255).astype(np.uint8)

    def seen(self, size, field_of_view=FIELD_OF_VIEW):
        """The same, unclipped: (H, W, 3) float32 radiance in the plate's exposure."""
        height, width = size
        rays = self._rays((2 * height, 2 * width), field_of_view)
        fine = self._radiance(rays).reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
        return np.float32(fine * self.exposure)

    def map(self, rows=256):
        """The place all around, as `relight.EnvironmentLight` takes it, in the plate's exposure."""
        azimuth = 180 - (np.arange(2 * rows) + 0.5) * 180 / rows
        elevation = 90 - (np.arange(rows)[:, None] + 0.5) * 180 / rows
        return np.float32(self._radiance(from_spherical(azimuth, elevation)) * self.exposure)

    def _rays(self, size, field_of_view):
        height, width = size
        half = np.tan(np.radians(field_of_view / 2))
        y = half * (1 - (np.arange(height)[:, None] + 0.5) * 2 / height)
        x = half * ((np.arange(width) + 0.5) * 2 - width) / height
        rays = np.stack(np.broadcast_arrays(x, y, -1.0), axis=-1)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def _street(self, random):
        self.power = random.choice([0.0, random.uniform(3, 5)], p=[0.3, 0.7])  # overcast or sunny
        if not self.power:
            self.sky, self.haze = np.array([0.9, 0.95, 1.0]), np.array([0.7, 0.72, 0.75])
        self._houses(random)
        self._trees(random, 3)

    def _park(self, random):
        self._street(random)
        self.boxes, self.ground = self.boxes[:2], np.array([0.09, 0.13, 0.04]) * random.uniform(0.8, 1.6)
        self._trees(random, 12)

    def _dusk(self, random):
        self.sky, self.haze = np.array([0.02, 0.035, 0.09]), np.array([0.12, 0.09, 0.11])
        self._houses(random)
        for _ in range(random.integers(4, 8)):
            angle, away = random.uniform(0, 2 * np.pi), random.uniform(4, 14)
            position = np.array([away * np.sin(angle), random.uniform(2, 3.5), away * np.cos(angle)])
            self.lamps.append((position, np.array([1.0, 0.68, 0.38]) * random.uniform(4, 12), 0.2))

    def _room(self, random):
        width, depth, height = random.uniform(2, 4), random.uniform(2.5, 5), random.uniform(2.5, 3.2)
        wall = np.array([0.62, 0.58, 0.52]) * random.uniform(0.8, 1.2, 3) * random.uniform(0.6, 1.1)
        self.ground = np.array([0.3, 0.2, 0.12]) * random.uniform(0.6, 1.4)
        x, z, top = random.uniform(-0.8, 0.8), random.uniform(-1, 1), FLOOR + height
        self.shell = np.array([[x - width, FLOOR, z - depth], [x + width, top, z + depth]]), wall
        side = random.integers(3)  # the window is at image left, at image right, or behind
        middle, across = random.uniform(-1, 1), random.uniform(0.8, 1.6)
        low, high = self.shell[0]
        self.window = np.array([[0, FLOOR + 0.9, middle - across], [0, top - 0.4, middle + across]])
        self.window[:, 0] = (low[0], high[0], 0)[side]
        if side == 2:
            self.window = self.window[:, [2, 1, 0]]
            self.window[:, 2] = low[2]
        self.bright = np.array([0.9, 1.0, 1.15]) * random.uniform(6, 15)
        for _ in range(5):
            spot = random.uniform(low[[0, 2]] * 0.9, high[[0, 2]] * 0.9)
            if np.hypot(*spot) > 1.3:
                self._box(spot, random.uniform(0.2, 0.6, 2), random.uniform(0.4, 1.5), random, "thing")
        if random.random() < 0.5:
            lamp = np.array([random.uniform(-1, 1), top - 0.4, random.uniform(-1, 1)])
            self.lamps.append((lamp, np.array([1.0, 0.75, 0.5]) * random.uniform(0.5, 3), 0.15))

    def _houses(self, random):
        for _ in range(14):
            angle, away = random.uniform(0, 2 * np.pi), random.uniform(9, 30)
            spot = away * np.array([np.sin(angle), np.cos(angle)])
            size = random.uniform(2, 7, 2)
            if np.abs(spot / size).max() > 1.5:
                self._box(spot, size, random.uniform(4, 16), random, "house")

    def _box(self, spot, size, height, random, what):
        colour = np.array([0.5, 0.42, 0.36]) * random.uniform(0.4, 1.3) * random.uniform(0.8, 1.2, 3)
        low = np.array([spot[0] - size[0], FLOOR, spot[1] - size[1]])
        high = np.array([spot[0] + size[0], FLOOR + height, spot[1] + size[1]])
        self.boxes.append((low, high, colour, what))

    def _trees(self, random, count):
        for _ in range(count):
            angle, away = random.uniform(0, 2 * np.pi), random.uniform(6, 25)
            x, z, radius = away * np.sin(angle), away * np.cos(angle), random.uniform(1, 2.5)
            crown = np.array([x, FLOOR + radius + random.uniform(1.5, 2.5), z])
            self.crowns.append((crown, radius, np.array([0.06, 0.11, 0.03]) * random.uniform(0.7, 1.5)))
            self._box((x, z), (0.15, 0.15), crown[1] - FLOOR, random, "trunk")

    def _radiance(self, rays):
        """Radiance (..., 3) from unit directions (..., 3)."""
        flat = rays.reshape(-1, 3).astype(float)
        origin = np.zeros_like(flat)
        away, normal, albedo, glow = self._hit(origin, flat)
        point = flat * away[:, None]
        lit = albedo * self._irradiance(point, normal) + glow
        colour = np.where((away < FAR)[:, None], lit, self._above(flat))
        return colour.reshape(rays.shape)

    def _above(self, rays):
        """Radiance of the sky and of the sun's disc."""
        up = np.clip(rays[:, 1:2], 0, 1) ** 0.5
        cloud = np.clip(self._noisy(rays / (np.abs(rays[:, 1:2]) + 0.15) * 2), 0, 1)[:, None]
        sky = self.haze * (1 - up) + self.sky * up + cloud * self.haze * 0.5 * up
        near = rays @ self.sun
        disc = near > np.cos(np.radians(SUN))
        wide = 2 * np.pi * (1 - np.cos(np.radians(SUN)))
        glow = 0.2 * np.exp(12 * (near - 1)) * (self.power > 0)
        return sky * (1 + glow[:, None]) + disc[:, None] * SUNLIGHT * self.power * np.pi / wide

    def _hit(self, origin, rays):
        """Distance (N,), normal, albedo and emitted radiance (N, 3) of what rays meet first."""
        count = len(rays)
        away, normal = np.full(count, FAR), np.zeros((count, 3))
        albedo, glow = np.zeros((count, 3)), np.zeros((count, 3))
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1 / rays

            def meet(found, distance, toward, colour, light=0.0):
                found = found & (distance < away) & (distance > 1e-4)
                away[found] = distance[found]
                normal[found] = np.broadcast_to(toward, normal.shape)[found]
                albedo[found] = np.broadcast_to(colour, albedo.shape)[found]
                glow[found] = np.broadcast_to(light, glow.shape)[found]

            if self.kind != "room":
                distance = (FLOOR - origin[:, 1]) * inverse[:, 1]
                meet(distance < FAR / 20, distance, (0, 1, 0), self.ground)
            else:
                (low, high), colour = self.shell
                planes = np.where(rays > 0, high, low)
                each = (planes - origin) * inverse
                axis = each.argmin(axis=1)
                distance = each.min(axis=1)
                toward = -np.sign(rays) * np.eye(3)[axis]
                point = origin + rays * distance[:, None]
                paint = np.where(
                    toward[:, 1:2] > 0.5, self.ground, np.where(toward[:, 1:2] < -0.5, 0.75, colour)
                )
                pane = ((point > self.window[0] - 1e-6) & (point < self.window[1] + 1e-6)).all(axis=1)
                meet(distance > 0, distance, toward, paint * ~pane[:, None], self.bright * pane[:, None])
            for low, high, colour, what in self.boxes:
                near, far = np.sort([(low - origin) * inverse, (high - origin) * inverse], axis=0)
                distance = near.max(axis=1)
                toward = -np.sign(rays) * np.eye(3)[near.argmax(axis=1)]
                paint, light = colour, 0.0
                if what == "house":
                    paint, light = self._facade(origin + rays * distance[:, None], colour)
                meet(distance < far.min(axis=1), distance, toward, paint, light)
            for centre, radius, colour in self.crowns:
                distance, toward = _sphere(origin, rays, centre, radius)
                meet(distance < FAR, distance, toward, colour)
            for centre, power, radius in self.lamps:
                distance, toward = _sphere(origin, rays, centre, radius)
                meet(distance < FAR, distance, toward, 0.0, power / radius**2)
        point = origin + rays * np.minimum(away, FAR)[:, None]
        grain = 1 + 0.35 * self._noisy(point * 1.3) + 0.25 * self._noisy(point * 6.1)
        return away, normal, albedo * grain[:, None].clip(0.3, 2), glow

    def _facade(self, point, colour):
        """Albedo and emitted radiance of a house's wall: rows of windows, of which at dusk some are lit."""
        along = np.where(np.isfinite(point), point, 0)
        cells = np.stack([(along[:, 0] + along[:, 2]) / 1.8, (along[:, 1] - FLOOR) / 3.0], axis=-1)
        inside = (np.abs(cells % 1 - 0.5) < (0.28, 0.3)).all(axis=1)
        which = np.floor(cells).astype(int)
        lit = (np.sin(which @ [127.1, 311.7] + self.seed) * 43758.5453) % 1 < 0.35
        shine = (inside & lit & (self.kind == "dusk"))[:, None] * np.array([1.0, 0.7, 0.35]) * 1.2
        return np.where(inside[:, None], 0.25 * colour, colour), shine

    def _irradiance(self, point, normal):
        """Irradiance over pi (N, 3) of surfaces."""
        up = normal[:, 1:2]
        if self.kind == "room":
            return self._from_window(point, normal) + self._from_lamps(point, normal)
        sky = (self.sky + self.haze) / 2
        total = sky * (1 + up) / 2
        if self.power:
            facing = np.clip(normal @ self.sun, 0, 1)
            start = point + normal * 1e-2
            rays = np.broadcast_to(self.sun, point.shape).astype(float)
            clear = self._blocked(start, rays)
            total = total + (facing * clear)[:, None] * SUNLIGHT * self.power
        level = sky + SUNLIGHT * self.power * max(self.sun[1], 0)
        return total + self.ground * level * (1 - up) / 2 + self._from_lamps(point, normal)

    def _blocked(self, origin, rays):
        """1 where nothing is between a point and the sun, else 0."""
        free = np.ones(len(rays))
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1 / rays
            for low, high, _, _ in self.boxes:
                near, far = np.sort([(low - origin) * inverse, (high - origin) * inverse], axis=0)
                free[(near.max(axis=1) < far.min(axis=1)) & (far.min(axis=1) > 0)] = 0
            for centre, radius, _ in self.crowns:
                free[_sphere(origin, rays, centre, radius)[0] < FAR] = 0
        return free

    def _from_lamps(self, point, normal):
        total = np.zeros_like(point)
        for position, power, _ in self.lamps:
            toward = position - point
            squared = (toward**2).sum(axis=1, keepdims=True)
            cosine = np.clip((toward * normal).sum(axis=1, keepdims=True) / np.sqrt(squared), 0, 1)
            total += power * cosine / np.maximum(squared, 0.05)
        return total

    def _from_window(self, point, normal):
        steps = (np.arange(WINDOW // 4) + 0.5) / (WINDOW // 4)
        low, high = self.window
        axes = [axis for axis in range(3) if high[axis] - low[axis] > 1e-9]
        across = 3 - sum(axes)
        area = np.prod((high - low)[axes]) / len(steps) ** 2
        total = np.zeros(len(point))
        for first in steps:
            for second in steps:
                spot = low.copy()
                spot[axes] += (high - low)[axes] * (first, second)
                toward = spot - point
                squared = np.maximum((toward**2).sum(axis=1), 0.05)
                cosines = np.clip((toward * normal).sum(axis=1), 0, None) * np.abs(toward[:, across])
                total += cosines / squared**2 * area / np.pi
        (_, _), wall = self.shell
        pane = np.prod((high - low)[axes])
        size = self.shell[0][1] - self.shell[0][0]
        inside = 2 * (size[0] * size[1] + size[1] * size[2] + size[0] * size[2])
        shine = sum((4 * power for _, power, _ in self.lamps), np.zeros(3)) * np.pi
        mean = (wall + 0.75 + self.ground) / 3
        bounced = mean / (1 - mean.clip(0, 0.8)) * (self.bright * pane + shine) / inside
        return total[:, None] * self.bright + bounced

    def _noisy(self, points):
        """Smooth noise (N,) in about [-1, 1]."""
        return map_coordinates(self.noise, points.T % 32, order=1, mode="grid-wrap")


def _sphere(origin, rays, centre, radius):
    """Distance (N,), FAR where a ray misses it, and normals (N, 3)."""
    toward = centre - origin
    along = (toward * rays).sum(axis=1)
    reach = radius**2 - (toward**2).sum(axis=1) + along**2
    distance = np.where((reach > 0) & (along > 0), along - np.sqrt(np.maximum(reach, 0)), FAR)
    return distance, (origin + rays * distance[:, None] - centre) / radius
