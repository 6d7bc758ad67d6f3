"""Things that people wear or carry on the body: shoulder bags, backpacks, scarves."""

import numpy as np
import trimesh
from scipy.ndimage import median_filter

from shadow.lightstage.figure import normalize, outwards
from shadow.lightstage.mesh import loft
from shadow.lightstage.people.cloth import fabric
from shadow.lightstage.people.cloth.draping import fold_noise
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart
from shadow.lightstage.people.cloth.garments import Wardrobe


def carry(wardrobe: Wardrobe, rng: np.random.Generator, split: str) -> None:
    """Draw which of these a person carries, usually none, and put them on."""
    if rng.random() < 0.10:
        shoulder_bag(wardrobe, rng, fabric.leather(rng))
    elif rng.random() < 0.08:
        backpack(wardrobe, rng, fabric.draw(rng, split, fabric.plain))
    if rng.random() < 0.07:
        scarf(wardrobe, rng, fabric.draw(rng, split))


def _box(size: np.ndarray, rounded: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of a box around the origin; `rounded`: 0 is sharp, 1 is an ellipsoid."""
    ball = trimesh.creation.icosphere(4)
    point = np.asarray(ball.vertices)
    power = 2 + 14 * (1 - rounded)
    point = point / (np.abs(point) ** power).sum(axis=1, keepdims=True) ** (1 / power)
    return point * size / 2, np.asarray(ball.faces)


def _ribbon(
    path: np.ndarray, outward: np.ndarray, width: float, thickness: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of a flat band along a path (N, 3), whose face points to `outward` (N, 3)."""
    along = normalize(np.gradient(path, axis=0))
    side = normalize(np.cross(along, outward))
    out = normalize(np.cross(side, along))
    corners = [(-1, 0), (-1, 1), (-0.6, 1.25), (0.6, 1.25), (1, 1), (1, 0), (0, -0.5)]
    rings = np.stack([path + side * (x * width / 2) + out * (y * thickness) for x, y in corners], axis=1)
    vertices = rings.reshape(-1, 3)
    centre = np.repeat(path + out * thickness * 0.4, len(corners), axis=0)
    return vertices, outwards(vertices, loft(rings, closed=True), centre)


def _wrap(
    wardrobe: Wardrobe, path: np.ndarray, centre: np.ndarray, lift: float
) -> tuple[np.ndarray, np.ndarray]:
    """Move a path (N, 3) to the outermost cloth of the trunk, `lift` metres above it.

    Each point moves along its ray from `centre` (N, 3). Returns the path and the outward normals (N, 3).
    """
    points, normals, member, _ = wardrobe.worn
    chest, throat = wardrobe.person.bone("spine02"), wardrobe.person.skeleton.head("neck01")[1]
    height = (points - chest[:, 3]) @ chest[:, :3][:, 1]  # in the rest pose: straps pass beside the neck
    trunk = (member[:, 0] > 0.6) & (height < throat + 0.02)
    points, normals = points[trunk], normals[trunk]
    out = normalize(path - centre)
    wrapped, facing = path.copy(), out.copy()
    for i, (base, ray) in enumerate(zip(centre, out, strict=True)):
        local = points - base
        depth = local @ ray
        off = np.linalg.norm(local - depth[:, None] * ray, axis=1)
        near = np.flatnonzero((off < 0.03) & (depth > 0) & (depth < 0.42))
        if len(near):
            best = near[np.argmax(depth[near])]
            wrapped[i], facing[i] = base + ray * (depth[best] + lift), normals[best]
    away = np.linalg.norm(wrapped - centre, axis=1)
    wrapped = centre + out * median_filter(away, 7, mode="nearest")[:, None]
    for _ in range(6):  # smooth the path, since a strap is taut
        wrapped[1:-1] = (wrapped[:-2] + wrapped[1:-1] * 2 + wrapped[2:]) / 4
        facing[1:-1] = normalize(facing[:-2] + facing[1:-1] + facing[2:])
    return wrapped, normalize(facing)


def shoulder_bag(wardrobe: Wardrobe, rng: np.random.Generator, cloth: Fabric) -> None:
    """Put on a bag at one hip, with a strap across the trunk from the other shoulder."""
    person, head = wardrobe.person, wardrobe.person.skeleton.head
    side = rng.choice([-1.0, 1.0])
    # Rays from the middle of the trunk, in the plane through one shoulder, beside the neck, and the other
    # hip.
    shoulder = person.moved("spine02", head("clavicle.L") * [0, 1, 1] + [-side * 0.075, 0.05, 0])
    hip = person.moved("root", head("upperleg01.L") * [side, 1, 1] + [side * 0.03, 0.03, 0])
    middle = (shoulder + hip) / 2
    forward = person.bone("spine02")[:, :3] @ np.array([0, 0, 1.0])
    angle = np.linspace(0, 2 * np.pi, 80)
    spoke = np.cos(angle)[:, None] * (shoulder - middle) + np.sin(angle)[:, None] * forward * 0.12
    wrapped, facing = _wrap(wardrobe, middle + spoke, np.tile(middle, (80, 1)), 0.004)
    vertices, faces = _ribbon(wrapped, facing, rng.uniform(0.02, 0.05), 0.003)
    wardrobe.parts.append(MeshPart(vertices, faces, vertices, cloth))
    size = np.array([rng.uniform(0.05, 0.1), rng.uniform(0.16, 0.3), rng.uniform(0.2, 0.32)])
    points, faces = _box(size, 0.3)
    hip = head("upperleg01.L") * [side, 1, 1] + [side * (0.12 + size[0] / 2), -0.02, -0.02]
    points = points + 0.004 * fold_noise(points, rng, 0.1)[:, None]
    wardrobe.parts.append(MeshPart(person.moved("root", points + hip), faces, points, cloth))


def backpack(wardrobe: Wardrobe, rng: np.random.Generator, cloth: Fabric) -> None:
    """Put on a backpack with two straps over the shoulders."""
    wardrobe.packed = True
    person, head = wardrobe.person, wardrobe.person.skeleton.head
    size = np.array([rng.uniform(0.26, 0.34), rng.uniform(0.36, 0.5), rng.uniform(0.12, 0.2)])
    points, faces = _box(size, 0.45)
    points = points + 0.005 * fold_noise(points, rng, 0.12)[:, None]
    back = person.tights_rest[:, 2].min()
    centre = np.array([0, head("spine02")[1] + 0.05, back - size[2] / 2 - 0.01])
    wardrobe.parts.append(MeshPart(person.moved("spine02", points + centre), faces, points, cloth))
    for side in (-1.0, 1.0):
        # From the pack over the shoulder and down the chest, then around the flank back to the pack.
        over = np.linspace(-0.3 * np.pi, 0.5 * np.pi, 32)
        around = np.linspace(0, 0.8 * np.pi, 32)[1:]
        share = (around / around[-1])[:, None]
        middle = np.array([0.0, head("spine01")[1] - 0.05, head("spine01")[2]])
        sunk = np.array([[side * 0.125, 0, 0]]) * (1 - share) - [[0, 0.24, 0]] * share
        axis = middle + np.concatenate([np.tile([[side * 0.125, 0, 0]], (32, 1)), sunk])
        spoke = [
            np.stack([0 * over, np.cos(over), np.sin(over)], axis=1),
            np.stack([side * np.sin(around), 0 * around, np.cos(around)], axis=1),
        ]
        path = axis + 0.12 * np.concatenate(spoke)
        path, axis = person.moved("spine02", path), person.moved("spine02", axis)
        wrapped, facing = _wrap(wardrobe, path, axis, 0.005)
        vertices, faces = _ribbon(wrapped, facing, 0.045, 0.006)
        wardrobe.parts.append(MeshPart(vertices, faces, vertices, cloth))


def scarf(wardrobe: Wardrobe, rng: np.random.Generator, cloth: Fabric) -> None:
    """Put on a wound scarf: two lumpy rings around the neck."""
    neck = wardrobe.person.skeleton.head("neck01")
    for turn in range(2):
        angle, around = np.meshgrid(
            np.linspace(0, 2 * np.pi, 96, endpoint=False),
            np.linspace(0, 2 * np.pi, 28, endpoint=False),
            indexing="ij",
        )
        radius = 0.085 + 0.012 * turn
        shape = np.stack(
            [np.sin(angle) * radius, np.full(angle.shape, 0.035 - 0.03 * turn), np.cos(angle) * radius * 1.1],
            -1,
        )
        shape[..., 1] -= 0.035 * np.cos(angle) + 0.008 * np.sin(angle + 3 * turn)
        bulge = (0.024 + 0.006 * turn) * (
            1
            + 0.16
            * fold_noise(
                np.stack([around * 0.03, angle * 0.012, angle * 0], -1).reshape(-1, 3), rng, 0.05
            ).reshape(angle.shape)
        )
        out = normalize(shape * [1, 0, 1])
        spoke = out * np.cos(around)[..., None] + np.array([0, 1.0, 0]) * np.sin(around)[..., None]
        points = (shape + spoke * bulge[..., None]).reshape(-1, 3) + neck + [0, 0.01, 0.012]
        ids = np.arange(96 * 28).reshape(96, 28)
        a, b = ids, np.roll(ids, -1, axis=1)
        c, d = np.roll(ids, -1, axis=0), np.roll(np.roll(ids, -1, axis=0), -1, axis=1)
        faces = np.concatenate(
            [np.stack([a.ravel(), c.ravel(), b.ravel()], 1), np.stack([b.ravel(), c.ravel(), d.ravel()], 1)]
        )
        middle = (
            np.repeat(shape.reshape(96, 28, 3)[:, :1], 28, axis=1).reshape(-1, 3) + neck + [0, 0.01, 0.012]
        )
        faces = outwards(points, faces, middle)
        wardrobe.parts.append(MeshPart(wardrobe.person.moved("neck01", points), faces, points, cloth))
