"""Cloth by physics: garments that follow the body from the rest pose to its pose, and settle on it.

Folds come from the way there and from cloth that is longer than the limb in it; the solver is in solver.py,
what the cloth meets in contact.py. A garment's shape follows from its inputs alone, so that it can be kept in
a folder under their digest. Another kind of processor rounds differently, and gets other folds.
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
from shadow.lightstage.figure import unit, vertex_normals
from shadow.lightstage.people import pocketing, solver
from shadow.lightstage.people.anatomy import Person, skin
from shadow.lightstage.people.cloth import edges_of, fold_noise
from shadow.lightstage.people.contact import Contact, Layer
from shadow.lightstage.people.hollows import FOLDS, Creases, lap, seat

MOVING, SETTLING, CALM = 36, 24, 10  # frames: on the way, after it, and how many of these are damped more
STEPS, RATE = 16, 60  # steps a frame, frames a second
TENSION, COMPRESSION = 400.0, 300.0  # N/m
MASS = 0.2  # kg/m²
ANCHOR, CELL = 0.01, 0.06  # pull a step of the vertices that spread the folds; metres between them
SLIDE = 0.2  # metres between where cloth has slid one way and another
STEEPEST = 6.0  # cotangent of a triangle's angle beyond which it is a sliver
CLEAR = 0.0003  # metres outside a limb that is not its own, at which cloth ends
RECIPE = 9  # part of every digest: count up when the same input is to give other folds


@dataclass(frozen=True)
class Cut:
    """A garment ready to be simulated.

    rest: (V, 3) let out, in the rest pose, metres. slid: (V,) metres that it has slid to and fro over the
    body: as worn, cloth is taut here and loose there. weights: (V, J) of the bones. member: (V, 5) how much
    each vertex follows each region, region (V,) which it belongs to. axis: (V, 3) unit, along the limb.
    held: (V,) in [0, 1], 1 stays where the bones take it. anchored: (V,) where folds are spread by anchors.
    longer: (V, 2) length of the cloth over the cut's, along and across the limb. hinge: (V,) bending
    stiffness, N·m. friction: against what is under it. gap: metres kept from that. spans: whether it goes
    about both legs.
    """

    faces: np.ndarray
    rest: np.ndarray
    slid: np.ndarray
    weights: csr_matrix
    member: np.ndarray
    region: np.ndarray
    axis: np.ndarray
    held: np.ndarray
    anchored: np.ndarray
    longer: np.ndarray
    hinge: np.ndarray
    friction: float
    gap: float
    spans: bool


@dataclass
class Simulator:
    """Simulates the garments of one person from the inside out. name: of the figure; cache: a folder that
    keeps what was simulated, or None."""

    person: Person
    name: str
    cache: Path | None = None
    layers: list[Layer] = field(default_factory=list)
    digest: str = ""

    @cached_property
    def poses(self) -> list[np.ndarray]:
        """Transforms (J, 3, 4) of the frames from the rest pose on."""
        shares = np.linspace(0, 1, MOVING + 1)
        return [self.person.towards(share) for share in shares]

    def pose(self, frame: int) -> np.ndarray:
        return self.poses[min(frame, MOVING)]

    def stand(self, between: np.ndarray) -> None:
        """The body as the first layer, with what cloth spans on it. between: as of `Layer`, of the tights."""
        tights, film = self.person.base.tights, seat(self.person)
        rest, weights = film @ self.person.tights_rest, (film @ tights.weights).tocsr()
        creases = Creases(tights.faces, len(rest))
        sheets, faces = lap(self.person)
        frames = [skin(weights, self.pose(frame), rest) for frame in range(MOVING + 1)]
        swollen = pocketing.bulge(self.person)
        bodies = [creases.filled(points) for points in frames]
        if swollen.any():
            for frame, points in enumerate(bodies):
                share = min(1.0, 1.5 * frame / MOVING)
                points += vertex_normals(points, tights.faces) * (share * swollen)[:, None]
        bodies = [points.astype(np.float32) for points in bodies]
        laps = [(sheets @ points).astype(np.float32) for points in frames]
        member, solid = self.person.tights_member, np.ones(len(rest), bool)
        bare = self.person.posed(tights.weights, self.person.tights_rest)
        nowhere = np.zeros(sheets.shape[0])
        self.layers += [
            Layer(tights.faces, lambda k: bodies[min(k, MOVING)], member, between, solid, bare=bare),
            Layer(faces, lambda k: laps[min(k, MOVING)], nowhere, nowhere, nowhere, lap=True),
        ]
        self._note(rest)
        self._note(swollen)

    def follow(self, faces: np.ndarray, rest: np.ndarray, weights: csr_matrix, between: np.ndarray) -> None:
        """Add a layer that follows the bones alone: shoes."""
        member, solid = self.person.membership(weights), np.ones(len(rest), bool)
        self.layers.append(Layer(faces, lambda k: skin(weights, self.pose(k), rest), member, between, solid))
        self._note(rest)

    def _note(self, rest: np.ndarray) -> None:
        self.digest = hashlib.sha256(self.digest.encode() + rest.tobytes()).hexdigest()

    def drape(self, cut: Cut, between: np.ndarray, solid: np.ndarray) -> np.ndarray:
        """Simulate a garment (V, 3) over the layers so far, and add it to them. between, solid: as of
        `Layer`."""
        self.digest = _digest(cut, self.digest, self.person)
        draped = Draped(self, cut, list(self.layers), self.digest)
        self.layers.append(Layer(cut.faces, draped.spanned, cut.member, between, solid))
        return draped.final


class Draped:
    """One simulated garment: its last frame, kept in the cache, and all frames if somebody wants them."""

    def __init__(self, simulator: Simulator, cut: Cut, layers: list[Layer], digest: str) -> None:
        self.simulator, self.cut, self.layers, self.digest = simulator, cut, layers, digest

    def spanned(self, frame: int) -> np.ndarray:
        """What the next layer meets (V, 3): the folds filled, or it would be wedged in them."""
        return self._spanned[min(frame, len(self.frames) - 1)]

    @cached_property
    def _spanned(self) -> np.ndarray:
        creases = Creases(self.cut.faces, len(self.cut.rest))
        return np.stack([creases.filled(points.astype(float), FOLDS) for points in self.frames])

    @cached_property
    def final(self) -> np.ndarray:
        folder = self.simulator.cache
        if folder is None:
            return self.frames[-1].astype(float)
        path = folder / f"{self.simulator.name}-{self.digest}.npz"
        kept = _kept(path, self.cut.rest.shape)
        if kept is None:
            kept = self.frames[-1]
            folder.mkdir(parents=True, exist_ok=True)
            with replacing(path) as beside, open(beside, "wb") as file:
                np.savez(file, vertices=kept)
        return kept.astype(float)

    @cached_property
    def frames(self) -> np.ndarray:
        """(frames + 1, V, 3) float32, the first at rest."""
        return np.stack(list(self._run()))

    def _run(self) -> Iterator[np.ndarray]:
        cut, rng = self.cut, np.random.default_rng(int(self.digest[:16], 16))
        cloth = sewn(cut, rng)
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
                motion = (_carried(x - target, blended, there) + goal - x) / np.float32(STEPS)
                blended, target = there, goal
            if frame % 4 == 1:
                contact.search(x, frame - 1)
            damping = 0.997 if frame <= MOVING + SETTLING - CALM else 0.985
            solver.frame(
                x, before, cloth, contact.during(frame), contact.own, contact.other, came, target,
                motion.astype(np.float32), STEPS, np.float32(1 / RATE / STEPS), np.float32(damping),
            )  # fmt: skip
            if frame == MOVING + SETTLING:
                self._let_off(x, cloth, contact)
            yield x.copy()

    @cached_property
    def worn(self) -> np.ndarray:
        """Where anchors draw the cut (V, 3) to, in the rest pose."""
        cut, rng = self.cut, np.random.default_rng(int(self.digest[16:], 16))
        way = np.stack([fold_noise(cut.rest, rng, SLIDE) for _ in range(3)], axis=1)
        normals = vertex_normals(cut.rest, cut.faces)
        way -= (way * normals).sum(axis=1, keepdims=True) * normals
        return cut.rest + way * (rng.uniform(0.4, 1.4) * cut.slid)[:, None]

    def _targets(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Blended transforms (V, 3, 3) of a frame and where they take the cut (V, 3)."""
        pose = self.simulator.pose(frame)
        blended = (self.cut.weights @ pose.reshape(len(pose), 12)).reshape(-1, 3, 4)
        target = np.einsum("vij,vj->vi", blended[:, :, :3], self.worn) + blended[:, :, 3]
        return blended[:, :, :3].astype(np.float32), target.astype(np.float32)

    def _let_off(self, x: np.ndarray, cloth: solver.Cloth, contact: Contact) -> None:
        """Push out what is still inside what it covers, and let the cloth around it give."""
        margin = 0.5 * self.cut.gap
        for _ in range(3):
            moved = contact.push_out(x, margin)
            lightness = np.where(moved, 0.1, 1).astype(np.float32) * cloth.lightness
            eased = cloth._replace(lightness=lightness)
            for _ in range(4):
                solver.stretch(x, eased)
                solver.bend(x, eased)
        # In an armpit or the groin cloth comes out of one limb into another.
        for last in (False, False, True):
            contact.push_out(x, margin)
            contact.push_out(x, CLEAR, limbs=False, afresh=last)


