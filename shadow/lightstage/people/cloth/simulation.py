"""Cloth simulation: garments follow the body from the rest pose to its pose, and settle on it.

Folds arise from this motion, and from cloth that is longer than the limb inside it. The solver is in
solver.py, collisions are in contact.py. The shape of a garment depends only on its inputs, so it can be
cached under their digest. Processors of another kind round differently and get other folds.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from shadow.files import replacing
from shadow.lightstage.figure import normalize, vertex_normals
from shadow.lightstage.mesh import inner_edges, unique_edges
from shadow.lightstage.people.body.anatomy import Person, skin
from shadow.lightstage.people.cloth import pockets, solver
from shadow.lightstage.people.cloth.concavities import GARMENT_ROUNDS, CreaseFilling, lap_sheets, seat_film
from shadow.lightstage.people.cloth.contact import Contact, Layer
from shadow.lightstage.people.cloth.draping import fold_noise

# Frames of motion, frames after it, and how many of these, the last, are strongly damped.
MOVING, SETTLING, CALM = 36, 24, 10
STEPS, RATE = 16, 60  # steps in each frame, frames in each second
TENSION, COMPRESSION = 400.0, 300.0  # stiffness in N/m
MASS = 0.2  # kg/m²
ANCHOR, CELL = 0.01, 0.06  # pull in each step of anchors, which distribute the folds; metres between them
SLIDE = 0.2  # metres: wavelength of the random sliding of cloth
MAX_COTANGENT = 6.0  # of a triangle's angle; beyond it the triangle is a sliver
LIMB_CLEARANCE = 0.0003  # metres between final cloth and another limb
VERSION = 9  # part of every digest: increment it if the same input is to give other folds


@dataclass(frozen=True)
class Cut:
    """A garment, ready to be simulated."""

    faces: np.ndarray  # (F, 3)
    rest: np.ndarray  # (V, 3) let out, in the rest pose, metres
    slid: np.ndarray  # (V,) metres by which it has slid over the body: worn cloth is taut here, loose there
    weights: csr_matrix  # (V, J) of the bones
    member: np.ndarray  # (V, 5) of the regions
    region: np.ndarray  # (V,) index into anatomy.REGIONS
    axis: np.ndarray  # (V, 3) unit, along the limb
    held: np.ndarray  # (V,) in [0, 1]: 1 follows the bones
    anchored: np.ndarray  # (V,) bool: where anchors distribute the folds
    longer: np.ndarray  # (V, 2) length of the cloth relative to the pattern, along and across the limb
    hinge: np.ndarray  # (V,) bending stiffness, N·m
    friction: float  # coefficient against the layers under it
    gap: float  # metres between it and these layers
    spans: bool  # whether it goes around both legs


@dataclass
class Simulator:
    """Simulates the garments of one person, from the inside out.

    name: that of the figure. cache: a folder that stores simulated garments, or None.
    """

    person: Person
    name: str
    cache: Path | None = None
    layers: list[Layer] = field(default_factory=list)
    digest: str = ""

    @cached_property
    def poses(self) -> list[np.ndarray]:
        """Transforms (J, 3, 4) of the bones in each frame, from the rest pose on."""
        shares = np.linspace(0, 1, MOVING + 1)
        return [self.person.interpolated_transforms(share) for share in shares]

    def pose(self, frame: int) -> np.ndarray:
        """Return the transforms (J, 3, 4) of the bones in a frame."""
        return self.poses[min(frame, MOVING)]

    def stand(self, between: np.ndarray) -> None:
        """Add the body as the first layer, with its concavities filled. between: see `Layer`."""
        tights, film = self.person.base.tights, seat_film(self.person)
        rest, weights = film @ self.person.tights_rest, (film @ tights.weights).tocsr()
        creases = CreaseFilling(tights.faces, len(rest))
        sheets, faces = lap_sheets(self.person)
        frames = [skin(weights, self.pose(frame), rest) for frame in range(MOVING + 1)]
        swollen = pockets.bulge(self.person)
        bodies = [creases.filled(points) for points in frames]
        if swollen.any():
            for frame, points in enumerate(bodies):
                share = min(1.0, 1.5 * frame / MOVING)
                points += vertex_normals(points, tights.faces) * (share * swollen)[:, None]
        bodies = [points.astype(np.float32) for points in bodies]
        laps = [(sheets @ points).astype(np.float32) for points in frames]
        member, solid = self.person.tights_regions, np.ones(len(rest), bool)
        bare = self.person.posed(tights.weights, self.person.tights_rest)
        nowhere = np.zeros(sheets.shape[0])
        self.layers += [
            Layer(tights.faces, lambda k: bodies[min(k, MOVING)], member, between, solid, bare=bare),
            Layer(faces, lambda k: laps[min(k, MOVING)], nowhere, nowhere, nowhere, lap=True),
        ]
        self._note(rest)
        self._note(swollen)

    def follow(self, faces: np.ndarray, rest: np.ndarray, weights: csr_matrix, between: np.ndarray) -> None:
        """Add a layer that only follows the bones, such as shoes."""
        member, solid = self.person.region_weights(weights), np.ones(len(rest), bool)
        self.layers.append(Layer(faces, lambda k: skin(weights, self.pose(k), rest), member, between, solid))
        self._note(rest)

    def _note(self, rest: np.ndarray) -> None:
        self.digest = hashlib.sha256(self.digest.encode() + rest.tobytes()).hexdigest()

    def drape(self, cut: Cut, between: np.ndarray, solid: np.ndarray) -> np.ndarray:
        """Simulate a garment over the layers so far, and add it to them. between, solid: see `Layer`.

        Returns its posed vertices (V, 3).
        """
        self.digest = digest_of(cut, self.digest, self.person)
        draped = GarmentSimulation(self, cut, list(self.layers), self.digest)
        last = MOVING + SETTLING
        self.layers.append(
            Layer(cut.faces, lambda k: draped.spanned[min(k, last)], cut.member, between, solid)
        )
        return draped.final


class GarmentSimulation:
    """One simulated garment: its final frame, which is cached, and all frames if they are needed."""

    def __init__(self, simulator: Simulator, cut: Cut, layers: list[Layer], digest: str) -> None:
        self.simulator, self.cut, self.layers, self.digest = simulator, cut, layers, digest

    @cached_property
    def spanned(self) -> np.ndarray:
        """The surface (frames + 1, V, 3) with which the next layer collides: folds are filled, so that the
        next layer is not wedged in them."""
        creases = CreaseFilling(self.cut.faces, len(self.cut.rest))
        return np.stack([creases.filled(points.astype(float), GARMENT_ROUNDS) for points in self.frames])

    @cached_property
    def final(self) -> np.ndarray:
        """Vertices (V, 3) of the last frame, from the cache if it has them."""
        folder = self.simulator.cache
        if folder is None:
            return self.frames[-1].astype(float)
        path = folder / f"{self.simulator.name}-{self.digest}.npz"
        vertices = _read_cached(path, self.cut.rest.shape)
        if vertices is None:
            vertices = self.frames[-1]
            folder.mkdir(parents=True, exist_ok=True)
            with replacing(path) as beside, open(beside, "wb") as file:
                np.savez(file, vertices=vertices)
        return vertices.astype(float)

    @cached_property
    def frames(self) -> np.ndarray:
        """Vertices (frames + 1, V, 3) of all frames, float32; the first is at rest."""
        return np.stack(list(self._run()))

    def _run(self) -> Iterator[np.ndarray]:
        cut, rng = self.cut, np.random.default_rng(int(self.digest[:16], 16))
        cloth = build_constraints(cut, rng)
        rest_normals = vertex_normals(cut.rest, cut.faces)
        start = cut.rest + rest_normals * (0.0015 * fold_noise(cut.rest, rng, 0.05))[:, None]
        x = np.ascontiguousarray(start, np.float32)
        before = x.copy()
        contact = Contact(self.layers, cut.region, spans=cut.spans, gap=cut.gap)
        blended, target = self._targets(0)
        yield x.copy()
        for frame in range(1, MOVING + SETTLING + 1):
            motion, came = np.zeros_like(x), target
            if frame <= MOVING:
                there, goal = self._targets(frame)
                motion = (_rotate_offsets(x - target, blended, there) + goal - x) / np.float32(STEPS)
                blended, target = there, goal
            if frame % 4 == 1:
                contact.search(x, frame - 1)
            damping = 0.997 if frame <= MOVING + SETTLING - CALM else 0.985
            solver.frame(
                x, before, cloth, contact.during(frame), contact.own, contact.other, came, target,
                motion.astype(np.float32), STEPS, np.float32(1 / RATE / STEPS), np.float32(damping),
            )  # fmt: skip
            if frame == MOVING + SETTLING:
                self._resolve_penetrations(x, cloth, contact)
            yield x.copy()

    @cached_property
    def worn(self) -> np.ndarray:
        """The targets (V, 3) of the anchors in the rest pose."""
        cut, rng = self.cut, np.random.default_rng(int(self.digest[16:], 16))
        way = np.stack([fold_noise(cut.rest, rng, SLIDE) for _ in range(3)], axis=1)
        normals = vertex_normals(cut.rest, cut.faces)
        way -= (way * normals).sum(axis=1, keepdims=True) * normals
        return cut.rest + way * (rng.uniform(0.4, 1.4) * cut.slid)[:, None]

    def _targets(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the blended rotations (V, 3, 3) of a frame, and the targets of the vertices (V, 3)."""
        pose = self.simulator.pose(frame)
        blended = (self.cut.weights @ pose.reshape(len(pose), 12)).reshape(-1, 3, 4)
        target = np.einsum("vij,vj->vi", blended[:, :, :3], self.worn) + blended[:, :, 3]
        return blended[:, :, :3].astype(np.float32), target.astype(np.float32)

    def _resolve_penetrations(self, x: np.ndarray, cloth: solver.Cloth, contact: Contact) -> None:
        """Push cloth out of the layers under it, and relax the cloth around."""
        margin = 0.5 * self.cut.gap
        for _ in range(3):
            moved = contact.push_out(x, margin)
            inverse_mass = np.where(moved, 0.1, 1).astype(np.float32) * cloth.inverse_mass
            eased = cloth._replace(inverse_mass=inverse_mass)
            for _ in range(4):
                solver.stretch(x, eased)
                solver.bend(x, eased)
        # In an armpit or the groin, cloth may leave one limb and enter another.
        for last in (False, False, True):
            contact.push_out(x, margin)
            contact.push_out(x, LIMB_CLEARANCE, limbs=False, afresh=last)


