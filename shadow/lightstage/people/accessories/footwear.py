"""Shoes, boots and pumps, cut from the feet of the tights, with a sole and a heel block."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import ConvexHull, cKDTree

from shadow.lightstage.figure import normalize, outwards, vertex_normals
from shadow.lightstage.mesh import add_lining, clip, loft, subdivide
from shadow.lightstage.people.body.anatomy import LEGS, Person
from shadow.lightstage.people.body.skeleton import SIDES
from shadow.lightstage.people.cloth.concavities import CreaseFilling
from shadow.lightstage.people.cloth.draping import fold_noise
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart
from shadow.lightstage.people.cloth.garments import Wardrobe

SOLE_WALL = 0.022  # metres by which the side of the sole reaches up the foot
SHAFT_CLEARANCE = 0.004  # metres between a shaft and the trousers in it
MAX_SHAFT_STRETCH = 0.012  # metres
OUTLINE_CORNERS = 28  # of a heel block
BLOCK_RINGS = (1.0, 0.75, 0.45, 0.2, 0.07, 0.0)  # their heights on a heel block, as shares, from the top


@dataclass(frozen=True)
class Shoe:
    """The shape of a pair of shoes.

    leg: share of the leg at which the shaft begins; above 0.97 it is a low shoe. low: whether the instep is
    bare, as in pumps. ease: metres off the foot. shaft: further metres at the top of a boot. sole: metres of
    sole. tip: width of the heel block at the ground, relative to the sole. pointed: metres by which the toe
    is longer than the foot.
    """

    leg: float
    low: bool = False
    ease: float = 0.006
    shaft: float = 0.0
    sole: float = 0.012
    tip: float = 0.9
    pointed: float = 0.0


def put_on(wardrobe: Wardrobe, shoe: Shoe, fabric: Fabric, rng: np.random.Generator) -> None:
    """Put on a pair of shoes, over trousers that are already on. The heels have the height of the pose."""
    person, tights = wardrobe.person, wardrobe.person.base.tights
    inside = _cut(person, shoe)
    wardrobe.covered |= inside > (0.005 if shoe.low else 0.015)
    wardrobe.hide_under(inside, 0.012)
    faces, rows = clip(tights.faces, inside)
    faces, step = subdivide(faces, rows.shape[0])
    rows = step @ rows
    shaped, wall = _shaped(person, shoe, faces, rows)
    weights = (rows @ tights.weights).tocsr()
    posed = person.posed(weights, shaped)
    normals = vertex_normals(posed, faces)
    creases = 0.0012 * fold_noise(shaped, rng, 0.03) * ~wall
    shaft = shaped[:, 1] > person.skeleton.head("foot.L")[1]
    given = np.where(shaft, _tight(wardrobe, posed, normals), 0).clip(0, MAX_SHAFT_STRETCH)
    mean = CreaseFilling(faces, len(posed)).mean
    for _ in range(6):
        given = np.maximum(given, mean @ given)
    posed += normals * np.maximum(creases, given)[:, None]
    member = person.region_weights(weights)
    between = wardrobe.between_legs(shaped, faces)
    wardrobe.obstacles.append((posed, vertex_normals(posed, faces), member, between))
    if wardrobe.simulator:
        wardrobe.simulator.follow(faces, shaped, weights, wardrobe.between_thighs(shaped, faces))
    vertices, lined, source = add_lining(posed, faces, 0.004, 0.04)
    region = np.argmax(member, axis=1)
    wardrobe.parts.append(MeshPart(vertices, lined, shaped[source], fabric, region[source]))
    if person.heel > 0:
        for side in "LR":
            mine = wall & (SIDES[side] * shaped[:, 0] > 0)
            wardrobe.parts.append(_block(person, shoe, side, shaped[mine], fabric))


def _cut(person: Person, shoe: Shoe) -> np.ndarray:
    """Return a scalar (V,) over the tights that is positive inside the shoe."""
    rest, inside = person.tights_rest, np.full(len(person.tights_rest), -1.0)
    for k in LEGS:
        along, _, _ = person.limb_coordinates(k, rest)
        mine = person.tights_regions[:, k] > 0.5
        inside[mine] = (along[mine] - shoe.leg) * 0.8
    if not shoe.low:
        return inside
    # The edge of a pump is level above the toes and rises behind the heel.
    ankle = person.skeleton.head("foot.L")
    behind = np.clip((ankle[2] + 0.01 - rest[:, 2]) / 0.06, 0, 1)
    edge = rest[:, 1].min() + 0.04 + 0.02 * behind
    return np.minimum(inside, edge - rest[:, 1])


def _shaped(person: Person, shoe: Shoe, faces: np.ndarray, rows: csr_matrix) -> tuple[np.ndarray, np.ndarray]:
    """Return the shoe at rest (V, 3), with ease and sole, and which of its vertices (V,) are on the sole."""
    rest = person.tights_rest
    ground, ankle = rest[:, 1].min(), person.skeleton.head("foot.L")[1]
    height = np.clip((rest[:, 1] - ankle) / max(0.1, (0.97 - shoe.leg) * 0.85), 0, 1)
    shaped = rows @ (rest + person.tights_normals * (shoe.ease + shoe.shaft * height)[:, None])
    if shoe.pointed:
        for side in "LR":
            ball = person.skeleton.head(f"toe2-1.{side}")
            mine = SIDES[side] * shaped[:, 0] > 0
            toe = shaped[mine, 2].max()
            share = np.where(mine, np.clip((shaped[:, 2] - ball[2]) / (toe - ball[2]), 0, 1), 0) ** 1.5
            shaped[:, 0] -= (shaped[:, 0] - ball[0]) * 0.5 * share
            shaped[:, 2] += shoe.pointed * share
    # The sole is a flat slab that is slightly wider than the shoe.
    low = np.clip((ground + SOLE_WALL - shaped[:, 1]) / 0.012, 0, 1)
    sideways = vertex_normals(shaped, faces) * [1, 0, 1]
    shaped += sideways * (0.005 * np.clip(low * 2, 0, 1) * (0.4 if shoe.low else 1))[:, None]
    level = ground + SOLE_WALL - low * (SOLE_WALL + shoe.sole)
    shaped[:, 1] = np.where(low > 0, np.minimum(shaped[:, 1], level), shaped[:, 1])
    return shaped, low > 0


def _tight(wardrobe: Wardrobe, posed: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the metres (V,) by which a shaft has to be wider for the clothes in it."""
    points, out, _, _ = wardrobe.worn
    distance, near = cKDTree(points).query(posed)
    height = ((posed - points[near]) * out[near]).sum(axis=1)
    facing = (normals * out[near]).sum(axis=1) > 0.3
    return np.where((distance < 0.05) & facing, SHAFT_CLEARANCE - height, -1.0)


