"""Chairs and stools under those who sit: as high as the thighs are, and turned as the pelvis is."""

import numpy as np
import trimesh

from shadow.lightstage.figure import unit
from shadow.lightstage.people.anatomy import LEGS
from shadow.lightstage.people.fabric import Fabric, Part
from shadow.lightstage.people.garments import Wardrobe

REACH = 0.22  # metres about the hips under which the seat carries
PRESSED = 0.012  # metres that flesh and cloth give way


def sit(wardrobe: Wardrobe, rng: np.random.Generator, cloth: Fabric) -> None:
    """Put a chair, with a back, or a stool under a person whose pose sits."""
    person = wardrobe.person
    root = person.transforms[person.base.names.index("root")]
    hips = np.mean([person.polyline(k)[0] for k in LEGS], axis=0)
    forward = unit((root[:, :3] @ [0, 0, 1.0]) * [1, 0, 1])
    axes = np.stack([np.cross([0, 1.0, 0], forward), [0, 1.0, 0], forward])  # rows: left, up, forward
    points = np.concatenate([part.vertices for part in wardrobe.parts])
    floor = points[:, 1].min()
    origin = root[:, :3] @ hips + root[:, 3]
    top = _height(wardrobe, axes, origin) + PRESSED
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
            place = [x * (width / 2 - leg), floor + below / 2, centre[2] + z * (depth / 2 - leg)]
            pieces.append((trimesh.creation.box([2 * leg, below, 2 * leg]), np.array(place)))
    if not stool:
        pieces += _back(rng, width, top, centre[2] - depth / 2 - _behind(points, axes, origin, depth), leg)
    for mesh, at in pieces:
        local = np.asarray(mesh.vertices)[mesh.faces].reshape(-1, 3) + at  # edges stay sharp
        placed = local @ axes + origin * [1, 0, 1]
        faces = np.arange(len(local)).reshape(-1, 3)
        wardrobe.parts.append(Part(placed, faces, local, np.zeros(len(local), int), cloth))


def _height(wardrobe: Wardrobe, axes: np.ndarray, origin: np.ndarray) -> float:
    """Metres at which thighs and buttocks end below, in their clothes that lie on them."""
    person, tights = wardrobe.person, wardrobe.person.base.tights
    posed = person.posed(tights.weights, person.tights_rest)
    local = (posed - origin) @ axes.T
    over = (np.abs(local[:, 0]) < REACH) & (local[:, 2] > -REACH) & (local[:, 2] < REACH)
    upper = person.tights_member[:, 0] > 0.3
    for k in LEGS:
        along, _, _ = person.limb_coordinates(k, person.tights_rest)
        upper |= (person.tights_member[:, k] > 0.5) & (along < 0.35)
    return float(np.percentile(posed[over & upper, 1], 1))


def _behind(points: np.ndarray, axes: np.ndarray, origin: np.ndarray, depth: float) -> float:
    """How far (metres) behind the seat its back has to stand, to clear the pelvis in its clothes."""
    local = (points - origin) @ axes.T
    low = (np.abs(local[:, 0]) < 0.2) & (np.abs(local[:, 1]) < 0.25)
    return max(0.0, -np.percentile(local[low, 2], 1) - depth / 2 + 0.06)


def _back(
    rng: np.random.Generator, width: float, top: float, at: float, leg: float
) -> list[tuple[trimesh.Trimesh, np.ndarray]]:
    """Two posts and two to five rails, or a board."""
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
