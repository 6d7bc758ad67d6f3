"""Procedural albedo of cloth, hair, leather and skin, evaluated at ray hits, so that it is always sharp.

A fabric is a function of garment coordinates, u around the limb or trunk and v along it, in metres of the
unposed garment, and of the unposed position, for noise and prints. Sleeves and legs have their own
coordinates, so patterns break at the seams, as in sewn cloth.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

DARKEST, BRIGHTEST = 0.02, 0.9

Texture = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Fabric:
    """A procedural albedo.

    texture: (u (N,), v (N,), unposed position (N, 3)) -> linear albedo (N, 3). cloth: whether `replace_cloth`
    may replace it.
    """

    texture: Texture
    cloth: bool = False

    @classmethod
    def plain(cls, base: np.ndarray) -> "Fabric":
        """Return a fabric of one albedo (3,)."""
        return cls(lambda u, v, rest: np.broadcast_to(base, (len(u), 3)))

    def __call__(self, u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        return np.clip(self.texture(u, v, rest), DARKEST, BRIGHTEST)


@dataclass
class MeshPart:
    """A finished mesh of a person: skin, a garment, or an accessory."""

    vertices: np.ndarray  # (V, 3) posed, metres
    faces: np.ndarray  # (F, 3)
    rest: np.ndarray  # (V, 3) unposed, for the fabric
    fabric: Fabric
    # For all vertices or each (V,): index into anatomy.REGIONS, the limb or trunk of the garment coordinates;
    # index into records.REGIONS.
    region: np.ndarray | int = 0
    label: np.ndarray | int = 0
    sewn: bool = False  # whether it is sewn on a garment, and does not push out garments over both
    uv: np.ndarray | None = None  # (F, 3, 2) texture coordinates of the corners, in place of the garment's
    normals: np.ndarray | None = None  # (V, 3) unit, posed; None: those of the faces
    normal_map: np.ndarray | None = None  # (H, W, 3) directions in tangent space, with `uv`


class Noise:
    """Value noise in space, in [0, 1]: one periodic lattice, smoothly interpolated, for any wavelength."""

    SIZE = 32

    def __init__(self, rng: np.random.Generator) -> None:
        self.lattice = rng.random((self.SIZE,) * 3, dtype=np.float32).ravel()

    def __call__(self, points: np.ndarray, wavelength: float | np.ndarray) -> np.ndarray:
        scaled = (points / wavelength).astype(np.float32) + 400
        cell = scaled.astype(np.int32)
        f = scaled - cell
        f = f * f * (3 - 2 * f)
        n = self.SIZE
        x0, y0, z0 = (cell[:, k] & (n - 1) for k in range(3))
        x1, y1, z1 = ((cell[:, k] + 1) & (n - 1) for k in range(3))
        x0, x1, y0, y1 = x0 * (n * n), x1 * (n * n), y0 * n, y1 * n
        a, fx, fy, fz = self.lattice, f[:, 0], f[:, 1], f[:, 2]
        low = (a[x0 + y0 + z0] * (1 - fx) + a[x1 + y0 + z0] * fx) * (1 - fy) + (
            a[x0 + y1 + z0] * (1 - fx) + a[x1 + y1 + z0] * fx
        ) * fy
        high = (a[x0 + y0 + z1] * (1 - fx) + a[x1 + y0 + z1] * fx) * (1 - fy) + (
            a[x0 + y1 + z1] * (1 - fx) + a[x1 + y1 + z1] * fx
        ) * fy
        return low * (1 - fz) + high * fz

    def octaves(self, points: np.ndarray, wavelength: float) -> np.ndarray:
        """Return the sum of three octaves of the noise (N,) at points (N, 3), in [0, 1]."""
        return (
            self(points, wavelength) * 4 + self(points, wavelength / 2.1) * 2 + self(points, wavelength / 4.3)
        ) / 7


def hsv(hue: float, saturation: float, value: float) -> np.ndarray:
    """Convert HSV values in [0, 1] to linear RGB (3,), whose brightest channel is `value`."""
    ramp = np.abs((np.array([0, 4, 2]) / 6 + hue) % 1 * 6 - 3) - 1
    return value * (1 - saturation * (1 - np.clip(ramp, 0, 1)))


def colour(rng: np.random.Generator) -> np.ndarray:
    """Draw the colour of a garment: mostly black, grey, white, blue or brown, sometimes vivid."""
    kind = rng.choice(
        ["dark", "grey", "white", "navy", "earth", "muted", "vivid", "pastel"],
        p=[0.17, 0.13, 0.16, 0.13, 0.12, 0.12, 0.10, 0.07],
    )
    hue = rng.random()
    if kind == "dark":
        return hsv(hue, rng.uniform(0, 0.3), rng.uniform(0.022, 0.06))
    if kind == "grey":
        return hsv(hue, rng.uniform(0, 0.12), rng.uniform(0.08, 0.5))
    if kind == "white":
        return hsv(rng.uniform(0.05, 0.65), rng.uniform(0, 0.1), rng.uniform(0.6, 0.88))
    if kind == "navy":
        return hsv(rng.uniform(0.56, 0.66), rng.uniform(0.45, 0.85), rng.uniform(0.04, 0.35))
    if kind == "earth":
        return hsv(rng.uniform(0.02, 0.17), rng.uniform(0.3, 0.75), rng.uniform(0.06, 0.5))
    if kind == "muted":
        return hsv(hue, rng.uniform(0.2, 0.5), rng.uniform(0.06, 0.45))
    if kind == "vivid":
        return hsv(hue, rng.uniform(0.7, 0.97), rng.uniform(0.2, 0.75))
    return hsv(hue, rng.uniform(0.12, 0.3), rng.uniform(0.5, 0.85))


def contrasting(first: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw a second colour that contrasts with the first."""
    for _ in range(8):
        second = colour(rng)
        if abs(np.log(second.mean() / first.mean())) > 0.5 or np.abs(second - first).max() > 0.25:
            break
    return second


