"""Hand-held objects: books, binders, phones, boxes, bags, sticks."""

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from shadow.lightstage.figure import normalize, outwards
from shadow.lightstage.people.accessories.glasses import tube
from shadow.lightstage.people.body.anatomy import ARMS
from shadow.lightstage.people.body.skeleton import rotation
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart
from shadow.lightstage.people.cloth.garments import Wardrobe

# Width, height and thickness in metres, and the relative range in which they vary.
SIZES = {
    "binder": ((0.28, 0.32, 0.05), 0.2),
    "folder": ((0.23, 0.31, 0.006), 0.1),
    "book": ((0.15, 0.22, 0.025), 0.3),
    "tablet": ((0.18, 0.25, 0.008), 0.15),
    "phone": ((0.073, 0.15, 0.009), 0.08),
    "box": ((0.2, 0.14, 0.12), 0.4),
    "stick": ((0.022, 0.8, 0.022), 0.35),
    "bag": ((0.32, 0.3, 0.1), 0.25),
    "case": ((0.42, 0.3, 0.09), 0.12),
    "crate": ((0.4, 0.26, 0.28), 0.25),
}
MAX_PENETRATION = 0.012  # metres into clothes, which give way
TILTS = (0, 20, -20, 40, -40, 60, -60)  # degrees: the first one without a collision is used


@dataclass(frozen=True)
class Grip:
    """The grip of a posed hand: its centre, and unit axes toward the thumb, along the fingers, and out of the
    palm."""

    at: np.ndarray
    across: np.ndarray
    along: np.ndarray
    palm: np.ndarray

    @classmethod
    def of(cls, wardrobe: Wardrobe, side: str) -> "Grip":
        """Return the grip of the hand of a side, "L" or "R"."""
        head = wardrobe.person.skeleton.head
        knuckle = (head(f"finger2-1.{side}") + head(f"finger5-1.{side}")) / 2
        along = normalize(knuckle - head(f"wrist.{side}"))
        across = normalize(head(f"finger2-1.{side}") - head(f"finger5-1.{side}"))
        palm = (1 if side == "L" else -1) * normalize(np.cross(along, across))
        bone = wardrobe.person.bone(f"wrist.{side}")
        turned = bone[:, :3]
        at = turned @ (knuckle + 0.02 * along) + bone[:, 3]
        return cls(at, turned @ normalize(np.cross(palm, along) * (across @ np.cross(palm, along))),
                   turned @ along, turned @ palm)  # fmt: skip


def hold(wardrobe: Wardrobe, rng: np.random.Generator, side: str, thing: str, cloth: Fabric) -> bool:
    """Put an object of SIZES into a hand ("L", "R") or between both ("both").

    Returns whether there was room for it.
    """
    usual, spread = SIZES[thing]
    size = np.array(usual) * rng.uniform(1 - spread, 1 + spread)
    if side == "both":
        return _between_hands(wardrobe, size, cloth)
    grip = Grip.of(wardrobe, side)
    body = Surroundings(wardrobe, side)
    if thing in ("bag", "case"):
        return _hang(wardrobe, grip, body, size, cloth, rng)
    # Direction in the plane of the palm, in degrees: 0 is toward the thumb, 90 toward the finger tips.
    leaning = {"phone": 0, "stick": 0, "box": 90}.get(thing, rng.uniform(-30, 110)) + rng.normal() * 8
    long = np.cos(np.radians(leaning)) * grip.across + np.sin(np.radians(leaning)) * grip.along
    aside = np.cross(grip.palm, long)
    own = rotation(long, rng.normal() * 10) @ rotation(aside, rng.normal() * 10)
    beyond = {"phone": 0.02, "stick": rng.uniform(-0.3, 0.3) * size[1], "box": 0.03}.get(
        thing, size[1] / 2 - rng.uniform(0.03, 0.07)
    )
    solid = _solid(size, rounded=0.004 if thing in ("phone", "tablet") else 0.0)
    for tilt in TILTS:
        turned = rotation(aside, tilt) @ own
        axes = np.stack([aside, long, grip.palm]) @ turned.T
        points = solid @ axes + grip.at + axes[1] * beyond + grip.palm * (0.016 + size[2] / 2)
        if body.depth(points) < MAX_PENETRATION:
            _add(wardrobe, points, solid, cloth)
            return True
    return False


