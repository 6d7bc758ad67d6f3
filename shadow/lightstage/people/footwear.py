"""Shoes, boots and pumps: cut from the feet of the tights, with a sole under the foot and a block under the
heel."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import ConvexHull, cKDTree

from shadow.lightstage.figure import unit, vertex_normals
from shadow.lightstage.people.anatomy import LEGS, Person
from shadow.lightstage.people.cloth import clip, fold_noise, line, strip, subdivide
from shadow.lightstage.people.fabric import Fabric, Part
from shadow.lightstage.people.garments import Wardrobe
from shadow.lightstage.people.hollows import Creases
from shadow.lightstage.people.skeleton import SIDES

WALL = 0.022  # metres of the foot over which the sole's side reaches up
CLEAR = 0.004  # metres between a shaft and the trousers in it
GIVES = 0.012  # metres by which a shaft gives way at most
ROUND = 28  # corners of a heel block's outline
BLOCK = (1.0, 0.75, 0.45, 0.2, 0.07, 0.0)  # shares of a block's height at which it has a ring, from the top


@dataclass(frozen=True)
class Shoe:
    """leg: share of the leg at which the shaft begins, above 0.97 a shoe. low: whether the instep is bare, as
    in pumps. ease: metres off the foot; shaft: metres more at the top of a boot. sole: metres of sole. tip:
    width of the block at the ground over its width at the sole. pointed: metres by which the toe runs on."""

    leg: float
    low: bool = False
    ease: float = 0.006
    shaft: float = 0.0
    sole: float = 0.012
    tip: float = 0.9
    pointed: float = 0.0


def put_on(wardrobe: Wardrobe, shoe: Shoe, fabric: Fabric, rng: np.random.Generator) -> None:
    """A pair of shoes, over the trousers if they are on; the pose says how high the heels are."""
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
    given = np.where(shaft, _tight(wardrobe, posed, normals), 0).clip(0, GIVES)
    mean = Creases(faces, len(posed)).mean
    for _ in range(6):
        given = np.maximum(given, mean @ given)
    posed += normals * np.maximum(creases, given)[:, None]
    member = person.membership(weights)
    between = wardrobe.between_legs(shaped, faces)
    wardrobe.obstacles.append((posed, vertex_normals(posed, faces), member, between))
    if wardrobe.simulator:
        wardrobe.simulator.follow(faces, shaped, weights, wardrobe.between_thighs(shaped, faces))
    vertices, lined, source = line(posed, faces, 0.004, 0.04)
    region = np.argmax(member, axis=1)
    wardrobe.parts.append(Part(vertices, lined, shaped[source], region[source], fabric))
    if person.heel > 0:
        for side in "LR":
            mine = wall & (SIDES[side] * shaped[:, 0] > 0)
            wardrobe.parts.append(_block(person, shoe, side, shaped[mine], fabric))


def _cut(person: Person, shoe: Shoe) -> np.ndarray:
    """The scalar (V,) over the tights that is positive where the shoe is."""
    rest, inside = person.tights_rest, np.full(len(person.tights_rest), -1.0)
    for k in LEGS:
        along, _, _ = person.limb_coordinates(k, rest)
        mine = person.tights_member[:, k] > 0.5
        inside[mine] = (along[mine] - shoe.leg) * 0.8
    if not shoe.low:
        return inside
    # The edge of a pump runs level over the toes' roots and rises behind the heel.
    ankle = person.skeleton.head("foot.L")
    behind = np.clip((ankle[2] + 0.01 - rest[:, 2]) / 0.06, 0, 1)
    edge = rest[:, 1].min() + 0.04 + 0.02 * behind
    return np.minimum(inside, edge - rest[:, 1])


def _shaped(person: Person, shoe: Shoe, faces: np.ndarray, rows: csr_matrix) -> tuple[np.ndarray, np.ndarray]:
    """The shoe at rest (V, 3), let out and on its sole, and which of its vertices are the sole's (V,)."""
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
    # The sole: a flat slab that stands out a little all round.
    low = np.clip((ground + WALL - shaped[:, 1]) / 0.012, 0, 1)
    sideways = vertex_normals(shaped, faces) * [1, 0, 1]
    shaped += sideways * (0.005 * np.clip(low * 2, 0, 1) * (0.4 if shoe.low else 1))[:, None]
    level = ground + WALL - low * (WALL + shoe.sole)
    shaped[:, 1] = np.where(low > 0, np.minimum(shaped[:, 1], level), shaped[:, 1])
    return shaped, low > 0


def _tight(wardrobe: Wardrobe, posed: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Metres (V,) by which a shaft has to give way to what is in it."""
    points, out = (np.concatenate([layer[k] for layer in wardrobe.obstacles]) for k in (0, 1))
    distance, near = cKDTree(points).query(posed)
    height = ((posed - points[near]) * out[near]).sum(axis=1)
    return np.where((distance < 0.05) & ((normals * out[near]).sum(axis=1) > 0.3), CLEAR - height, -1.0)


def _block(person: Person, shoe: Shoe, side: str, sole: np.ndarray, fabric: Fabric) -> Part:
    """The heel under one foot, from the sole's points (N, 3) at rest down to the ground on which the toes
    stand."""
    names = person.base.names
    foot, toes = (person.transforms[names.index(name)] for name in (f"foot.{side}", f"toe2-1.{side}"))
    bottom = sole[:, 1].min()
    heel = sole[sole[:, 2] < sole[:, 2].min() + 0.3 * np.ptp(sole[:, 2])]
    flat = heel[heel[:, 1] < bottom + 0.006][:, [0, 2]]
    outline = flat[ConvexHull(flat).vertices]
    centre = outline.mean(axis=0)
    ring = _rounded(outline - centre)
    top = np.insert(ring + centre, 1, bottom + 0.004, axis=1) @ foot[:, :3].T + foot[:, 3]
    # In the frame of the toes the ground is level; a thin heel stands under the back of the foot.
    local = (top - toes[:, 3]) @ toes[:, :3]
    foothold = local.mean(axis=0) - [0, 0, (1 - shoe.tip) * 0.012]
    rings = []
    for share in BLOCK:
        width = shoe.tip + (1 - shoe.tip) * share**2
        here = foothold + (local - foothold) * width
        here[:, 1] = bottom + (local[:, 1] - bottom) * share
        rings.append(here)
    rings.append(np.repeat(rings[-1].mean(axis=0, keepdims=True), ROUND, axis=0))
    local = np.stack(rings)
    faces, points = strip(local, closed=True), local.reshape(-1, 3)
    if (vertex_normals(points, faces) * (points - points.mean(axis=0))).sum() < 0:
        faces = faces[:, ::-1]
    placed = points @ toes[:, :3].T + toes[:, 3]
    return Part(placed, faces, points, np.full(len(points), LEGS["LR".index(side)]), fabric)


def _rounded(outline: np.ndarray) -> np.ndarray:
    """A convex outline (N, 2) about the origin by ROUND points at even angles, drawn in a little."""
    angle = np.linspace(0, 2 * np.pi, ROUND, endpoint=False)
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    a, b = outline, np.roll(outline, -1, axis=0)
    normal = unit(np.stack([b[:, 1] - a[:, 1], a[:, 0] - b[:, 0], np.zeros(len(a))], axis=1))[:, :2]
    normal *= np.sign((normal * a).sum(axis=1, keepdims=True))
    distance = (normal * a).sum(axis=1)
    facing = way @ normal.T
    reach = np.where(facing > 1e-6, distance / np.maximum(facing, 1e-6), np.inf).min(axis=1)
    return way * (reach * 0.96)[:, None]
