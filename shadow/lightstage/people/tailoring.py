"""What a tailor sews onto a garment: plackets, cuffs, waistbands, pockets, lapels, belts, ties, creases.

Each is a piece of a second layer: cut out of the garment's own cloth by a scalar over its unposed surface,
and raised from where that cloth hangs. So it follows every fold, draped or simulated.
"""

from typing import Any

import numpy as np

from shadow.lightstage.figure import unit, vertex_normals
from shadow.lightstage.people.anatomy import ARMS, LEGS, Person
from shadow.lightstage.people.cloth import clip, line
from shadow.lightstage.people.fabric import Fabric, Part
from shadow.lightstage.people.patterns import Fit, gap_of_front

Garment = tuple[np.ndarray, np.ndarray, np.ndarray]  # posed vertices, faces, unposed vertices


def applied(
    garment: Garment,
    inside: np.ndarray,
    height: np.ndarray | float,
    fabric: Fabric,
    region: np.ndarray | None = None,
    thickness: float = 0.003,
) -> list[Part]:
    """A closed piece of cloth that lies on a garment where `inside` (V,) is positive; empty if it is nowhere.

    height: metres (V,) of its face above the garment; thickness: metres of its edge, which reaches into the
    garment where that is more. region: (V,) of its vertices, the trunk's if None.
    """
    posed, faces, rest = garment
    if (inside > 0).sum() < 6:
        return []
    faces, rows = clip(faces, inside)
    if len(faces) < 6:
        return []
    lifted = posed + vertex_normals(posed, garment[1]) * np.broadcast_to(height, len(posed))[:, None]
    vertices, closed, source = line(rows @ lifted, faces, thickness, np.inf)
    region = np.zeros(len(posed), int) if region is None else region
    # Rows of `clip` mix two vertices at most: the region is the nearer one's.
    nearest = np.asarray(rows.argmax(axis=1)).ravel()
    return [Part(vertices, closed, (rows @ rest)[source], region[nearest][source], fabric, sewn=True)]


def placket(garment: Garment, low: float, high: float, fabric: Fabric) -> list[Part]:
    """The strip down the front of a shirt that holds its buttons."""
    x, y, z = garment[2].T
    inside = np.minimum.reduce([0.016 - np.abs(x), y - low, high - y, z])
    return applied(garment, inside, 0.0016, fabric, thickness=0.003)


def cuffs(person: Person, garment: Garment, region: np.ndarray, end: float, fabric: Fabric) -> list[Part]:
    """Bands of double cloth about the ends of the sleeves; `end`: share of the arm that these cover."""
    parts = []
    for k in ARMS:
        along, _, _ = person.limb_coordinates(k, garment[2])
        length = np.linalg.norm(np.diff(person.polyline(k), axis=0), axis=1).sum()
        inside = np.where(region == k, 0.055 - (end - along) * length, -1.0)
        parts += applied(garment, inside, 0.0025, fabric, region, thickness=0.004)
    return parts


def waistband(garment: Garment, top: float, fabric: Fabric, height: float = 0.0015) -> list[Part]:
    """The band that trousers and skirts end in, with its fly below it."""
    x, y, z = garment[2].T
    band = np.minimum(y - (top - 0.038), 0.03 + top - y)
    fly = np.minimum.reduce([0.014 - np.abs(x - 0.014), y - (top - 0.16), top - 0.03 - y, z])
    return [
        piece
        for inside in (band, fly)
        for piece in applied(garment, inside, height, fabric, thickness=height + 0.0015)
    ]


def belt(
    garment: Garment, at: float, width: float, fabric: Fabric, buckle: Fabric, rng: np.random.Generator
) -> list[Part]:
    """A belt at a height of the rest body, with its buckle before the middle."""
    _posed, _faces, rest = garment
    band = width / 2 - np.abs(rest[:, 1] - at)
    parts = applied(garment, band, 0.004, fabric, thickness=0.005)
    size = np.array([rng.uniform(0.016, 0.024), width / 2 + 0.004])
    off = np.abs(rest[:, :2] - [0.0, at]) / size
    frame = np.where(rest[:, 2] > 0, 1 - np.maximum(off[:, 0], off[:, 1]), -1.0) * 0.02
    return parts + applied(garment, frame, 0.0075, buckle, thickness=0.006)


def pockets(person: Person, garment: Garment, kind: str, fabric: Fabric) -> list[Part]:
    """Patch pockets: one on the "chest" of a shirt, two at the "hips" of a jacket, with flaps, or two on the
    "seat" of trousers."""
    x, y, z = garment[2].T
    head = person.skeleton.head
    chest, hip = head("spine02")[1] + 0.06, head("upperleg01.L")[1]
    # Middle and half the size, (x, y) metres; to the front or the back; on which sides.
    boxes: dict[str, list[Any]] = {
        "chest": [((0.085, chest), (0.055, 0.06), 1, (1,))],
        "hips": [
            ((0.105, hip + 0.05), (0.07, 0.075), 1, (-1, 1)),
            ((0.105, hip + 0.12), (0.078, 0.022), 1, (-1, 1)),
        ],
        "seat": [((0.085, hip + 0.04), (0.062, 0.07), -1, (-1, 1))],
    }
    parts: list[Part] = []
    for level, (middle, half, facing, sides) in enumerate(boxes[kind]):
        for side in sides:
            off = np.abs(np.stack([x * side - middle[0], y - middle[1]], axis=1))
            inside = np.where(z * facing > 0, (half - off).min(axis=1), -1.0)
            parts += applied(garment, inside, 0.0018 * (1 + level), fabric, thickness=0.0025 + 0.0015 * level)
    return parts


