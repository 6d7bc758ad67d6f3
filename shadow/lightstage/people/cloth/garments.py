"""Garments: patterns that are draped on the posed body, creased and hemmed.

Layers are put on from the inside out, and each one is an obstacle for the next. They are draped within a
second by position-based dynamics in the final pose, or simulated.
"""

import numpy as np
from scipy.sparse import csr_matrix, diags
from scipy.spatial import cKDTree

from shadow.lightstage.figure import normalize, vertex_normals
from shadow.lightstage.mesh import add_lining
from shadow.lightstage.people.body.anatomy import ARMS, LEGS, Person
from shadow.lightstage.people.cloth import pockets, tailoring, trimmings
from shadow.lightstage.people.cloth.concavities import CreaseFilling, crotch
from shadow.lightstage.people.cloth.draping import drape, fold_noise
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart
from shadow.lightstage.people.cloth.patterns import Fit, Pattern, cut_line
from shadow.lightstage.people.cloth.simulation import Cut, Simulator

# Height of the finest creases on simulated cloth relative to draped cloth; simulation makes the wider folds.
SIMULATED_WRINKLES = 0.35
SEWN_MARGIN = 0.02  # metres inside a garment from which parts that are sewn to another one are hidden
LONG = 0.25  # metres: a longer tube below the hips hangs around both legs