def _kept(path: Path, shape: tuple[int, ...]) -> np.ndarray | None:
    """Vertices (V, 3) as they were kept; None if there are none, or the file is not whole."""
    try:
        with np.load(path) as file:
            vertices = file["vertices"]
    except (OSError, EOFError, ValueError, KeyError, BadZipFile):
        return None
    return vertices if vertices.shape == shape else None


def sewn(cut: Cut, rng: np.random.Generator) -> solver.Cloth:
    """The constraints of a garment; `rng` places its anchors and varies its length a little."""
    rest, faces = cut.rest, cut.faces
    step = 1 / RATE / STEPS
    corners = rest[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    share = np.bincount(faces.ravel(), np.repeat(area, 3) / 3, len(rest))
    edges, _, _ = edges_of(faces)
    length = _longer(cut, edges) * (1 + 0.02 * fold_noise(rest[edges].mean(axis=1), rng, 0.06))
    hinges, stencil, stiffness = _hinges(rest, faces, cut.hinge)
    anchors = np.zeros(len(rest))
    cells = np.floor(rest / CELL).astype(int)
    shuffled = rng.permutation(np.flatnonzero(cut.anchored))
    _, first = np.unique(cells[shuffled], axis=0, return_index=True)
    anchors[shuffled[first]] = ANCHOR
    pull = np.maximum(anchors, 0.9 * cut.held)
    tether, leash = _tethers(edges, length, pull > 0.3)
    return solver.Cloth(
        lightness=(1 / (MASS * np.maximum(share, 0.2 * share.mean()))).astype(np.float32),
        edges=edges.astype(np.int32),
        length=length.astype(np.float32),
        tension=np.float32(1 / (TENSION * step**2)),
        compression=np.float32(1 / (COMPRESSION * step**2)),
        hinges=hinges.astype(np.int32),
        stencil=stencil.astype(np.float32),
        bending=(1 / (stiffness * step**2)).astype(np.float32),
        pull=pull.astype(np.float32),
        tether=tether.astype(np.int32),
        leash=leash.astype(np.float32),
        rest=rest.astype(np.float32),
        friction=np.float32(cut.friction),
        thickness=np.float32(0.006),
    )


def _longer(cut: Cut, edges: np.ndarray) -> np.ndarray:
    """Lengths (E,) of edges of which the part along the limb and the part across it are longer than cut."""
    span = cut.rest[edges[:, 1]] - cut.rest[edges[:, 0]]
    axis, longer = unit(cut.axis[edges].mean(axis=1)), cut.longer[edges].mean(axis=1)
    along = (span * axis).sum(axis=1)
    across = np.sqrt(np.maximum((span * span).sum(axis=1) - along**2, 0))
    return np.hypot(along * longer[:, 0], across * longer[:, 1])


def _tethers(edges: np.ndarray, length: np.ndarray, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of each vertex the nearest that is held fast, or itself, and the metres of cloth to it."""
    graph = csr_matrix((length, (edges[:, 0], edges[:, 1])), (len(held), len(held)))
    if not held.any():
        return np.arange(len(held)), np.zeros(len(held))
    leash, _, tether = dijkstra(graph, False, np.flatnonzero(held), return_predecessors=True, min_only=True)
    there = np.isfinite(leash) & (leash > 0)
    return np.where(there, tether, np.arange(len(held))), np.where(there, leash, 0)


def _hinges(
    rest: np.ndarray, faces: np.ndarray, hinge: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inner edges with the vertices opposite (H, 4), their stencils (H, 4) and stiffness (H,), of quadratic
    isometric bending (Bergou et al. 2006, "A Quadratic Bending Model for Inextensible Surfaces")."""
    edges, side, shared = edges_of(faces)
    opposite = np.roll(faces, 1, axis=1).ravel()
    order = np.argsort(side.ravel(), kind="stable")
    inner = np.flatnonzero(shared == 2)
    first = np.concatenate([[0], np.cumsum(shared)])[inner]
    hinges = np.concatenate(
        [edges[inner], opposite[order[first], None], opposite[order[first + 1], None]], axis=1
    )
    a, b, c, d = (rest[hinges[:, k]] for k in range(4))

    def cotangent(corner: np.ndarray, one: np.ndarray, two: np.ndarray) -> np.ndarray:
        one, two = one - corner, two - corner
        return (one * two).sum(axis=1) / np.maximum(np.linalg.norm(np.cross(one, two), axis=1), 1e-12)

    c_a, d_a, c_b, d_b = cotangent(a, b, c), cotangent(a, b, d), cotangent(b, a, c), cotangent(b, a, d)
    stencil = np.stack([c_b + d_b, c_a + d_a, -c_a - c_b, -d_a - d_b], axis=1)
    steep = np.abs([c_a, d_a, c_b, d_b]).max(axis=0)
    # Clipped entries would no longer sum to zero, and a flat sliver would pull.
    stencil *= np.minimum(1, STEEPEST / np.maximum(steep, 1e-12))[:, None]
    area = sum(np.linalg.norm(np.cross(b - a, p - a), axis=1) / 2 for p in (c, d))
    return hinges, stencil, hinge[hinges[:, :2]].mean(axis=1) * 3 / np.maximum(area, 1e-8)


def _carried(offset: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Offsets (V, 3) of cloth from its targets, turned as the bones turn from one frame to the next."""
    turned = np.einsum("vij,vj->vi", after, np.linalg.solve(before, offset[:, :, None])[:, :, 0])
    now, then = np.linalg.norm(turned, axis=1), np.linalg.norm(offset, axis=1)
    stretch = now / np.maximum(then, 1e-9)
    # Where blended bones nearly cancel out, deep in an elbow, there is no turn to be had.
    sound = (stretch > 0.7) & (stretch < 1.4)
    return np.where(sound[:, None], turned / np.maximum(stretch, 0.1)[:, None], offset)


def _digest(cut: Cut, under: str, person: Person) -> str:
    """What a garment's shape follows from."""
    state = hashlib.sha256(f"{RECIPE} {under}".encode())
    state.update(np.ascontiguousarray(person.transforms).tobytes())
    for column in fields(cut):
        value = getattr(cut, column.name)
        if isinstance(value, csr_matrix):
            value = np.concatenate([value.indptr, value.indices, value.data])
        state.update(np.ascontiguousarray(value).tobytes())
    return state.hexdigest()[:24]