def _mix(a: np.ndarray, b: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Blend colours, (3,) or (N, 3), by the share (N,) of the second."""
    share = share[:, None]
    return a * (1 - share) + b * share


def _bar(x: np.ndarray, period: float, share: float) -> np.ndarray:
    """Return 1 in the first `share` of each period, 0 elsewhere."""
    return ((x / period) % 1 < share).astype(float)


def plain(rng: np.random.Generator) -> Texture:
    base = colour(rng)
    return lambda u, v, rest: np.broadcast_to(base, (len(u), 3))


def stripes(rng: np.random.Generator) -> Texture:
    base = colour(rng)
    second = contrasting(base, rng)
    period, share = rng.choice([0.012, 0.02, 0.04, 0.08]) * rng.uniform(0.7, 1.4), rng.uniform(0.15, 0.6)
    upright = rng.random() < 0.35
    return lambda u, v, rest: _mix(base, second, _bar(u if upright else v, period, share))


def checks(rng: np.random.Generator) -> Texture:
    base = colour(rng)
    second, third = contrasting(base, rng), colour(rng)
    period, share = rng.choice([0.01, 0.03, 0.07, 0.12]) * rng.uniform(0.7, 1.4), rng.uniform(0.25, 0.55)
    thin = rng.random() < 0.5

    def texture(u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        cloth = _mix(base, second, (_bar(u, period, share) + _bar(v, period, share)) / 2)
        if thin:
            lines = np.maximum(_bar(u + 0.4 * period, period, 0.06), _bar(v + 0.4 * period, period, 0.06))
            cloth = cloth * (1 - 0.7 * lines[:, None]) + third * 0.7 * lines[:, None]
        return cloth

    return texture


def dots(rng: np.random.Generator) -> Texture:
    base = colour(rng)
    second = contrasting(base, rng)
    period, radius = rng.uniform(0.012, 0.06), rng.uniform(0.15, 0.36)

    def texture(u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        row = np.floor(v / period)
        x, y = (u / period + 0.5 * (row % 2)) % 1 - 0.5, (v / period) % 1 - 0.5
        return _mix(base, second, (x * x + y * y < radius * radius).astype(float))

    return texture


def printed(rng: np.random.Generator) -> Texture:
    """Draw a plain cloth with a block, ring, blob or bars like lettering printed on the chest."""
    base = colour(rng)
    inks = np.stack([contrasting(base, rng) for _ in range(3)])
    kind, noise = rng.choice(["block", "ring", "bars", "blob"]), Noise(rng)
    height, half = rng.uniform(0.37, 0.46), rng.uniform(0.05, 0.13)

    def texture(u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        x, y = rest[:, 0], rest[:, 1] - height
        front = rest[:, 2] > 0
        inside = front & (np.abs(x) < half) & (np.abs(y) < half * 0.8)
        ink = (noise(rest, half * 0.6) * 2.999).astype(int)
        if kind == "ring":
            distance = np.hypot(x, y)
            inside = front & (distance < half) & (distance > 0.55 * half)
            ink = np.zeros(len(u), int)
        elif kind == "bars":
            inside &= (noise(rest, 0.018) > 0.45) & (_bar(y, 0.05, 0.6) > 0)
            ink = np.zeros(len(u), int)
        elif kind == "blob":
            inside = front & (np.hypot(x, y) < half * (0.6 + 0.8 * noise(rest, 0.07)))
        return np.where(inside[:, None], inks[ink], base)

    return texture


def denim(rng: np.random.Generator) -> Texture:
    base = hsv(rng.uniform(0.57, 0.63), rng.uniform(0.35, 0.7), rng.choice([0.06, 0.15, 0.3, 0.45]))
    if rng.random() < 0.15:
        base = hsv(0.6, 0.05, rng.choice([0.03, 0.12]))
    faded, noise = np.minimum(base * 2.2 + 0.05, 0.7), Noise(rng)
    wear = rng.uniform(0, 0.7)

    def texture(u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        front = np.clip(rest[:, 2] / 0.08, 0, 1)
        fade = wear * front * noise.octaves(rest, 0.15)
        weave = 0.85 + 0.3 * noise(np.stack([u * 1.5, v * 0.2, u * 0], 1), 0.0015)
        return _mix(base, faded, fade) * weave[:, None]

    return texture


def camouflage(rng: np.random.Generator) -> Texture:
    greens = np.stack(
        [hsv(rng.uniform(0.1, 0.33), rng.uniform(0.2, 0.6), x) for x in (0.03, 0.08, 0.17, 0.3)]
    )
    noise, size = Noise(rng), rng.uniform(0.05, 0.14)

    def texture(u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        level = noise.octaves(rest, size) * 0.8 + 0.2 * noise(rest + 3, size / 3)
        return greens[np.searchsorted([0.4, 0.5, 0.6], level)]

    return texture


def gradient(rng: np.random.Generator) -> Texture:
    top, bottom = colour(rng), colour(rng)
    start, stop = np.sort(rng.uniform(-0.7, 0.5, 2))
    return lambda u, v, rest: _mix(bottom, top, np.clip((rest[:, 1] - start) / (stop - start + 0.1), 0, 1))


def blocks(rng: np.random.Generator) -> Texture:
    """Draw horizontal blocks of colour, as on rugby shirts."""
    base = colour(rng)
    second, third = contrasting(base, rng), contrasting(base, rng)
    heights = np.sort(rng.uniform(-0.5, 0.5, 3))
    inks = np.stack([base, second, base, third])
    return lambda u, v, rest: inks[np.searchsorted(heights, rest[:, 1])]


def knit(rng: np.random.Generator) -> Texture:
    base, noise = colour(rng), Noise(rng)
    rib = rng.uniform(0.004, 0.012)
    depth = rng.uniform(0.1, 0.35)

    def texture(u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        ribs = 0.5 + 0.5 * np.sin(2 * np.pi * u / rib)
        return base * (1 - depth * ribs * (0.6 + 0.4 * noise(rest, 0.004)))[:, None]

    return texture


def streaks(rng: np.random.Generator) -> Texture:
    """Draw printed light and dark streaks that look like folds, so that networks do not trust them."""
    base, noise = colour(rng), Noise(rng)
    stretch = np.array([1.0, rng.uniform(0.15, 0.4), 1.0])[rng.permutation(3)]
    strength, size = rng.uniform(0.3, 0.8), rng.uniform(0.02, 0.05)
    return lambda u, v, rest: base * (1 - strength * noise.octaves(rest * stretch, size))[:, None] * 1.3


def floral(rng: np.random.Generator) -> Texture:
    base, noise = colour(rng), Noise(rng)
    petals = np.stack([contrasting(base, rng) for _ in range(3)])
    size = rng.uniform(0.015, 0.05)

    def texture(u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        level = noise(rest, size)
        kind = (noise(rest + 7, size * 1.7) * 2.999).astype(int)
        return np.where((level > 0.62)[:, None], petals[kind], base)

    return texture


def herringbone(rng: np.random.Generator) -> Texture:
    base = colour(rng)
    second, period = contrasting(base, rng) * 0.5 + base * 0.5, rng.uniform(0.006, 0.02)

    def texture(u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        slope = np.abs((u / (4 * period)) % 1 - 0.5) * 4 * period
        return _mix(base, second, _bar(v + 1.4 * slope, period, 0.5))

    return texture


def tie_dye(rng: np.random.Generator) -> Texture:
    inks, noise = np.stack([colour(rng) for _ in range(3)]), Noise(rng)
    centre = np.array([rng.uniform(-0.1, 0.1), rng.uniform(0.1, 0.4), 0.1])

    def texture(u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        distance = np.linalg.norm(rest - centre, axis=1) + 0.08 * noise.octaves(rest, 0.1)
        phase = (distance / 0.07) % 3
        low = phase.astype(int) % 3
        return _mix(inks[low], inks[(low + 1) % 3], phase - np.floor(phase))

    return texture


def add_weave(texture: Texture, rng: np.random.Generator) -> Texture:
    """Add small variations of dye and thread to a texture, since no cloth has a uniform colour."""
    noise, cloud, thread = Noise(rng), rng.uniform(0, 0.12), rng.uniform(0, 0.14)

    def woven_texture(u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        uneven = 1 + cloud * (noise(rest, 0.09) - 0.5) + thread * (noise(rest, 0.003) - 0.5)
        return texture(u, v, rest) * uneven[:, None]

    return woven_texture


# Relative frequencies of the families in all splits, and of families that are reserved for one split.
COMMON = {
    plain: 9,
    stripes: 2,
    checks: 2,
    printed: 2.5,
    knit: 1.5,
    gradient: 0.6,
    streaks: 0.8,
    camouflage: 0.5,
    dots: 0.8,
}
RESERVED = {"training": {}, "validation": {floral: 3.0}, "generalisation": {herringbone: 2.0, tie_dye: 2.5}}


def draw(rng: np.random.Generator, split: str, only: Callable | None = None) -> Fabric:
    """Draw a fabric of the split's families, or of the family `only`."""
    families = {**COMMON, **RESERVED[split]}
    if only is None:
        weights = np.array(list(families.values()))
        only = list(families)[rng.choice(len(families), p=weights / weights.sum())]
    return Fabric(add_weave(only(rng), rng), cloth=True)


def replace_cloth(fabrics: Sequence[Fabric], rng: np.random.Generator, split: str) -> list[Fabric]:
    """Replace all cloth among the fabrics; parts of the same cloth get the same new cloth."""
    others = {id(fabric): draw(rng, split) for fabric in fabrics if fabric.cloth}
    return [others.get(id(fabric), fabric) for fabric in fabrics]


def leather(rng: np.random.Generator) -> Fabric:
    """Draw a leather."""
    base = (
        colour(rng)
        if rng.random() < 0.35
        else hsv(rng.uniform(0.03, 0.1), rng.uniform(0.1, 0.7), rng.uniform(0.025, 0.2))
    )
    return Fabric(add_weave(lambda u, v, rest: np.broadcast_to(base, (len(u), 3)), rng))


def shoe(rng: np.random.Generator, sole_height: float) -> Fabric:
    """Draw the colours of a shoe's upper and of its sole, which is below `sole_height` metres at rest."""
    upper = colour(rng) if rng.random() < 0.6 else hsv(0.06, rng.uniform(0, 0.6), rng.uniform(0.025, 0.15))
    sole = rng.choice([0.03, 0.1, 0.7, 0.8]) * np.array([1, 0.98, 0.93])
    return Fabric(lambda u, v, rest: np.where((rest[:, 1] < sole_height)[:, None], sole, upper))


def hair_colour(rng: np.random.Generator) -> np.ndarray:
    """Draw the albedo (3,) of hair."""
    base = [
        np.array([0.022, 0.02, 0.018]),
        np.array([0.045, 0.028, 0.018]),
        np.array([0.12, 0.07, 0.035]),
        np.array([0.4, 0.28, 0.13]),
        np.array([0.22, 0.08, 0.03]),
        np.array([0.45, 0.44, 0.42]),
        hsv(rng.random(), 0.7, 0.4),
    ][rng.choice(7, p=[0.33, 0.25, 0.17, 0.1, 0.05, 0.08, 0.02])]
    return base * rng.uniform(0.85, 1.2)


def hair(rng: np.random.Generator) -> Fabric:
    """Draw a colour of hair, with strands and locks."""
    base, noise = hair_colour(rng), Noise(rng)

    def texture(u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        strand = noise(np.stack([rest[:, 0], rest[:, 1] * 0.06, rest[:, 2]], 1), 0.0035)
        lock = noise(np.stack([rest[:, 0], rest[:, 1] * 0.15, rest[:, 2]], 1), 0.016)
        return base * (0.55 + 0.5 * strand + 0.4 * lock)[:, None]

    return Fabric(texture)
