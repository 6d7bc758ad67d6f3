"""Locks of hair that stand off the head and cast shadows: tousled tops, fringes, stray strands."""

import numpy as np

from shadow.lightstage.figure import unit
from shadow.lightstage.people.cloth import fold_noise
from shadow.lightstage.people.fabric import Fabric, Part
from shadow.lightstage.people.hair import AROUND, HAIRLINE, Skull

STEPS, SIDES = 7, 5  # rings of a lock, and the corners of each


def tousled(skull: Skull, fabric: Fabric, rng: np.random.Generator) -> Part:
    """Locks all over the top of the head, in a direction that wanders, 2 to 5 cm long."""
    above = skull.points[:, 1] - skull.eyes[1] - np.interp(skull.around(skull.points), AROUND, HAIRLINE)
    roots = rng.choice(np.flatnonzero(above > 0.01), 900, replace=False)
    points, out = skull.points[roots], skull.direction[roots]
    combed = unit(rng.normal(size=3) * [1, 0.3, 1])
    wander = np.stack([fold_noise(points, rng, 0.06) for _ in range(3)], axis=1)
    flat = unit(combed + 0.9 * wander)
    flat = unit(flat - (flat * out).sum(axis=1, keepdims=True) * out)
    length = (
        rng.uniform(0.022, 0.05) * rng.uniform(0.6, 1.3, len(roots)) * np.clip(above[roots] / 0.04, 0.4, 1)
    )
    lift = rng.uniform(0.1, 0.45)
    return _grown(skull, points, out, flat, length, lift, rng.uniform(0.0035, 0.006), fabric, rng)


def fringe(skull: Skull, fabric: Fabric, rng: np.random.Generator) -> Part:
    """Locks that fall over the forehead, to above the brows, and shade it."""
    around = skull.around(skull.points)
    line = skull.points[:, 1] - skull.eyes[1] - np.interp(around, AROUND, HAIRLINE)
    front = np.flatnonzero((np.abs(line - 0.012) < 0.01) & (around < 58))
    roots = rng.choice(front, min(200, len(front)), replace=False)
    points, out = skull.points[roots], skull.direction[roots]
    swept = rng.normal() * 0.5
    down = unit(np.array([swept, -1.0, 0.25]) + 0.12 * rng.normal(size=(len(roots), 3)))
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
) -> Part:
    """Locks as closed, tapered tubes from points (L, 3) of the skull: they rise as far as `lift` says, then
    follow the directions `along` (L, 3) and sink."""
    t = np.linspace(0, 1, STEPS)[None, :, None]
    rise = lift * np.sin(np.pi * np.minimum(0.75 * t + 0.05, 1))
    path = points[:, None] + length[:, None, None] * (along[:, None] * t + out[:, None] * (rise + 0.15))
    path[:, 0] = points - 0.003 * out  # roots are in the skin
    step = unit(np.gradient(path, axis=1))
    side = unit(np.cross(step, out[:, None] + 0.01))
    up = np.cross(side, step)
    thick = radius * rng.uniform(0.7, 1.3, len(points))[:, None, None] * (1 - t**2) ** 0.5
    angle = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
    spoke = np.cos(angle)[:, None] * side[:, :, None] + 0.6 * np.sin(angle)[:, None] * up[:, :, None]
    rings = path[:, :, None] + thick[:, :, None] * spoke
    rings = np.concatenate([rings.mean(axis=2, keepdims=True).repeat(SIDES, 2)[:, :1], rings], axis=1)
    count = STEPS + 1
    a = np.arange(count - 1)[:, None] * SIDES + np.arange(SIDES)
    b = np.arange(count - 1)[:, None] * SIDES + (np.arange(SIDES) + 1) % SIDES
    one = np.concatenate([np.stack([a, b, a + SIDES], -1), np.stack([b, b + SIDES, a + SIDES], -1)])
    faces = one.reshape(-1, 3)[None] + (np.arange(len(points)) * count * SIDES)[:, None, None]
    vertices = rings.reshape(-1, 3)
    faces = faces.reshape(-1, 3)
    corners = vertices[faces]
    volume = (np.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]).sum()
    return skull.part(vertices, faces if volume > 0 else faces[:, ::-1], fabric)
