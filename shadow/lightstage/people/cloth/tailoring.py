"""Parts that are sewn on a garment (plackets, cuffs, waistbands, pockets, lapels, belts, ties), and creases.

A part is a second layer of the garment's own mesh: it is cut by a scalar over the unposed surface, and raised
from the posed one. So it follows every fold.
"""

import numpy as np

from shadow.lightstage.figure import normalize, vertex_normals
from shadow.lightstage.mesh import add_lining, clip
from shadow.lightstage.people.body.anatomy import ARMS, LEGS, Person
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart
from shadow.lightstage.people.cloth.patterns import Fit, front_gap

Box = tuple[tuple[float, float], tuple[float, float], int, tuple[int, ...]]
Garment = tuple[np.ndarray, np.ndarray, np.ndarray]  # posed vertices, faces, unposed vertices


def sew_on(
    garment: Garment,
    inside: np.ndarray,
    height: np.ndarray | float,
    fabric: Fabric,
    region: np.ndarray | None = None,
    thickness: float = 0.003,
) -> list[MeshPart]:
    """Return a closed piece of cloth on a garment where `inside` (V,) is positive; empty if it is nowhere.

    height: metres (V,) of its face above the garment. thickness: metres of its edge, which may reach into the
    garment. region: (V,) of the garment's vertices; None is the trunk.
    """
    posed, faces, rest = garment
    if (inside > 0).sum() < 6:
        return []
    faces, rows = clip(faces, inside)
    if len(faces) < 6:
        return []
    lifted = posed + vertex_normals(posed, garment[1]) * np.broadcast_to(height, len(posed))[:, None]
    vertices, closed, source = add_lining(rows @ lifted, faces, thickness, np.inf)
    region = np.zeros(len(posed), int) if region is None else region
    # A row of the operator combines at most two vertices: the region is that of the nearer one.
    nearest = np.asarray(rows.argmax(axis=1)).ravel()
    return [MeshPart(vertices, closed, (rows @ rest)[source], fabric, region[nearest][source], sewn=True)]


def placket(garment: Garment, low: float, high: float, fabric: Fabric) -> list[MeshPart]:
    """Return the button strip down the front of a shirt."""
    x, y, z = garment[2].T
    inside = np.minimum.reduce([0.016 - np.abs(x), y - low, high - y, z])
    return sew_on(garment, inside, 0.0016, fabric, thickness=0.003)


def cuffs(person: Person, garment: Garment, region: np.ndarray, end: float, fabric: Fabric) -> list[MeshPart]:
    """Return cuffs at the ends of the sleeves, which cover the share `end` of the arm."""
    parts = []
    for k in ARMS:
        along, _, _ = person.limb_coordinates(k, garment[2])
        length = np.linalg.norm(np.diff(person.limb_joints(k), axis=0), axis=1).sum()
        inside = np.where(region == k, 0.055 - (end - along) * length, -1.0)
        parts += sew_on(garment, inside, 0.0025, fabric, region, thickness=0.004)
    return parts


def waistband(garment: Garment, top: float, fabric: Fabric) -> list[MeshPart]:
    """Return the waistband of trousers, with the fly below it."""
    x, y, z = garment[2].T
    band = np.minimum(y - (top - 0.038), 0.03 + top - y)
    fly = np.minimum.reduce([0.014 - np.abs(x - 0.014), y - (top - 0.16), top - 0.03 - y, z])
    return [
        piece for inside in (band, fly) for piece in sew_on(garment, inside, 0.0015, fabric, thickness=0.003)
    ]


def belt(
    garment: Garment, at: float, width: float, fabric: Fabric, buckle: Fabric, rng: np.random.Generator
) -> list[MeshPart]:
    """Return a belt at the height `at` of the rest body, with a buckle at the front."""
    _posed, _faces, rest = garment
    band = width / 2 - np.abs(rest[:, 1] - at)
    parts = sew_on(garment, band, 0.004, fabric, thickness=0.005)
    size = np.array([rng.uniform(0.016, 0.024), width / 2 + 0.004])
    off = np.abs(rest[:, :2] - [0.0, at]) / size
    frame = np.where(rest[:, 2] > 0, 1 - np.maximum(off[:, 0], off[:, 1]), -1.0) * 0.02
    return parts + sew_on(garment, frame, 0.0075, buckle, thickness=0.006)