class Surroundings:
    """The clothed trunk, legs and other arm, with which a held object must not collide."""

    def __init__(self, wardrobe: Wardrobe, side: str) -> None:
        points, normals, member, _ = wardrobe.worn
        others = (
            member[:, ARMS["LR".index(side)]] < 0.5 if side in ("L", "R") else member[:, ARMS].sum(1) < 0.5
        )
        self.points, self.normals = points[others], normals[others]
        self.tree = cKDTree(self.points)

    def depth(self, points: np.ndarray) -> float:
        """Return the largest depth in metres of points (N, 3) inside the body."""
        near = self.tree.query(points)[1]
        depth = -np.einsum("ij,ij->i", points - self.points[near], self.normals[near])
        return float(np.where(depth < 0.15, depth, 0).max())


def _solid(size: np.ndarray, rounded: float = 0.0) -> np.ndarray:
    """Return the corners (3F, 3) of the triangles of a finely divided box around the origin."""
    box = trimesh.creation.box(np.ones(3)).subdivide().subdivide().subdivide()
    points = np.asarray(box.vertices)
    if rounded:
        # Move the corners of the outline inward along the diagonal.
        corner = np.clip(np.abs(points[:, :2]).min(axis=1) - 0.4, 0, 1) * 10
        points = points * (1 - np.stack([corner, corner, 0 * corner], 1) * rounded / size.min() * 0.1)
    return (points * size)[box.faces].reshape(-1, 3)


def _add(wardrobe: Wardrobe, points: np.ndarray, local: np.ndarray, cloth: Fabric) -> None:
    faces = outwards(points, np.arange(len(points)).reshape(-1, 3), points.mean(axis=0))
    wardrobe.parts.append(MeshPart(points, faces, local, cloth))


def _hang(
    wardrobe: Wardrobe,
    grip: Grip,
    body: Surroundings,
    size: np.ndarray,
    cloth: Fabric,
    rng: np.random.Generator,
) -> bool:
    """Hang a bag or a case by its handles from a fist, beside the leg."""
    fist = grip.at + 0.02 * grip.palm + 0.01 * grip.along
    forward = normalize((grip.across + 0.3 * grip.along) * [1, 0, 1])
    axes = np.stack([forward, [0, 1.0, 0], np.cross(forward, [0, 1.0, 0])])
    drop = rng.uniform(0.03, 0.16)
    floor = min(part.vertices[:, 1].min() for part in wardrobe.parts)
    if fist[1] - drop - size[1] < floor + 0.02:
        return False
    solid = _solid(size)
    for aside in (0.0, 0.03, 0.06, 0.1):
        middle = wardrobe.person.transforms[0][:, 3]
        out = normalize((fist - middle) * [1, 0, 1]) * aside
        points = solid @ axes + fist + out - [0, drop + size[1] / 2, 0]
        if body.depth(points) < MAX_PENETRATION:
            break
    else:
        return False
    _add(wardrobe, points, solid, cloth)
    for across in (-1, 1):
        ends = [[x * size[0] * 0.25, -drop - 0.01, across * size[2] * 0.4] for x in (-1, 1)]
        path = np.array([ends[0], [-0.03, -0.006, 0], [0, 0, 0], [0.03, -0.006, 0], ends[1]])
        knots = np.linspace(0, 4, 33)
        path = np.stack([np.interp(knots, np.arange(5), path[:, k]) for k in range(3)], axis=1) @ axes + fist
        path += out * (np.abs(knots - 2) / 2)[:, None]
        vertices, faces = tube(path, 0.006, closed=False)
        wardrobe.parts.append(MeshPart(vertices, faces, vertices, cloth))
    return True


def _between_hands(wardrobe: Wardrobe, size: np.ndarray, cloth: Fabric) -> bool:
    """Put a box between both hands, in front of the belly."""
    left, right = (Grip.of(wardrobe, side) for side in "LR")
    across = left.at - right.at
    size[0] = np.linalg.norm(across) - 0.03
    if size[0] < 0.12:
        return False
    aside = normalize(across)
    forward = normalize(np.cross(aside, [0, 1.0, 0]))
    axes = np.stack([aside, np.cross(forward, aside), forward])
    body, solid = Surroundings(wardrobe, "both"), _solid(size)
    for ahead in (0.0, 0.04, 0.08, 0.12):
        points = solid @ axes + (left.at + right.at) / 2 + forward * ahead
        if body.depth(points) < MAX_PENETRATION:
            _add(wardrobe, points, solid, cloth)
            return True
    return False
