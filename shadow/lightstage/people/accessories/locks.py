"""Locks of hair that stand off the head and cast shadows: tousled hair and fringes."""

import numpy as np

from shadow.lightstage.figure import normalize
from shadow.lightstage.people.accessories.hair import HAIRLINE_ANGLES, HAIRLINE_HEIGHTS, Skull
from shadow.lightstage.people.cloth.draping import fold_noise
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart

LOCK_RINGS, RING_CORNERS = 7, 5


def tousled(skull: Skull, fabric: Fabric, rng: np.random.Generator) -> MeshPart:
    """Draw locks over the top of the head, about 2 to 5 cm long, in a direction that varies smoothly."""
    line = np.interp(skull.around(skull.points), HAIRLINE_ANGLES, HAIRLINE_HEIGHTS)
    above = skull.points[:, 1] - skull.eyes[1] - line
    roots = rng.choice(np.flatnonzero(above > 0.01), 900, replace=False)
    points, out = skull.points[roots], skull.direction[roots]
    combed = normalize(rng.normal(size=3) * [1, 0.3, 1])
    wander = np.stack([fold_noise(points, rng, 0.06) for _ in range(3)], axis=1)
    flat = normalize(combed + 0.9 * wander)
    flat = normalize(flat - (flat * out).sum(axis=1, keepdims=True) * out)
    length = (
        rng.uniform(0.022, 0.05) * rng.uniform(0.6, 1.3, len(roots)) * np.clip(above[roots] / 0.04, 0.4, 1)
    )
    lift = rng.uniform(0.1, 0.45)
    return _grown(skull, points, out, flat, length, lift, rng.uniform(0.0035, 0.006), fabric, rng)


def fringe(skull: Skull, fabric: Fabric, rng: np.random.Generator) -> MeshPart:
    """Draw locks that hang over the forehead to above the brows."""
    around = skull.around(skull.points)
    line = skull.points[:, 1] - skull.eyes[1] - np.interp(around, HAIRLINE_ANGLES, HAIRLINE_HEIGHTS)
    front = np.flatnonzero((np.abs(line - 0.012) < 0.01) & (around < 58))
    roots = rng.choice(front, min(200, len(front)), replace=False)
    points, out = skull.points[roots], skull.direction[roots]
    swept = rng.normal() * 0.5
    down = normalize(np.array([swept, -1.0, 0.25]) + 0.12 * rng.normal(size=(len(roots), 3)))
    fall = points[:, 1] - skull.eyes[1] - rng.uniform(0.026, 0.042)
    length = np.clip(fall, 0.012, 0.07) * rng.uniform(0.85, 1.1, len(roots))
    return _grown(skull, points, out, down, length, 0.3, rng.uniform(0.0017, 0.0028), fabric, rng)


def _grown(
    skull: Skull,
    points: np.ndarray,
    out: np.ndarray,
    along: np.ndarray,
    length: np.ndarray,
    lift: float,
    radius: float,
    fabric: Fabric,
    rng: np.random.Generator,
) -> MeshPart:
    """Return locks as closed, tapered tubes from points (L, 3) of the skull.

    A lock follows its direction `along` (L, 3). It first rises along `out` (L, 3) by the share `lift` of its
    length, and then sinks.
    """
    t = np.linspace(0, 1, LOCK_RINGS)[None, :, None]
    rise = lift * np.sin(np.pi * np.minimum(0.75 * t + 0.05, 1))
    path = points[:, None] + length[:, None, None] * (along[:, None] * t + out[:, None] * (rise + 0.15))
    path[:, 0] = points - 0.003 * out  # roots are below the skin
    step = normalize(np.gradient(path, axis=1))
    side = normalize(np.cross(step, out[:, None] + 0.01))
    up = np.cross(side, step)
    thick = radius * rng.uniform(0.7, 1.3, len(points))[:, None, None] * (1 - t**2) ** 0.5
    angle = np.linspace(0, 2 * np.pi, RING_CORNERS, endpoint=False)
    spoke = np.cos(angle)[:, None] * side[:, :, None] + 0.6 * np.sin(angle)[:, None] * up[:, :, None]
    rings = path[:, :, None] + thick[:, :, None] * spoke
    rings = np.concatenate([rings.mean(axis=2, keepdims=True).repeat(RING_CORNERS, 2)[:, :1], rings], axis=1)
    count = LOCK_RINGS + 1
    a = np.arange(count - 1)[:, None] * RING_CORNERS + np.arange(RING_CORNERS)
    b = np.arange(count - 1)[:, None] * RING_CORNERS + (np.arange(RING_CORNERS) + 1) % RING_CORNERS
    c, d = a + RING_CORNERS, b + RING_CORNERS
    one = np.concatenate([np.stack([a, b, c], -1), np.stack([b, d, c], -1)])
    faces = one.reshape(-1, 3)[None] + (np.arange(len(points)) * count * RING_CORNERS)[:, None, None]
    vertices = rings.reshape(-1, 3)
    faces = faces.reshape(-1, 3)
    corners = vertices[faces]
    volume = (np.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]).sum()
    return skull.part(vertices, faces if volume > 0 else faces[:, ::-1], fabric)