def _read_cached(path: Path, shape: tuple[int, ...]) -> np.ndarray | None:
    """Read cached vertices (V, 3); None if there are none, or the file is damaged."""
    try:
        with np.load(path) as file:
            vertices = file["vertices"]
    except (OSError, EOFError, ValueError, KeyError, BadZipFile):
        return None
    return vertices if vertices.shape == shape else None


def build_constraints(cut: Cut, rng: np.random.Generator) -> solver.Cloth:
    """Return the constraints of a garment; `rng` places its anchors and slightly varies its edge lengths."""
    rest, faces = cut.rest, cut.faces
    step = 1 / RATE / STEPS
    corners = rest[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    share = np.bincount(faces.ravel(), np.repeat(area, 3) / 3, len(rest))
    edges, _, _ = unique_edges(faces)
    length = _rest_lengths(cut, edges) * (1 + 0.02 * fold_noise(rest[edges].mean(axis=1), rng, 0.06))
    hinges, stencil, stiffness = _bending_hinges(rest, faces, cut.hinge)
    anchors = np.zeros(len(rest))
    cells = np.floor(rest / CELL).astype(int)
    shuffled = rng.permutation(np.flatnonzero(cut.anchored))
    _, first = np.unique(cells[shuffled], axis=0, return_index=True)
    anchors[shuffled[first]] = ANCHOR
    pull = np.maximum(anchors, 0.9 * cut.held)
    tether, tether_length = _tethers(edges, length, pull > 0.3)
    return solver.Cloth(
        inverse_mass=(1 / (MASS * np.maximum(share, 0.2 * share.mean()))).astype(np.float32),
        edges=edges.astype(np.int32),
        length=length.astype(np.float32),
        tension=np.float32(1 / (TENSION * step**2)),
        compression=np.float32(1 / (COMPRESSION * step**2)),
        hinges=hinges.astype(np.int32),
        stencil=stencil.astype(np.float32),
        bending=(1 / (stiffness * step**2)).astype(np.float32),
        pull=pull.astype(np.float32),
        tether=tether.astype(np.int32),
        tether_length=tether_length.astype(np.float32),
        rest=rest.astype(np.float32),
        friction=np.float32(cut.friction),
        thickness=np.float32(0.006),
    )


def _rest_lengths(cut: Cut, edges: np.ndarray) -> np.ndarray:
    """Return the rest lengths (E,) of edges, scaled along and across the limb by `Cut.longer`."""
    span = cut.rest[edges[:, 1]] - cut.rest[edges[:, 0]]
    axis, longer = normalize(cut.axis[edges].mean(axis=1)), cut.longer[edges].mean(axis=1)
    along = (span * axis).sum(axis=1)
    across = np.sqrt(np.maximum((span * span).sum(axis=1) - along**2, 0))
    return np.hypot(along * longer[:, 0], across * longer[:, 1])


def _tethers(edges: np.ndarray, length: np.ndarray, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest held vertex of each vertex (V,), or itself, and the geodesic distance in metres."""
    graph = csr_matrix((length, (edges[:, 0], edges[:, 1])), (len(held), len(held)))
    if not held.any():
        return np.arange(len(held)), np.zeros(len(held))
    tether_length, _, tether = dijkstra(
        graph, False, np.flatnonzero(held), return_predecessors=True, min_only=True
    )
    there = np.isfinite(tether_length) & (tether_length > 0)
    return np.where(there, tether, np.arange(len(held))), np.where(there, tether_length, 0)


def _bending_hinges(
    rest: np.ndarray, faces: np.ndarray, hinge: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the hinges of quadratic isometric bending: vertices (H, 4), stencils (H, 4), stiffness (H,).

    The vertices are those of an inner edge and the two opposite ones (Bergou et al. 2006, "A Quadratic
    Bending Model for Inextensible Surfaces").
    """
    hinges = inner_edges(faces)
    a, b, c, d = (rest[hinges[:, k]] for k in range(4))

    def cotangent(corner: np.ndarray, one: np.ndarray, two: np.ndarray) -> np.ndarray:
        one, two = one - corner, two - corner
        return (one * two).sum(axis=1) / np.maximum(np.linalg.norm(np.cross(one, two), axis=1), 1e-12)

    c_a, d_a, c_b, d_b = cotangent(a, b, c), cotangent(a, b, d), cotangent(b, a, c), cotangent(b, a, d)
    stencil = np.stack([c_b + d_b, c_a + d_a, -c_a - c_b, -d_a - d_b], axis=1)
    steep = np.abs([c_a, d_a, c_b, d_b]).max(axis=0)
    # Scaled rather than clipped: the entries must sum to zero, or a flat sliver would exert a force.
    stencil *= np.minimum(1, MAX_COTANGENT / np.maximum(steep, 1e-12))[:, None]
    area = sum(np.linalg.norm(np.cross(b - a, p - a), axis=1) / 2 for p in (c, d))
    return hinges, stencil, hinge[hinges[:, :2]].mean(axis=1) * 3 / np.maximum(area, 1e-8)


def _rotate_offsets(offset: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Rotate offsets (V, 3) of cloth from its targets with the bones, from one frame to the next."""
    turned = np.einsum("vij,vj->vi", after, np.linalg.solve(before, offset[:, :, None])[:, :, 0])
    now, then = np.linalg.norm(turned, axis=1), np.linalg.norm(offset, axis=1)
    stretch = now / np.maximum(then, 1e-9)
    # Where blended rotations nearly cancel, deep in an elbow, the rotation is undefined.
    sound = (stretch > 0.7) & (stretch < 1.4)
    return np.where(sound[:, None], turned / np.maximum(stretch, 0.1)[:, None], offset)


def digest_of(cut: Cut, under: str, person: Person) -> str:
    """Return the digest of all that determines the shape of a garment."""
    state = hashlib.sha256(f"{VERSION} {under}".encode())
    state.update(np.ascontiguousarray(person.transforms).tobytes())
    for column in fields(cut):
        value = getattr(cut, column.name)
        if isinstance(value, csr_matrix):
            value = np.concatenate([value.indptr, value.indices, value.data])
        state.update(np.ascontiguousarray(value).tobytes())
    return state.hexdigest()[:24]
