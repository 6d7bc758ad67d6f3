"""Chairs and stools for people who sit, at the height of the thighs and in the direction of the pelvis."""

import numpy as np
import trimesh

from shadow.lightstage.figure import normalize
from shadow.lightstage.people.body.anatomy import LEGS
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart
from shadow.lightstage.people.cloth.garments import Wardrobe

SEAT_RADIUS = 0.22  # metres around the hips in which the body rests on the seat
COMPRESSION = 0.012  # metres by which flesh and cloth give way


def sit(wardrobe: Wardrobe, rng: np.random.Generator, cloth: Fabric) -> None:
    """Put a chair or a stool under a seated person."""
    person = wardrobe.person
    root = person.bone("root")
    hips = np.mean([person.limb_joints(k)[0] for k in LEGS], axis=0)
    forward = normalize((root[:, :3] @ [0, 0, 1.0]) * [1, 0, 1])
    axes = np.stack([np.cross([0, 1.0, 0], forward), [0, 1.0, 0], forward])  # rows: left, up, forward
    points = np.concatenate([part.vertices for part in wardrobe.parts])
    floor = points[:, 1].min()
    origin = root[:, :3] @ hips + root[:, 3]
    top = _height(wardrobe, axes, origin) + COMPRESSION
    if top - floor < 0.25:
        return
    width, depth = rng.uniform(0.36, 0.46), rng.uniform(0.36, 0.44)
    thick = rng.uniform(0.02, 0.07)
    centre = np.array([0, top - thick / 2, 0.06])
    stool = rng.random() < 0.4 or wardrobe.packed
    if stool:
        seat = trimesh.creation.cylinder(rng.uniform(0.17, 0.21), thick, sections=48)
        seat.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
        width = depth = 0.28
    else:
        seat = trimesh.creation.box([width, thick, depth])
    pieces = [(seat, centre)]
    leg = rng.uniform(0.012, 0.024)
    below = top - thick - floor
    for x in (-1, 1):
        for z in (-1, 1):
            middle = [x * (width / 2 - leg), floor + below / 2, centre[2] + z * (depth / 2 - leg)]
            pieces.append((trimesh.creation.box([2 * leg, below, 2 * leg]), np.array(middle)))
    if not stool:
        pieces += _back(rng, width, top, centre[2] - depth / 2 - _behind(points, axes, origin, depth), leg)
    for mesh, at in pieces:
        local = np.asarray(mesh.vertices)[mesh.faces].reshape(-1, 3) + at  # edges stay sharp
        placed = local @ axes + origin * [1, 0, 1]
        faces = np.arange(len(local)).reshape(-1, 3)
        wardrobe.parts.append(MeshPart(placed, faces, local, cloth))


def _height(wardrobe: Wardrobe, axes: np.ndarray, origin: np.ndarray) -> float:
    """Return the height in metres of the underside of thighs and buttocks."""
    person, tights = wardrobe.person, wardrobe.person.base.tights
    posed = person.posed(tights.weights, person.tights_rest)
    local = (posed - origin) @ axes.T
    over = (np.abs(local[:, 0]) < SEAT_RADIUS) & (local[:, 2] > -SEAT_RADIUS) & (local[:, 2] < SEAT_RADIUS)
    upper = person.tights_regions[:, 0] > 0.3
    for k in LEGS:
        along, _, _ = person.limb_coordinates(k, person.tights_rest)
        upper |= (person.tights_regions[:, k] > 0.5) & (along < 0.35)
    return float(np.percentile(posed[over & upper, 1], 1))


def _behind(points: np.ndarray, axes: np.ndarray, origin: np.ndarray, depth: float) -> float:
    """Return the distance in metres from the seat to its back that clears the clothed pelvis."""
    local = (points - origin) @ axes.T
    low = (np.abs(local[:, 0]) < 0.2) & (np.abs(local[:, 1]) < 0.25)
    return max(0.0, -np.percentile(local[low, 2], 1) - depth / 2 + 0.06)


def _back(
    rng: np.random.Generator, width: float, top: float, at: float, leg: float
) -> list[tuple[trimesh.Trimesh, np.ndarray]]:
    """Return the back of a chair: two posts with two to four rails or one board."""
    tall = rng.uniform(0.32, 0.5)
    posts = [
        (
            trimesh.creation.box([2 * leg, tall, 2 * leg]),
            np.array([x * (width / 2 - leg), top + tall / 2, at]),
        )
        for x in (-1, 1)
    ]
    rails = int(rng.integers(1, 5))
    height = 0.5 * tall if rails == 1 else 0.045
    levels = [0.7 * tall] if rails == 1 else np.linspace(0.3, 0.94, rails) * tall
    boards = [(trimesh.creation.box([width, height, 0.014]), np.array([0, top + y, at])) for y in levels]
    return posts + boards
