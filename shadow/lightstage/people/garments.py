"""Garments: patterns draped on the posed body, creased and hemmed.

Layers are sewn from the inside out, and each one becomes an obstacle to the next. They are draped in a second
by position-based dynamics in the final pose, or simulated.
"""

import numpy as np
from scipy.sparse import csr_matrix, diags
from scipy.spatial import cKDTree

from shadow.lightstage.figure import unit, vertex_normals
from shadow.lightstage.people import pocketing, tailoring, trimmings
from shadow.lightstage.people.anatomy import ARMS, LEGS, Person
from shadow.lightstage.people.cloth import drape, edges_of, fold_noise, line
from shadow.lightstage.people.fabric import Fabric, Part
from shadow.lightstage.people.hollows import crotch
from shadow.lightstage.people.patterns import Fit, Pattern, cut_line
from shadow.lightstage.people.simulation import Cut, Simulator

# Height of the finest creases on simulated cloth over those on draped cloth; what is wider it folds itself.
SIMULATED_WRINKLES = 0.35
SEWN = 0.02  # metres inside a garment from which it hides what is sewn to another
LONG = 0.25  # metres let down below which a garment hangs about both legs


class Wardrobe:
    """Dresses one person; keeps the obstacles that the next layer meets and which skin is covered."""

    def __init__(self, person: Person, rng: np.random.Generator, simulator: Simulator | None = None) -> None:
        self.person, self.rng, self.simulator = person, rng, simulator
        tights = person.base.tights
        self.membership = person.tights_member
        self.covered = np.zeros(len(self.membership), bool)
        self.parts: list[Part] = []
        self.packed = False  # whether there is a pack on the back
        self.outer: tailoring.Garment | None = None  # the garment put on last, as it hangs
        self.obstacles: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        posed = person.posed(tights.weights, person.tights_rest)
        between = self.between_legs(person.tights_rest, tights.faces)
        normals = vertex_normals(posed, tights.faces)
        posed = posed + normals * pocketing.bulge(person)[:, None]
        self.obstacles.append((posed, normals, self.membership, between))
        if simulator:
            simulator.stand(self.between_thighs(person.tights_rest, tights.faces))

    def between_legs(self, rest: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """Whether each vertex faces the other leg or buttock: cloth about both legs spans that gap."""
        low = rest[:, 1] < self.person.skeleton.head("upperleg01.L")[1] + 0.12
        return low & (np.sign(rest[:, 0]) * vertex_normals(rest, faces)[:, 0] < -0.2)

    def between_thighs(self, rest: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """The same below the crotch: the seat above it is filled for simulated cloth."""
        return self.between_legs(rest, faces) & (rest[:, 1] < crotch(self.person)[1])

    def _meets(self, region: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """For each region of the cloth the obstacles that it can touch: limbs meet their own limb only, so
        that an arm at the side does not push the shirt into the trunk."""
        points, normals, member = (np.concatenate([layer[k] for layer in self.obstacles]) for k in range(3))
        between = np.concatenate([layer[3] for layer in self.obstacles])
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

    def wear(self, fit: Fit, fabric: Fabric) -> Part:
        """Cut, let out, drape, crease and hem one garment; it is kept in `parts`."""
        inside = cut_line(self.person, fit)
        # Sleeves and trouser legs slide and can be looked into, so more is kept there than on the trunk.
        limbs = 0.13 * self.membership[:, ARMS].sum(axis=1) + 0.08 * self.membership[:, LEGS].sum(axis=1)
        limbs *= 1 + max(fit.sleeve_width, fit.leg_width) - 0.7 * (fit.leg_width > 0)
        tucking = "waist" in fit.held
        self.hide_under(inside - limbs, margin=0.015 if tucking else 0.13 if fit.open_front else 0.05)
        self.covered |= inside - limbs > 0.035
        pattern = Pattern.draw(self.person, fit, inside, self.rng)
        if self.simulator is None:
            pattern, posed = self._draped(fit, pattern)
        else:
            pattern, posed = self._simulated(self.simulator, fit, pattern)
        return self._finished(fit, pattern, posed, fabric)

    def _draped(self, fit: Fit, pattern: Pattern) -> tuple[Pattern, np.ndarray]:
        """The pattern, refined, and where its vertices settle on the posed body."""
        posed = drape(
            self.person.posed(pattern.weights, pattern.rest),
            pattern.faces,
            pattern.rest * fit.slack,
            self._meets(pattern.region),
            pattern.held,
            gap=0.0025 + fit.thickness * 0.6 + 2.5 * fit.wrinkles,
            weight=fit.weight,
            bending=fit.bending,
        )
        self._covers(fit, pattern, posed)
        fine, step = pattern.subdivided(self.person)
        return fine, step @ posed

    def _simulated(self, simulator: Simulator, fit: Fit, pattern: Pattern) -> tuple[Pattern, np.ndarray]:
        """The same by physics, on the refined pattern."""
        coarse = pattern
        pattern, step = coarse.subdivided(self.person)
        cut = physical(self.person, fit, pattern, (step @ carried(self.person, fit, coarse)).tocsr())
        between = self.between_thighs(pattern.rest, pattern.faces)
        posed = simulator.drape(cut, between, _outside(fit, pattern))
        self._covers(fit, pattern, posed)
        return pattern, posed

    def _covers(self, fit: Fit, pattern: Pattern, posed: np.ndarray) -> None:
        """What the next layer meets."""
        normals = vertex_normals(posed, pattern.faces)
        outer = posed + normals * 1.5 * fit.wrinkles
        between = self.between_legs(pattern.rest, pattern.faces)
        layer = (outer, normals, self.person.membership(pattern.weights), between)
        outside = _outside(fit, pattern)
        self.obstacles.append(tuple(column[outside] for column in layer))

    def _finished(self, fit: Fit, pattern: Pattern, posed: np.ndarray, fabric: Fabric) -> Part:
        """Creased, hemmed and trimmed."""
        person, faces = self.person, pattern.faces
        # Patterns follow the body's own shape, which is smooth, and the tube below it.
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
            posed = tailoring.opened(fit, person, (posed, faces, rest))
        hanging = fit.below > 0.15 or fit.open_front > 0
        wide = max(fit.sleeve_width, fit.leg_width) > 0.85
        inner = 0.35 if wide or hanging else 0.12
        # In tight folds an inner side would come out again, and rays find the outer one from both sides.
        vertices, lined, source = line(posed, faces, fit.thickness, 0.02 if self.simulator else inner)
        part = Part(vertices, lined, rest[source], region[source], fabric)
        self.parts.append(part)
        if fit.buttons:
            low = fit.bottom - fit.below * 0.7
            high = person.skeleton.head("neck01")[1] - fit.vee - 0.03
            self.parts += trimmings.buttons((posed, faces, rest), low, high, fit.open_front, self.rng)
        if fit.collar:
            cut = fit.collar, fit.collar_kind
            self.parts += trimmings.collar(person, (posed, faces, rest), *cut, fabric, self.rng)
        self.parts += self._sewn(fit, (posed, faces, rest), region, fabric)
        self.outer = posed, faces, rest
        return part

    def _sewn(self, fit: Fit, garment: tailoring.Garment, region: np.ndarray, fabric: Fabric) -> list[Part]:
        """What the fit says is sewn on."""
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
        """Remove what lies `margin` metres inside a garment about to be worn: nobody sees it, and it cannot
        come through. `inside` is that garment's cut."""
        tree = cKDTree(self.person.tights_rest)
        for part in self.parts:
            hidden = inside[tree.query(part.rest)[1]] > (min(margin, SEWN) if part.sewn else margin)
            part.faces = part.faces[~hidden[part.faces].all(axis=1)]

    def _wrinkles(self, fit: Fit, rest: np.ndarray, region: np.ndarray) -> np.ndarray:
        """Fine creases (V,) in metres on top of the draped folds: across limbs, strongest where they bend."""
        person, rng = self.person, self.rng
        size = np.full(len(rest), 0.5)
        across = rest.copy()
        for k in (*ARMS, *LEGS):
            mine = region == k
            if not mine.any():
                continue
            along, axis, metres = person.limb_coordinates(k, rest[mine])
            middle = np.linalg.norm(np.diff(person.polyline(k), axis=0)[0])
            size[mine] += (
                0.3 + 1.2 * np.exp(-(((metres - middle) / 0.09) ** 2)) + 0.7 * np.exp(-((along / 0.15) ** 2))
            )
            across[mine] = axis + (rest[mine] - axis) * 0.4
        waist = person.skeleton.head("spine04")[1]
        size += np.where(region == 0, 0.6 * np.exp(-(((rest[:, 1] - waist) / 0.08) ** 2)), 0)
        patches = 0.5 + 0.5 * np.clip(fold_noise(rest, rng, 0.2), -1, 1)
        # Creases are ridges more than waves.
        creases = 1 - np.abs(fold_noise(across, rng, rng.uniform(0.04, 0.075))) * 1.2
        fine = 0.4 * fold_noise(across, rng, 0.024) + 0.15 * fold_noise(across, rng, 0.012)
        # Long folds run where the cloth is pulled or hangs: some slanting direction over the trunk.
        pull = unit(np.array([rng.normal() * 0.6, 1.0, rng.normal() * 0.6]))
        trunk = rest - 0.8 * (rest @ pull)[:, None] * pull
        folds = fold_noise(trunk, rng, rng.uniform(0.05, 0.11)) * np.where(region == 0, 1.0, 0.6)
        if self.simulator:
            # Not so deep that they would bring cloth that lies on the body into it.
            return np.maximum(SIMULATED_WRINKLES * fit.wrinkles * 1.6 * size * patches * fine, -0.0005)
        return fit.wrinkles * (1.6 * size * patches * (creases + fine) + 2.2 * (1 - patches) * folds)


def _outside(fit: Fit, pattern: Pattern) -> np.ndarray:
    """Which vertices (V,) the next layer meets: what is tucked in does not push the waistband out."""
    rest = pattern.rest
    return rest[:, 1] > fit.bottom + 0.06 if "hem" in fit.held else np.ones(len(rest), bool)


def carried(person: Person, fit: Fit, pattern: Pattern) -> csr_matrix:
    """Weights (V, J) of the bones that carry the cloth along: softer than the skin's, most at the shoulders.
    A top hangs from the trunk, and is pushed by the thighs rather than drawn with them."""
    weights, base = pattern.weights, person.base
    if fit.leg is None and fit.below <= LONG:
        bones = np.arange(len(base.names))
        to = np.where(np.isin(base.regions, LEGS), base.names.index("root"), bones)
        weights = weights @ csr_matrix((np.ones(len(to)), (bones, to)), (len(to), len(to)))
    edges, _, _ = edges_of(pattern.faces)
    both = np.concatenate([edges, edges[:, ::-1]])
    graph = csr_matrix((np.ones(len(both)), (both[:, 0], both[:, 1])), (len(pattern.rest),) * 2)
    mean = diags(1 / np.maximum(np.asarray(graph.sum(axis=1)).ravel(), 1)) @ graph
    near = _shoulder(person, pattern)
    for step in range(24):
        share = 0.5 * (near if step >= 5 else np.ones_like(near))
        weights = (diags(1 - share) @ weights + diags(share) @ (mean @ weights)).tocsr()
    return weights


def _shoulder(person: Person, pattern: Pattern) -> np.ndarray:
    """How near each vertex is to a shoulder joint, (V,) in [0, 1]."""
    joints = np.stack([person.polyline(k)[0] for k in ARMS])
    distance = np.linalg.norm(pattern.plain[:, None] - joints, axis=2).min(axis=1)
    return np.exp(-((distance / 0.11) ** 2))


def _raised(person: Person, pattern: Pattern) -> np.ndarray:
    """How far the arm of each vertex's side is raised, (V,) in [0, 1]."""
    bones = person.base.names
    up = person.transforms[bones.index("spine02"), :, :3] @ [0, 1, 0]
    sides = []
    for k, side in zip(ARMS, "LR", strict=True):
        joints = person.polyline(k)
        arm = person.transforms[bones.index(f"upperarm01.{side}"), :, :3] @ unit(joints[1] - joints[0])
        sides.append(np.clip((arm @ up + 0.4) / 0.7, 0.2, 1))
    return np.where(pattern.plain[:, 0] > 0, *sides)


def physical(person: Person, fit: Fit, pattern: Pattern, weights: csr_matrix) -> Cut:
    """What a fit means to the simulation.

    Cloth is longer than the cut, as sewn cloth is where it folds: most along sleeves, least where it clings.
    Sleeves that narrow have cuffs, which are held.
    """
    rest, member = pattern.rest, person.membership(pattern.weights)
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
    elif "hem" in fit.held:  # tucked in: all that is too long comes out over the waistband
        trunk = (1.06, 1.06)
    longer = 1 + slack * (member @ (np.array([trunk, arms, arms, legs, legs]) - 1))
    if hangs:
        longer[tube] = 1.01
    axis, held = np.tile([0.0, 1.0, 0.0], (len(rest), 1)), pattern.held.copy()
    for k in (*ARMS, *LEGS):
        mine = np.flatnonzero(region == k)
        along, _, metres = person.limb_coordinates(k, pattern.plain[mine])
        joints = person.polyline(k)
        bones = unit(np.diff(joints, axis=0))
        axis[mine] = bones[(metres > np.linalg.norm(joints[1] - joints[0])).astype(int)]
        if k in ARMS and fit.sleeve is not None and fit.sleeve > 0.9 and fit.sleeve_width < 0.8:
            held[mine] = np.maximum(held[mine], np.clip((along - fit.sleeve + 0.05) / 0.03, 0, 1))
    # A gown hangs from the chest; a hem is free.
    lowest = person.skeleton.head("spine02" if hangs else "upperleg01.L")[1] + 0.05 * (not hangs)
    anchored = ((region > 0) & ~tube) | (rest[:, 1] > lowest) | (fit.leg is not None)
    # An arm that is raised has no use for the cloth over its shoulder: it is stiff there, or crumples.
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