def _block(person: Person, shoe: Shoe, side: str, sole: np.ndarray, fabric: Fabric) -> MeshPart:
    """Return the heel block of one foot, from the points (N, 3) of the sole at rest down to the ground."""
    toes = person.bone(f"toe2-1.{side}")
    bottom = sole[:, 1].min()
    heel = sole[sole[:, 2] < sole[:, 2].min() + 0.3 * np.ptp(sole[:, 2])]
    flat = heel[heel[:, 1] < bottom + 0.006][:, [0, 2]]
    outline = flat[ConvexHull(flat).vertices]
    centre = outline.mean(axis=0)
    ring = _rounded(outline - centre)
    top = person.moved(f"foot.{side}", np.insert(ring + centre, 1, bottom + 0.004, axis=1))
    # In the frame of the toes the ground is level. A thin heel is under the back of the foot.
    local = (top - toes[:, 3]) @ toes[:, :3]
    foothold = local.mean(axis=0) - [0, 0, (1 - shoe.tip) * 0.012]
    rings = []
    for share in BLOCK_RINGS:
        width = shoe.tip + (1 - shoe.tip) * share**2
        here = foothold + (local - foothold) * width
        here[:, 1] = bottom + (local[:, 1] - bottom) * share
        rings.append(here)
    rings.append(np.repeat(rings[-1].mean(axis=0, keepdims=True), OUTLINE_CORNERS, axis=0))
    local = np.stack(rings)
    points = local.reshape(-1, 3)
    faces = outwards(points, loft(local, closed=True), points.mean(axis=0))
    return MeshPart(person.moved(f"toe2-1.{side}", points), faces, points, fabric, LEGS["LR".index(side)])


def _rounded(outline: np.ndarray) -> np.ndarray:
    """Resample a convex outline (N, 2) around the origin at OUTLINE_CORNERS equal angles, slightly inset."""
    angle = np.linspace(0, 2 * np.pi, OUTLINE_CORNERS, endpoint=False)
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    a, b = outline, np.roll(outline, -1, axis=0)
    normal = normalize(np.stack([b[:, 1] - a[:, 1], a[:, 0] - b[:, 0], np.zeros(len(a))], axis=1))[:, :2]
    normal *= np.sign((normal * a).sum(axis=1, keepdims=True))
    distance = (normal * a).sum(axis=1)
    facing = way @ normal.T
    reach = np.where(facing > 1e-6, distance / np.maximum(facing, 1e-6), np.inf).min(axis=1)
    return way * (reach * 0.96)[:, None]
