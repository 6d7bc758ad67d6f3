"""Sewing patterns: garments cut from the tights of a person at rest and let out, ready to be draped.

A cut is a scalar over the rest surface whose zero line is the edge. Below the hips a garment can continue as
a tube around the legs (skirts, coats).
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_matrix, vstack
from scipy.spatial import cKDTree

from shadow.lightstage.figure import vertex_normals
from shadow.lightstage.mesh import adjacency, boundary_chains, clip, longest_run, subdivide
from shadow.lightstage.people.body.anatomy import ARMS, LEGS, Person


@dataclass
class Fit:
    """How a garment is cut and let out. Lengths are in metres, shares along a limb in [0, 1]."""

    top: float = 9.0  # the trunk is covered below this height of the rest body
    bottom: float = -9.0  # and above this one
    neck: float | None = None  # drop of the neckline below the throat
    vee: float = 0.0  # further drop at the front, in a V
    sleeve: float | None = None  # share of the arm that is covered; None is sleeveless
    leg: float | None = None  # share of the leg that is covered
    ease: float = 0.008  # distance from the body
    fill: float = 0.5  # 1 hangs straight from the chest, 0 follows the waist
    sleeve_width: float = 0.0  # radius at the hem relative to that of the limb near its root; 0 is fitted
    leg_width: float = 0.0
    below: float = 0.0  # length of the tube below `bottom`
    flare: float = 0.1  # slope of the tube, outward for each metre down
    open_front: float = 0.0  # half the gap of an open jacket at the hem, 0 if closed
    held: tuple[str, ...] = field(default=())  # edges that stay in place: "waist", "hem", "neck", "ankles"
    bending: float = 0.3  # see `drape`
    wrinkles: float = 0.001  # height of fine creases
    slack: float = 1.0  # length of the cloth relative to the pattern
    collar: float = 0.0  # height
    collar_kind: str = "stand"  # or "fold" or "hood"
    buttons: bool = False  # at the front
    thickness: float = 0.004  # at the edges
    # Parts that are sewn on: "placket", "cuffs", "waistband", "lapels"; pockets: "chest", "hips", "seat".
    sewn: tuple[str, ...] = field(default=())
    swing: float = 0.0  # distance by which an open front stands off
    crease: float = 0.0  # height of the ironed creases of trousers
    pleats: int = 0  # of a skirt


@dataclass(frozen=True)
class Pattern:
    """A garment before it is draped."""

    faces: np.ndarray  # (F, 3)
    rest: np.ndarray  # (V, 3) vertices in the rest pose
    weights: csr_matrix  # (V, J) of the bones
    region: np.ndarray  # (V,) index into anatomy.REGIONS
    held: np.ndarray  # (V,) in [0, 1]: 1 follows the bones
    plain: np.ndarray  # (V, 3) vertices on the body, before letting out, and on the tube below it

    @classmethod
    def draw(cls, person: Person, fit: Fit, inside: np.ndarray, rng: np.random.Generator) -> "Pattern":
        """Cut a pattern of a fit along its `cut_line`, `inside`, and let it out."""
        tights = person.base.tights
        faces, rows = clip(tights.faces, inside)
        rest, weights, uncut = rows @ let_out(person, fit), rows @ tights.weights, rows @ person.tights_rest
        region = np.argmax(rows @ person.tights_regions, axis=1)
        if fit.below:
            faces, rest, weights, region = _let_down(person, fit, faces, rest, weights, region, uncut, rng)
        plain = np.concatenate([uncut, rest[len(uncut) :]])
        return cls(faces, rest, weights, region, _held_weights(person, fit, rest, region), plain)

    def subdivided(self, person: Person) -> tuple["Pattern", csr_matrix]:
        """Return the pattern after one step of subdivision, and the operator for its vertex attributes."""
        faces, step = subdivide(self.faces, len(self.rest))
        weights = (step @ self.weights).tocsr()
        fine = Pattern(
            faces,
            step @ self.rest,
            weights,
            np.argmax(person.region_weights(weights), axis=1),
            step @ self.held,
            step @ self.plain,
        )
        return fine, step


def cut_line(person: Person, fit: Fit) -> np.ndarray:
    """Return a scalar (V,) over the tights that is positive inside the garment."""
    rest, member = person.tights_rest, person.tights_regions
    x, y, z = rest.T
    arm = member[:, ARMS].sum(axis=1)
    inside = np.where(arm > 0.5, 1.0, np.minimum(fit.top - y, y - fit.bottom))
    if fit.neck is not None:
        throat = person.skeleton.head("neck01")
        slope = 0.55 * (z - throat[2])
        front = np.clip((z - throat[2]) / 0.05, 0, 1)
        neckline = throat[1] + 0.035 - fit.neck * front - (y + slope)
        wedge = np.where(z > throat[2], np.abs(x) * 1.6 - (y - (throat[1] - fit.vee)), 1.0)
        inside = np.minimum(inside, neckline)
        if fit.vee:
            inside = np.minimum(inside, wedge * 0.5)
    for k in ARMS:
        mine = member[:, k] > 0.3
        if fit.sleeve is None:
            inside = np.minimum(inside, (0.45 - member[:, k]) * 0.1)
        else:
            along, _, _ = person.limb_coordinates(k, rest)
            inside = np.where(mine, np.minimum(inside, (fit.sleeve - along) * 0.5), inside)
    for k in LEGS:
        if fit.leg is not None:
            along, _, _ = person.limb_coordinates(k, rest)
            mine = member[:, k] > 0.5
            inside = np.where(mine, np.minimum(inside, (fit.leg - along) * 0.8), inside)
    if fit.open_front:
        gap = front_gap(person, fit, y)
        inside = np.where((z > 0) & (arm < 0.5), np.minimum(inside, np.abs(x) - gap), inside)
    return inside


def front_gap(person: Person, fit: Fit, y: np.ndarray) -> np.ndarray:
    """Return half the width (V,) of the gap of an open jacket at heights (V,) of the rest body."""
    low, high = max(fit.bottom, -0.1), person.skeleton.head("neck01")[1]
    return fit.open_front * (0.6 + 0.4 * np.clip((y - low) / (high - low), 0, 1))


def let_out(person: Person, fit: Fit) -> np.ndarray:
    """Return the rest positions (V, 3) of the tights, let out to the fit."""
    rest = _fill_concavities(person)
    normals = vertex_normals(rest, person.base.tights.faces)
    trunk = np.clip(1 - 1.6 * person.tights_regions[:, ARMS].sum(axis=1), 0, 1)
    chest = person.skeleton.head("spine01")[1]
    centre = person.skeleton.head("spine03")[2]
    if fit.fill:
        if "hem" in fit.held:
            trunk = trunk * np.clip((rest[:, 1] - fit.bottom) / 0.1, 0, 1)
        rest = rest + (_remove_waist(person, rest, chest, centre) - rest) * (fit.fill * trunk)[:, None]
    for k, width in (*((k, fit.sleeve_width) for k in ARMS), *((k, fit.leg_width) for k in LEGS)):
        if width == 0:
            continue
        along, axis, _ = person.limb_coordinates(k, rest)
        member = person.tights_regions[:, k]
        mine = member > 0.5
        radial = rest - axis
        radius = np.linalg.norm(radial, axis=1)
        bins = np.clip((along * 24).astype(int), 0, 24)
        mean = np.bincount(bins[mine], radius[mine], 25) / np.maximum(
            np.bincount(bins[mine], minlength=25), 1
        )
        mean = np.where(mean > 0, mean, mean[mean > 0].mean())
        reference = mean[5]
        own = np.interp(along * 24, np.arange(25) + 0.5, mean)
        goal = np.maximum(own * 1.03, reference * (1 + (width - 1) * np.clip(along, 0, 1)))
        blend = np.clip((along - 0.08) / 0.3, 0, 1) * np.clip((member - 0.3) / 0.5, 0, 1)
        if "ankles" in fit.held and k in LEGS:
            blend *= np.clip((fit.leg - along) / 0.15, 0, 1)
        rest = rest + radial * ((goal / own - 1) * blend)[:, None]
    ease = np.full(len(rest), fit.ease)
    if "hem" in fit.held:  # tucked in: flat under the waistband
        ease *= np.clip((person.tights_rest[:, 1] - fit.bottom) / 0.1, 0.15, 1)
    if "ankles" in fit.held:
        for k in LEGS:
            along, _, _ = person.limb_coordinates(k, person.tights_rest)
            mine = person.tights_regions[:, k] > 0.5
            ease[mine] *= np.clip((fit.leg - along[mine]) / 0.15, 0.25, 1)
    rest = rest + normals * ease[:, None]
    # Neither half crosses the median plane, even if it was let out from a deep cleft.
    half = person.tights_rest[:, 0]
    rest[:, 0] = np.sign(half) * np.maximum(np.sign(half) * rest[:, 0], 0.6 * np.abs(half))
    return rest


def _fill_concavities(person: Person) -> np.ndarray:
    """Return the tights (V, 3) with concavities filled: vertices move outward to the mean of neighbours."""
    tights, rest = person.base.tights, person.tights_rest.copy()
    mean = adjacency(tights.faces, len(rest))
    degree = np.asarray(mean.sum(axis=1))
    normals = person.tights_normals
    for _ in range(25):
        outwards = ((mean @ rest / degree - rest) * normals).sum(axis=1)
        rest += normals * np.maximum(outwards, 0)[:, None]
    return rest


def _remove_waist(person: Person, rest: np.ndarray, chest: float, centre: float) -> np.ndarray:
    """Return the tights (V, 3) without a waist: the trunk is never narrower than above."""
    y = rest[:, 1]
    trunk = person.tights_regions[:, 0] > 0.6
    height = np.linspace(chest, -0.05, 26)
    scaled = rest.copy()
    for axis, sign, origin in ((0, 1, 0.0), (0, -1, 0.0), (2, 1, centre), (2, -1, centre)):
        out = sign * (rest[:, axis] - origin)
        row = np.digitize(-y, -height)
        widest = np.full(27, 1e-3)
        np.maximum.at(widest, row[trunk], out[trunk])
        widest[0] = widest[1]
        goal = np.maximum.accumulate(widest)
        ratio = np.interp(-y, -height, (goal / widest)[1:])
        here = (out > 0) & (y < chest + 0.05)
        scaled[here, axis] = origin + sign * out[here] * np.clip(ratio[here], 1, 1.6)
    return scaled


def _held_weights(person: Person, fit: Fit, rest: np.ndarray, region: np.ndarray) -> np.ndarray:
    """Return how firmly (V,) each vertex is held in place, in [0, 1]."""
    held = np.zeros(len(rest))
    if "waist" in fit.held:
        held = np.maximum(held, np.clip(1 - (fit.top - rest[:, 1]) / 0.05, 0, 1))
    if "hem" in fit.held:
        held = np.maximum(held, np.clip(1 - (rest[:, 1] - fit.bottom) / 0.04, 0, 1))
    if "neck" in fit.held:
        throat = person.skeleton.head("neck01")
        held = np.maximum(held, np.clip((rest[:, 1] - throat[1] + 0.06) / 0.05, 0, 0.9))
    if "ankles" in fit.held:
        for k in LEGS:
            along, _, _ = person.limb_coordinates(k, rest)
            end = np.clip((along - fit.leg + 0.08) / 0.03, 0, 1)
            held = np.where(region == k, np.maximum(held, end), held)
    return held


def _smooth_azimuths(angle: np.ndarray, closed: bool) -> np.ndarray:
    """Smooth the azimuths (R,), in radians, of the vertices of a boundary.

    In the cleft of the seat the boundary may turn back on itself, and a tube from it would be cut open.
    """
    around = 2 * np.pi * np.sign(angle[-1] - angle[0])
    for _ in range(30):
        ahead, behind = np.roll(angle, -1), np.roll(angle, 1)
        ahead[-1], behind[0] = ahead[-1] + around, behind[0] - around
        if closed:
            angle = (ahead + behind) / 2 * 0.5 + angle * 0.5
        else:
            angle[1:-1] = (ahead + behind)[1:-1] / 4 + angle[1:-1] * 0.5
    return angle


def _leg_weights(points: np.ndarray, skirt: cKDTree) -> csr_matrix:
    """Return how much (P, V) points of cloth follow each vertex of the body in the tree.

    It is a wide average: between the legs, the cloth follows both legs smoothly.
    """
    distance, near = skirt.query(points, k=60)
    share = np.exp(-((distance / 0.07) ** 2)) + 1e-6
    share /= share.sum(axis=1, keepdims=True)
    rows = np.repeat(np.arange(len(near)), 60)
    return csr_matrix((share.ravel(), (rows, near.ravel())), (len(near), skirt.n))


def _radius_of(skirt: np.ndarray, centre: np.ndarray) -> Callable[[np.ndarray, float], np.ndarray]:
    """Return the radius of a surface (P, 3) around the vertical axis through `centre`.

    It is a function of angles (N,) and a height, the mean over the three nearest points.
    """
    radius = np.linalg.norm((skirt - centre) * [1, 0, 1], axis=1)
    angle = np.arctan2(skirt[:, 0], skirt[:, 2] - centre[2])
    tree = cKDTree(np.stack([np.cos(angle) * 0.3, np.sin(angle) * 0.3, skirt[:, 1]], 1))

    def at(angle: np.ndarray, y: float) -> np.ndarray:
        there = np.stack([np.cos(angle) * 0.3, np.sin(angle) * 0.3, np.full(len(angle), y)], 1)
        return radius[tree.query(there, k=3)[1]].mean(axis=1)

    return at


def _let_down(
    person: Person,
    fit: Fit,
    faces: np.ndarray,
    rest: np.ndarray,
    weights: csr_matrix,
    region: np.ndarray,
    uncut: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, csr_matrix, np.ndarray]:
    """Continue the lowest boundary of a garment as a tube around the legs, with vertical folds.

    uncut: vertices on the body, before the garment was let out. Returns faces, rest, weights and region.
    """
    base = person.base
    chain = min(boundary_chains(faces), key=lambda chain: uncut[chain, 1].min())
    if fit.open_front:
        chain = longest_run(chain, uncut[chain, 1] < fit.bottom + 0.004)
    closed = chain[0] == chain[-1]
    ring = chain[:-1] if closed else chain
    skirt = person.rest[base.skirt]
    centre = np.array([0.0, 0.0, skirt[:, 2].mean()])
    out = (rest[ring] - centre) * [1, 0, 1]
    radius = np.linalg.norm(out, axis=1)
    out = out / radius[:, None]
    angle = _smooth_azimuths(np.unwrap(np.arctan2(out[:, 0], out[:, 2])), closed)
    out = np.stack([np.sin(angle), np.zeros(len(angle)), np.cos(angle)], axis=1)
    tree, skirt_radius = cKDTree(skirt), _radius_of(skirt, centre)
    pitch = 0.017
    # Folds widen from nothing at the hip towards the hem.
    folds = np.cos(angle * rng.integers(7, 15) + 1.5 * np.sin(angle * 2 + rng.uniform(0, 6)))
    folds *= rng.uniform(0.0, 0.05) + 0.08 * fit.flare
    count = max(2, round(fit.below / pitch))
    points, rows, bands, previous = [rest], [weights], [faces], ring
    grown, first = radius, len(rest)
    for k in range(1, count + 1):
        y = fit.bottom - k * fit.below / count
        needed = skirt_radius(angle, y) + fit.ease if y > -0.12 else grown
        # The slope is limited, because a horizontal shelf at the hip would crumple.
        grown = grown + np.clip(needed - grown, 0, 0.8 * fit.below / count) + fit.flare * fit.below / count
        depth = min(1.0, k * fit.below / count / 0.5)
        here = centre + out * (grown * (1 + folds * depth))[:, None]
        here[:, 1] = y
        points.append(here)
        rows.append(_leg_weights(here, tree) @ base.weights[base.skirt])
        ring_now = first + (k - 1) * len(ring) + np.arange(len(ring))
        a, b, c, d = previous, np.roll(previous, -1), ring_now, np.roll(ring_now, -1)
        # The chain has the cloth on its left, so the band traverses it in reverse.
        quads = np.stack([np.stack([b, a, c], 1), np.stack([b, c, d], 1)])
        bands.append((quads if closed else quads[:, :-1]).reshape(-1, 3))
        previous = ring_now
    added = sum(map(len, points)) - len(rest)
    return (
        np.concatenate(bands),
        np.concatenate(points),
        vstack(rows, format="csr"),
        np.concatenate([np.where(rest[:, 1] < fit.bottom + 0.05, 0, region), np.zeros(added, int)]),
    )