def pockets(person: Person, garment: Garment, kind: str, fabric: Fabric) -> list[MeshPart]:
    """Return patch pockets.

    kind: "chest", one on a shirt; "hips", two with flaps on a jacket; or "seat", two on trousers.
    """
    x, y, z = garment[2].T
    head = person.skeleton.head
    chest, hip = head("spine02")[1] + 0.06, head("upperleg01.L")[1]
    # Centre and half the size, (x, y) in metres; front (1) or back (-1); sides.
    boxes: dict[str, list[Box]] = {
        "chest": [((0.085, chest), (0.055, 0.06), 1, (1,))],
        "hips": [
            ((0.105, hip + 0.05), (0.07, 0.075), 1, (-1, 1)),
            ((0.105, hip + 0.12), (0.078, 0.022), 1, (-1, 1)),
        ],
        "seat": [((0.085, hip + 0.04), (0.062, 0.07), -1, (-1, 1))],
    }
    parts: list[MeshPart] = []
    for level, (middle, half, facing, sides) in enumerate(boxes[kind]):
        for side in sides:
            off = np.abs(np.stack([x * side - middle[0], y - middle[1]], axis=1))
            inside = np.where(z * facing > 0, (half - off).min(axis=1), -1.0)
            parts += sew_on(garment, inside, 0.0018 * (1 + level), fabric, thickness=0.0025 + 0.0015 * level)
    return parts


def lapels(
    person: Person, fit: Fit, garment: Garment, fabric: Fabric, rng: np.random.Generator
) -> list[MeshPart]:
    """Return the lapels of a jacket: widest at the notch, and standing off with distance from the fold."""
    x, y, z = garment[2].T
    throat = person.skeleton.head("neck01")[1]
    low = throat - fit.vee if fit.vee else throat - rng.uniform(0.2, 0.34)
    notch, width = throat - rng.uniform(0.03, 0.06), rng.uniform(0.055, 0.1)
    edge = front_gap(person, fit, y) if fit.open_front else np.maximum(y - low, 0) / 1.6
    if fit.open_front and fit.vee:
        edge = np.maximum(edge, (y - low) / 1.6)
    share = np.clip((y - low) / (notch - low), 0, 1.15)
    beyond = np.abs(x) - edge  # metres outward from the fold
    peak = np.where(y > notch, (throat + 0.02 - y) * 1.2, width)  # it narrows from the notch to the collar
    inside = np.minimum.reduce([np.minimum(width * share**0.8, peak) - beyond, y - low - 0.002, z])
    height = 0.002 + 0.01 * np.clip(beyond / width, 0, 1) * (0.4 + 0.6 * share)
    return [
        piece
        for side in (-1, 1)
        for piece in sew_on(garment, np.where(x * side > 0, inside, -1.0), height, fabric)
    ]


def tie(person: Person, garment: Garment, fabric: Fabric, rng: np.random.Generator) -> list[MeshPart]:
    """Return a necktie on a shirt, with a knot at the throat and a blade that widens to its point."""
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
    return sew_on(garment, inside, height, fabric, thickness=0.006)


def creased(person: Person, rest: np.ndarray, region: np.ndarray, height: float) -> np.ndarray:
    """Return the height (V,) in metres of ironed creases along the front and back of each trouser leg."""
    out = np.zeros(len(rest))
    for k in LEGS:
        mine = np.flatnonzero(region == k)
        if not len(mine):
            continue
        along, axis, _ = person.limb_coordinates(k, rest[mine])
        local = rest[mine] - axis
        angle = np.arctan2(np.abs(local[:, 0]), np.abs(local[:, 2]))  # 0 at the front and at the back
        ridge = np.maximum(1 - angle / 0.3, 0) ** 1.5
        out[mine] = height * ridge * np.clip((along - 0.12) / 0.2, 0, 1)
    return out


def pleated(rest: np.ndarray, top: float, count: int, depth: float) -> np.ndarray:
    """Return the height (V,) in metres of knife pleats: zero at height `top`, `depth` below the hips."""
    around = np.arctan2(rest[:, 0], rest[:, 2]) / (2 * np.pi) * count
    saw = around - np.floor(around)
    ridge = np.where(saw < 0.8, saw / 0.8, (1 - saw) / 0.2)
    return depth * (ridge - 0.5) * np.clip((top - rest[:, 1]) / 0.15, 0, 1)


def open_front(fit: Fit, person: Person, garment: Garment) -> np.ndarray:
    """Return the posed vertices (V, 3) of a garment with an open front.

    Near the opening the fronts swing away from the body, more at lower heights.
    """
    posed, _faces, rest = garment
    x, y, z = rest.T
    chest = person.skeleton.head("spine02")[1]
    beyond = np.abs(x) - front_gap(person, fit, y)
    near = np.exp(-((np.maximum(beyond, 0) / 0.07) ** 2)) * (z > 0)
    lower = np.clip((chest - y) / 0.35, 0, 1)
    turned = person.bone("spine04")[:, :3]
    aside = normalize(np.stack([0.6 * np.sign(x), np.zeros(len(x)), np.full(len(x), 0.8)], axis=1)) @ turned.T
    return posed + aside * (fit.swing * near * lower)[:, None]