class Wardrobe:
    """Dresses one person, and tracks the obstacles for the next layer and the covered skin."""

    def __init__(self, person: Person, rng: np.random.Generator, simulator: Simulator | None = None) -> None:
        self.person, self.rng, self.simulator = person, rng, simulator
        tights = person.base.tights
        self.covered = np.zeros(len(person.tights_regions), bool)
        self.hidden = np.zeros(len(person.rest), bool)  # vertices of the body under MakeHuman's meshes
        self.parts: list[MeshPart] = []
        self.packed = False  # whether there is a pack on the back
        self.outer: tailoring.Garment | None = None  # the garment that was put on last, draped
        self.obstacles: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        posed = person.posed(tights.weights, person.tights_rest)
        between = self.between_legs(person.tights_rest, tights.faces)
        normals = vertex_normals(posed, tights.faces)
        posed = posed + normals * pockets.bulge(person)[:, None]
        self.obstacles.append((posed, normals, person.tights_regions, between))
        if simulator:
            simulator.stand(self.between_thighs(person.tights_rest, tights.faces))

    @property
    def worn(self) -> tuple[np.ndarray, ...]:
        """The obstacles of all layers: points, normals, weights of regions, and which face the other leg."""
        return tuple(map(np.concatenate, zip(*self.obstacles, strict=True)))

    def between_legs(self, rest: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """Return which vertices (V,) face the other leg or buttock, a gap that cloth around both spans."""
        low = rest[:, 1] < self.person.skeleton.head("upperleg01.L")[1] + 0.12
        return low & (np.sign(rest[:, 0]) * vertex_normals(rest, faces)[:, 0] < -0.2)

    def between_thighs(self, rest: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """Return the same below the crotch: for simulated cloth, the gap above it is filled."""
        return self.between_legs(rest, faces) & (rest[:, 1] < crotch(self.person)[1])

    def _obstacles_by_region(self, region: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return, for each region of the cloth (V,), its vertices and the obstacles with which they collide.

        The cloth of a limb collides with its own limb only, so that a hanging arm does not push the shirt
        into the trunk.
        """
        points, normals, member, between = self.worn
        groups = []
        for k in np.unique(region):
            if k == 0:
                near = (member[:, ARMS].sum(axis=1) < 0.6) & ~between
            elif k in ARMS:
                near = member[:, k] > 0.1
            else:
                near = (member[:, k] > 0.05) | (member[:, 0] > 0.5)
            groups.append((np.flatnonzero(region == k), points[near], normals[near]))
        return groups

    def wear(self, fit: Fit, fabric: Fabric) -> MeshPart:
        """Cut, let out, drape, crease and hem a garment, append it to `parts`, and return it."""
        inside = cut_line(self.person, fit)
        # Sleeves and trouser legs slide, and are visible inside, so more skin is kept there than on the
        # trunk.
        arms, legs = (self.person.tights_regions[:, limb].sum(axis=1) for limb in (ARMS, LEGS))
        limbs = 0.13 * arms + 0.08 * legs
        limbs *= 1 + max(fit.sleeve_width, fit.leg_width) - 0.7 * (fit.leg_width > 0)
        tucking = "waist" in fit.held
        self.hide_under(inside - limbs, margin=0.015 if tucking else 0.13 if fit.open_front else 0.05)
        self.covered |= inside - limbs > 0.035
        pattern = Pattern.draw(self.person, fit, inside, self.rng)
        if self.simulator is None:
            pattern, posed = self._drape(fit, pattern)
        else:
            pattern, posed = self._simulate(self.simulator, fit, pattern)
        return self._finish(fit, pattern, posed, fabric)

    def _drape(self, fit: Fit, pattern: Pattern) -> tuple[Pattern, np.ndarray]:
        """Drape the pattern on the posed body; return it subdivided, and its posed vertices."""
        posed = drape(
            self.person.posed(pattern.weights, pattern.rest),
            pattern.faces,
            pattern.rest * fit.slack,
            self._obstacles_by_region(pattern.region),
            pattern.held,
            gap=0.0025 + fit.thickness * 0.6 + 2.5 * fit.wrinkles,
            bending=fit.bending,
        )
        self._add_obstacle(fit, pattern, posed)
        fine, step = pattern.subdivided(self.person)
        return fine, step @ posed

    def _simulate(self, simulator: Simulator, fit: Fit, pattern: Pattern) -> tuple[Pattern, np.ndarray]:
        """Simulate the pattern; return it subdivided, and its posed vertices."""
        coarse = pattern
        pattern, step = coarse.subdivided(self.person)
        cut = to_cut(self.person, fit, pattern, (step @ carrying_weights(self.person, fit, coarse)).tocsr())
        between = self.between_thighs(pattern.rest, pattern.faces)
        posed = simulator.drape(cut, between, _outside(fit, pattern))
        self._add_obstacle(fit, pattern, posed)
        return pattern, posed

    def _add_obstacle(self, fit: Fit, pattern: Pattern, posed: np.ndarray) -> None:
        """Add the garment to the obstacles of the next layer."""
        normals = vertex_normals(posed, pattern.faces)
        outer = posed + normals * 1.5 * fit.wrinkles
        between = self.between_legs(pattern.rest, pattern.faces)
        layer = (outer, normals, self.person.region_weights(pattern.weights), between)
        outside = _outside(fit, pattern)
        self.obstacles.append(tuple(column[outside] for column in layer))

    def _finish(self, fit: Fit, pattern: Pattern, posed: np.ndarray, fabric: Fabric) -> MeshPart:
        """Crease, hem and trim a draped garment."""
        person, faces = self.person, pattern.faces
        # Textures follow the smooth shape of the body, and the tube below it.
        rest, region = pattern.plain, pattern.region
        if fit.below:
            region = np.where(rest[:, 1] < fit.bottom, 0, region)
        relief = self._wrinkles(fit, rest, region)
        if fit.crease:
            relief += tailoring.creased(person, rest, region, fit.crease)
        if fit.pleats:
            relief += tailoring.pleated(rest, fit.bottom, fit.pleats, 0.012)
        posed = posed + vertex_normals(posed, faces) * relief[:, None]
        if fit.swing:
            posed = tailoring.open_front(fit, person, (posed, faces, rest))
        hanging = fit.below > 0.15 or fit.open_front > 0
        wide = max(fit.sleeve_width, fit.leg_width) > 0.85
        inner = 0.35 if wide or hanging else 0.12
        # In tight folds an inner side would penetrate the outer one, which rays hit from both sides anyway.
        vertices, lined, source = add_lining(posed, faces, fit.thickness, 0.02 if self.simulator else inner)
        part = MeshPart(vertices, lined, rest[source], fabric, region[source])
        self.parts.append(part)
        if fit.buttons:
            low = fit.bottom - fit.below * 0.7
            high = person.skeleton.head("neck01")[1] - fit.vee - 0.03
            self.parts += trimmings.buttons((posed, faces, rest), low, high, fit.open_front, self.rng)
        if fit.collar:
            cut = fit.collar, fit.collar_kind
            self.parts += trimmings.collar(person, (posed, faces, rest), *cut, fabric, self.rng)
        self.parts += self._sewn_parts(fit, (posed, faces, rest), region, fabric)
        self.outer = posed, faces, rest
        return part

    def _sewn_parts(
        self, fit: Fit, garment: tailoring.Garment, region: np.ndarray, fabric: Fabric
    ) -> list[MeshPart]:
        """Return the parts that are sewn on, as the fit demands."""
        person, parts = self.person, []
        if "placket" in fit.sewn:
            low = fit.bottom - fit.below
            parts += tailoring.placket(garment, low, person.skeleton.head("neck01")[1] - fit.vee, fabric)
        if "cuffs" in fit.sewn and fit.sleeve is not None:
            parts += tailoring.cuffs(person, garment, region, fit.sleeve, fabric)
        if "waistband" in fit.sewn:
            parts += tailoring.waistband(garment, fit.top, fabric)
        if "lapels" in fit.sewn:
            parts += tailoring.lapels(person, fit, garment, fabric, self.rng)
        for kind in ("chest", "hips", "seat"):
            if kind in fit.sewn:
                parts += tailoring.pockets(person, garment, kind, fabric)
        return parts

    def hide_under(self, inside: np.ndarray, margin: float) -> None:
        """Remove parts that lie `margin` metres inside a garment about to be put on, which would hide them.

        `inside` is the `cut_line` of that garment.
        """
        tree = cKDTree(self.person.tights_rest)
        for part in self.parts:
            limit = min(margin, SEWN_MARGIN) if part.sewn else margin
            hidden = inside[tree.query(part.rest)[1]] > limit
            part.faces = part.faces[~hidden[part.faces].all(axis=1)]

    def _wrinkles(self, fit: Fit, rest: np.ndarray, region: np.ndarray) -> np.ndarray:
        """Return fine creases (V,) in metres, in addition to the draped folds.

        They run across limbs, and are strongest at joints.
        """
        person, rng = self.person, self.rng
        size = np.full(len(rest), 0.5)
        across = rest.copy()
        for k in (*ARMS, *LEGS):
            mine = region == k
            if not mine.any():
                continue
            along, axis, metres = person.limb_coordinates(k, rest[mine])
            middle = np.linalg.norm(np.diff(person.limb_joints(k), axis=0)[0])
            size[mine] += (
                0.3 + 1.2 * np.exp(-(((metres - middle) / 0.09) ** 2)) + 0.7 * np.exp(-((along / 0.15) ** 2))
            )
            across[mine] = axis + (rest[mine] - axis) * 0.4
        waist = person.skeleton.head("spine04")[1]
        size += np.where(region == 0, 0.6 * np.exp(-(((rest[:, 1] - waist) / 0.08) ** 2)), 0)
        patches = 0.5 + 0.5 * np.clip(fold_noise(rest, rng, 0.2), -1, 1)
        # Creases are ridges rather than waves.
        creases = 1 - np.abs(fold_noise(across, rng, rng.uniform(0.04, 0.075))) * 1.2
        fine = 0.4 * fold_noise(across, rng, 0.024) + 0.15 * fold_noise(across, rng, 0.012)
        # Long folds run in the direction of tension, a random diagonal over the trunk.
        pull = normalize(np.array([rng.normal() * 0.6, 1.0, rng.normal() * 0.6]))
        trunk = rest - 0.8 * (rest @ pull)[:, None] * pull
        folds = fold_noise(trunk, rng, rng.uniform(0.05, 0.11)) * np.where(region == 0, 1.0, 0.6)
        if self.simulator:
            # The depth is limited, so that cloth on the body does not penetrate it.
            return np.maximum(SIMULATED_WRINKLES * fit.wrinkles * 1.6 * size * patches * fine, -0.0005)
        return fit.wrinkles * (1.6 * size * patches * (creases + fine) + 2.2 * (1 - patches) * folds)


def _outside(fit: Fit, pattern: Pattern) -> np.ndarray:
    """Return which vertices (V,) the next layer collides with: not those that are tucked in."""
    rest = pattern.rest
    return rest[:, 1] > fit.bottom + 0.06 if "hem" in fit.held else np.ones(len(rest), bool)


def carrying_weights(person: Person, fit: Fit, pattern: Pattern) -> csr_matrix:
    """Return the weights (V, J) of the bones that move the cloth.

    They are smoother than those of the skin, most of all at the shoulders. A top follows the trunk; thighs
    push it, but do not move it.
    """
    weights, base = pattern.weights, person.base
    if fit.leg is None and fit.below <= LONG:
        bones = np.arange(len(base.names))
        to = np.where(np.isin(base.regions, LEGS), base.names.index("root"), bones)
        weights = weights @ csr_matrix((np.ones(len(to)), (bones, to)), (len(to), len(to)))
    mean = CreaseFilling(pattern.faces, len(pattern.rest)).mean
    near = _shoulder(person, pattern)
    for step in range(24):
        share = 0.5 * (near if step >= 5 else np.ones_like(near))
        weights = (diags(1 - share) @ weights + diags(share) @ (mean @ weights)).tocsr()
    return weights


def _shoulder(person: Person, pattern: Pattern) -> np.ndarray:
    """Return the proximity (V,) of each vertex to a shoulder joint, in [0, 1]."""
    joints = np.stack([person.limb_joints(k)[0] for k in ARMS])
    distance = np.linalg.norm(pattern.plain[:, None] - joints, axis=2).min(axis=1)
    return np.exp(-((distance / 0.11) ** 2))


def _raised(person: Person, pattern: Pattern) -> np.ndarray:
    """Return how far the arm on the side of each vertex (V,) is raised, in [0, 1]."""
    bones = person.base.names
    up = person.transforms[bones.index("spine02"), :, :3] @ [0, 1, 0]
    sides = []
    for k, side in zip(ARMS, "LR", strict=True):
        joints = person.limb_joints(k)
        arm = person.transforms[bones.index(f"upperarm01.{side}"), :, :3] @ normalize(joints[1] - joints[0])
        sides.append(np.clip((arm @ up + 0.4) / 0.7, 0.2, 1))
    return np.where(pattern.plain[:, 0] > 0, *sides)


def to_cut(person: Person, fit: Fit, pattern: Pattern, weights: csr_matrix) -> Cut:
    """Convert a fit and its pattern, with bone weights (V, J), to the input of the simulation.

    Cloth is longer than the pattern, so that it folds: most along sleeves, least where it clings. Narrow
    sleeves have cuffs, which stay in place.
    """
    rest, member = pattern.rest, person.region_weights(pattern.weights)
    tube = rest[:, 1] < fit.bottom if fit.below else np.zeros(len(rest), bool)
    region = np.where(tube, 0, pattern.region)
    hangs = fit.below > LONG
    thick = fit.thickness > 0.0065
    arms, trunk, legs = (
        ((1.14, 1.07), (1.1, 1.07), (1.05, 1.04)) if thick else ((1.18, 1.08), (1.12, 1.08), (1.05, 1.04))
    )
    slack = 0.4 + 0.6 * np.clip((fit.ease - 0.003) / 0.007, 0, 1)
    if hangs:
        arms, trunk = (1.14, 1.07), (1.05, 1.05)
    elif "hem" in fit.held:  # tucked in: excess length would bulge over the waistband
        trunk = (1.06, 1.06)
    longer = 1 + slack * (member @ (np.array([trunk, arms, arms, legs, legs]) - 1))
    if hangs:
        longer[tube] = 1.01
    axis, held = np.tile([0.0, 1.0, 0.0], (len(rest), 1)), pattern.held.copy()
    for k in (*ARMS, *LEGS):
        mine = np.flatnonzero(region == k)
        along, _, metres = person.limb_coordinates(k, pattern.plain[mine])
        joints = person.limb_joints(k)
        bones = normalize(np.diff(joints, axis=0))
        axis[mine] = bones[(metres > np.linalg.norm(joints[1] - joints[0])).astype(int)]
        if k in ARMS and fit.sleeve is not None and fit.sleeve > 0.9 and fit.sleeve_width < 0.8:
            held[mine] = np.maximum(held[mine], np.clip((along - fit.sleeve + 0.05) / 0.03, 0, 1))
    # A dress hangs from the chest; a hem is free.
    lowest = person.skeleton.head("spine02" if hangs else "upperleg01.L")[1] + 0.05 * (not hangs)
    anchored = ((region > 0) & ~tube) | (rest[:, 1] > lowest) | (fit.leg is not None)
    # A raised arm leaves too much cloth at its shoulder, which is made stiff so that it does not crumple.
    padded = _shoulder(person, pattern) * _raised(person, pattern)
    anchored &= padded < 0.3
    longer = 1 + (longer - 1) * (1 - padded)[:, None]
    slid = 0.0 if hangs or fit.leg is not None else 0.012 * slack
    slid = slid * (1 - held) * (1 - padded)
    hinge = 1e-6 * (0.5 + 2.5 * fit.bending) * np.sqrt(fit.thickness / 0.004) * (2.5 if hangs else 1)
    hinge = hinge * (1 + 5 * padded)
    return Cut(
        pattern.faces, rest, slid, weights, member, region, axis, held, anchored, longer,
        hinge, 0.4 if hangs else 0.6, 0.001 + 0.6 * fit.thickness, fit.leg is None,
    )  # fmt: skip
