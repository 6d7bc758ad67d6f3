"""Glasses: rims, bridge and temples as tubes, some with dark lenses."""

import numpy as np

from shadow.data.records import REGIONS
from shadow.lightstage.figure import normalize, outwards
from shadow.lightstage.mesh import loft
from shadow.lightstage.people.accessories.hair import Skull
from shadow.lightstage.people.body.anatomy import Person
from shadow.lightstage.people.body.skeleton import SIDES
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart

LENS_DISTANCE = 0.022  # metres from the centre of an eyeball to the plane of the lenses
TUBE_SIDES = 8


def tube(path: np.ndarray, radius: float, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of a tube along a path (N, 3) in metres: a ring, or with pointed ends."""
    if closed:
        along = normalize(np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0))
    else:
        along = normalize(np.gradient(path, axis=0))
    helper = np.eye(3)[np.argmin(np.abs(along).mean(axis=0))]
    side = normalize(np.cross(along, helper))
    up = np.cross(side, along)
    angle = np.linspace(0, 2 * np.pi, TUBE_SIDES, endpoint=False)
    spoke = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * up[:, None]
    rings = path[:, None] + spoke * radius
    if closed:
        rings = np.concatenate([rings, rings[:1]])
    else:
        first, last = (np.tile(path[at], (1, TUBE_SIDES, 1)) for at in (0, -1))
        rings = np.concatenate([first, rings, last])
    vertices, middle = rings.reshape(-1, 3), np.repeat(rings.mean(axis=1), TUBE_SIDES, axis=0)
    return vertices, outwards(vertices, loft(rings, closed=True), middle)


def glasses(person: Person, skull: Skull, rng: np.random.Generator) -> list[MeshPart]:
    """Draw a pair of glasses: thin or thick, round or square, clear or dark."""
    eyes = person.eyes
    frame = Fabric.plain(rng.choice([0.025, 0.12, 0.4]) * np.array([1.0, rng.uniform(0.6, 1), 0.7]))
    dark = rng.random() < 0.35
    radius = rng.uniform(0.0012, 0.0028)
    half = np.array([rng.uniform(0.022, 0.027), rng.uniform(0.016, 0.023)])
    power = rng.uniform(2, 5)  # of the superellipse: round to square
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    curve = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outline = half * curve / (np.abs(curve) ** power).sum(axis=1, keepdims=True) ** (1 / power)
    skin = person.base.body.rows @ person.rest
    pieces, inner = [], []
    for eye in eyes:
        side = SIDES["L"] if eye[0] > 0 else SIDES["R"]
        middle = eye + [side * 0.001, -0.004, LENS_DISTANCE]
        ring = np.concatenate([middle[:2] + outline, np.full((48, 1), middle[2])], axis=1)
        ring[:, 2] -= 0.15 * np.maximum((ring[:, 0] - eye[0]) * side, 0)  # frames curve around the face
        pieces.append((*tube(ring, radius, closed=True), frame))
        inner.append(ring[np.argmin(ring[:, 0] * side)])
        if dark:
            pieces.append((*_lens(ring), Fabric.plain(np.full(3, 0.025))))
        hinge = ring[np.argmax(ring[:, 0] * side)] + [0, 0.006, 0]
        ear = np.array([side * (skull.half_width + 0.004), eye[1] + 0.002, skull.centre[2] - 0.004])
        # The temple runs beside the skin at its height.
        near = np.abs(skin[:, 1] - eye[1]) < 0.012
        beside = np.abs(skin[near & (skin[:, 2] > ear[2] + 0.02), 0]).max(initial=0.05)
        knee = np.array([side * max(beside, abs(hinge[0])), eye[1] + 0.004, hinge[2] - 0.012])
        bow = np.concatenate([np.linspace(hinge, knee, 5), np.linspace(knee, ear, 16)[1:]])
        pieces.append((*tube(bow, radius, closed=False), frame))
    ends = np.array(inner)
    share = np.linspace(0, 1, 10)[:, None]
    bridge = ends[0] * (1 - share) + ends[1] * share + np.array([0, 0.006, 0.004]) * np.sin(np.pi * share)
    pieces.append((*tube(bridge, radius, closed=False), frame))
    label = REGIONS.index("face")
    return [
        MeshPart(skull.posed(points), faces, points, fabric, label=label) for points, faces, fabric in pieces
    ]


def _lens(ring: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of a slightly curved lens, front and back, in a rim (N, 3)."""
    count = len(ring)
    rim = np.arange(count)
    after = np.roll(rim, -1)
    front, back = (np.mean(ring, axis=0) + [0, 0, bulge] for bulge in (0.003, -0.0005))
    cap = np.stack([rim, after, np.full(count, count)], axis=1)
    points = np.concatenate([ring, front[None], back[None]])
    faces = np.concatenate([cap, np.stack([after, rim, np.full(count, count + 1)], axis=1)])
    return points, faces