def lapels(
    person: Person, fit: Fit, garment: Garment, fabric: Fabric, rng: np.random.Generator
) -> list[Part]:
    """The fronts of a jacket folded back along its opening: widest at the notch below the collar, standing
    off more the farther from the fold."""
    x, y, z = garment[2].T
    throat = person.skeleton.head("neck01")[1]
    low = throat - fit.vee if fit.vee else throat - rng.uniform(0.2, 0.34)
    notch, width = throat - rng.uniform(0.03, 0.06), rng.uniform(0.055, 0.1)
    edge = gap_of_front(person, fit, y) if fit.open_front else np.maximum(y - low, 0) / 1.6
    if fit.open_front and fit.vee:
        edge = np.maximum(edge, (y - low) / 1.6)
    share = np.clip((y - low) / (notch - low), 0, 1.15)
    beyond = np.abs(x) - edge  # metres from the fold, outwards
    peak = np.where(y > notch, (throat + 0.02 - y) * 1.2, width)  # above the notch it narrows to the collar
    inside = np.minimum.reduce([np.minimum(width * share**0.8, peak) - beyond, y - low - 0.002, z])
    height = 0.002 + 0.01 * np.clip(beyond / width, 0, 1) * (0.4 + 0.6 * share)
    return [
        piece
        for side in (-1, 1)
        for piece in applied(garment, np.where(x * side > 0, inside, -1.0), height, fabric)
    ]


def tie(person: Person, garment: Garment, fabric: Fabric, rng: np.random.Generator) -> list[Part]:
    """A necktie that lies on the shirt: a knot at the throat, a blade that widens to its point."""
    _posed, _faces, rest = garment
    x, y, z = rest.T
    throat = person.skeleton.head("neck01")[1]
    chest = np.where((np.abs(x) < 0.03) & (z > 0), y, -np.inf).max()
    top = min(chest, throat + 0.01)
    length, widest = rng.uniform(0.34, 0.46), rng.uniform(0.028, 0.045)
    down = top - y
    half = np.where(
        down < 0.045, 0.021 - 0.1 * down, 0.0145 + (widest - 0.0145) * np.clip(down / length, 0, 1)
    )
    point = (length + widest - down) * 0.9
    inside = np.where(z > 0, np.minimum.reduce([half, point, np.full(len(y), 0.06)]) - np.abs(x), -1.0)
    inside = np.minimum(inside, down + 0.004)
    knot = np.exp(-((np.maximum(down - 0.02, 0) / 0.018) ** 2))
    across = np.sqrt(np.clip(1 - (x / np.maximum(half, 0.005)) ** 2, 0, 1))
    height = (0.004 + 0.01 * knot) * (0.4 + 0.6 * across)
    return applied(garment, inside, height, fabric, thickness=0.006)


def creased(person: Person, rest: np.ndarray, region: np.ndarray, height: float) -> np.ndarray:
    """Metres (V,) by which ironed creases stand out, along the front and the back of each trouser leg."""
    out = np.zeros(len(rest))
    for k in LEGS:
        mine = np.flatnonzero(region == k)
        if not len(mine):
            continue
        along, axis, _ = person.limb_coordinates(k, rest[mine])
        local = rest[mine] - axis
        angle = np.arctan2(np.abs(local[:, 0]), np.abs(local[:, 2]))  # 0 straight before and straight behind
        ridge = np.maximum(1 - angle / 0.3, 0) ** 1.5
        out[mine] = height * ridge * np.clip((along - 0.12) / 0.2, 0, 1)
    return out


def pleated(rest: np.ndarray, top: float, count: int, depth: float) -> np.ndarray:
    """Metres (V,) by which knife pleats stand out, from nothing at height `top` to `depth` below the hips."""
    around = np.arctan2(rest[:, 0], rest[:, 2]) / (2 * np.pi) * count
    saw = around - np.floor(around)
    ridge = np.where(saw < 0.8, saw / 0.8, (1 - saw) / 0.2)
    return depth * (ridge - 0.5) * np.clip((top - rest[:, 1]) / 0.15, 0, 1)


def opened(fit: Fit, person: Person, garment: Garment) -> np.ndarray:
    """Posed vertices (V, 3) of a garment whose fronts stand open: near the opening they swing away from what
    is under them, more the lower they hang."""
    posed, _faces, rest = garment
    x, y, z = rest.T
    chest = person.skeleton.head("spine02")[1]
    beyond = np.abs(x) - gap_of_front(person, fit, y)
    near = np.exp(-((np.maximum(beyond, 0) / 0.07) ** 2)) * (z > 0)
    lower = np.clip((chest - y) / 0.35, 0, 1)
    names = person.base.names
    turned = person.transforms[names.index("spine04"), :, :3]
    aside = unit(np.stack([0.6 * np.sign(x), np.zeros(len(x)), np.full(len(x), 0.8)], axis=1)) @ turned.T
    return posed + aside * (fit.swing * near * lower)[:, None]
