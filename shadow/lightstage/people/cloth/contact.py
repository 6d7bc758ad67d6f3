"""Collision of simulated cloth with the body and the garments under it, frame by frame.

The cloth of a limb collides with its own limb first, so that a hanging arm does not push the shirt into the
trunk, and with other obstacles second.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from shadow.lightstage.figure import vertex_normals
from shadow.lightstage.people.body.anatomy import ARMS, LEGS
from shadow.lightstage.people.cloth import solver
from shadow.lightstage.people.cloth.nearest import MeshSurface, neighbours

LAST = 1 << 30  # number of a frame after all others
ALL_KINDS = np.uint16(0xFFFF)
# Kinds of contact, as bits: with the obstacle under cloth of each region, and with other obstacles.
TRUNK, ARM_LEFT, ARM_RIGHT, LEG_LEFT, LEG_RIGHT = (1 << k for k in range(5))
FOREARMS, FLANKS, OTHER_LEFT, OTHER_RIGHT = (1 << k for k in range(5, 9))
UNDER = np.array([TRUNK, ARM_LEFT, ARM_RIGHT, LEG_LEFT, LEG_RIGHT], np.uint16)
BESIDES = np.array([FOREARMS, FLANKS, FLANKS, OTHER_RIGHT, OTHER_LEFT], np.uint16)


@dataclass(frozen=True)
class Layer:
    """A surface under the cloth.

    faces: (F, 3). positions: frame -> (P, 3). member: (P, 5), the weight of each region at each vertex.
    between: (P,), whether a vertex faces the other leg. solid: (P,), whether cloth collides with it. lap:
    whether it is a lap between the legs, with which only cloth around both legs collides. bare: (P, 3), the
    final positions, if cloth collides with a smoothed surface.
    """

    faces: np.ndarray
    positions: Callable[[int], np.ndarray]
    member: np.ndarray
    between: np.ndarray
    solid: np.ndarray
    lap: bool = False
    bare: np.ndarray | None = None

    def allowed(self, spans: bool) -> np.ndarray:
        """Return the kinds of contact (P,) of each vertex.

        `spans`: whether the cloth hangs around both legs and does not follow the gap between them.
        """
        if self.lap:
            return np.full(len(self.solid), TRUNK if spans else 0, np.uint16)
        arms = self.member[:, ARMS].sum(axis=1)
        kinds = [
            (arms < 0.6) & ~(self.between & spans),
            *(self.member[:, k] > 0.1 for k in ARMS),
            *((self.member[:, k] > 0.05) | (self.member[:, 0] > 0.5) for k in LEGS),
            arms > 0.95,
            self.member[:, 0] > 0.95,
            *(self.member[:, k] > 0.95 for k in LEGS),
        ]
        bits = sum(kind.astype(np.uint16) << k for k, kind in enumerate(kinds))
        return np.where(self.solid, bits, 0).astype(np.uint16)


class Contact:
    """The layers under one garment as one obstacle, and the planes with which its vertices collide."""

    def __init__(self, layers: list[Layer], region: np.ndarray, *, spans: bool, gap: float) -> None:
        self.layers, self.spans = layers, spans
        self.beside: dict[bool, list[np.ndarray]] = {}  # nearest vertices at the end, which hardly change
        self.last: tuple[int, np.ndarray, np.ndarray] | None = None
        counts = np.cumsum([0] + [len(layer.member) for layer in layers])
        self.faces = np.concatenate(
            [layer.faces + start for layer, start in zip(layers, counts[:-1], strict=True)]
        )
        self.allowed = np.concatenate([layer.allowed(spans) for layer in layers])
        self.first, self.ring = neighbours(self.faces, counts[-1])
        points, _ = self._at(0)
        degree = np.diff(self.first)
        square = ((points[self.ring] - np.repeat(points, degree, axis=0)) ** 2).sum(axis=1)
        around = np.bincount(np.repeat(np.arange(len(points)), degree), square, len(points))
        self.reach = (0.3 * around / np.maximum(degree, 1) + 1e-8).astype(np.float32)
        self.own = self._planes(UNDER[region], gap, deepest=0.06)
        self.other = self._planes(BESIDES[region], gap, deepest=0.02)

    def _planes(self, bits: np.ndarray, gap: float, deepest: float) -> solver.Planes:
        point, normal, motion = (np.zeros((len(bits), 3), np.float32) for _ in range(3))
        near = np.full(len(bits), -1, np.int32)
        return solver.Planes(near, bits, point, normal, motion, np.float32(gap), np.float32(deepest))

    def _at(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and normals (P, 3) of the obstacle; cached, since the next frame starts there."""
        if self.last is None or self.last[0] != frame:
            parts = [layer.positions(frame) for layer in self.layers]
            normals = [vertex_normals(p, layer.faces) for p, layer in zip(parts, self.layers, strict=True)]
            points, upward = (np.ascontiguousarray(np.concatenate(x), np.float32) for x in (parts, normals))
            self.last = frame, points, upward
        return self.last[1:]

    def during(self, frame: int) -> solver.Obstacle:
        """Return the obstacle that moves from the previous frame to `frame`."""
        start, _ = self._at(max(frame - 1, 0))
        end, normals = self._at(frame)
        return solver.Obstacle(start, end, normals, self.first, self.ring, self.allowed, self.reach)

    def search(self, cloth: np.ndarray, frame: int) -> None:
        """Search the nearest vertices of the obstacle; between searches the solver tracks them."""
        points, _ = self._at(frame)
        for planes, reach in ((self.own, np.inf), (self.other, 0.05)):
            for bits in np.unique(planes.bits):
                mine, there = np.flatnonzero(planes.bits == bits), np.flatnonzero(self.allowed & bits)
                planes.near[mine] = -1
                if len(there):
                    distance, near = cKDTree(points[there]).query(cloth[mine])
                    planes.near[mine] = np.where(
                        distance < reach, there[np.minimum(near, len(there) - 1)], -1
                    )

    def push_out(
        self, cloth: np.ndarray, margin: float, *, limbs: bool = True, afresh: bool = False
    ) -> np.ndarray:
        """Move final cloth (V, 3), in place, to `margin` metres outside the layers; return what moved (V,).

        Distances are to triangles, layer by layer, the body last. limbs: whether cloth collides only with
        what lies under it, as in the simulation, or with all layers, so that a sleeve leaves the trunk too.
        afresh: whether to search the nearest vertices again, or to use those of the first call.
        """
        moved = np.zeros(len(cloth), bool)
        if afresh or limbs not in self.beside:
            kinds = self.own.bits if limbs else np.full(len(cloth), ALL_KINDS)
            self.beside[limbs] = [_nearest(cloth, kinds, *layer) for layer in self.final]
        for (surface, _), near in reversed(list(zip(self.final, self.beside[limbs], strict=True))):
            met = np.flatnonzero(near >= 0)
            height, foot, normal = surface.heights(cloth[met], near[met])
            inside = (height < margin) & (height > -self.own.deepest)
            cloth[met[inside]] = foot[inside] + margin * normal[inside]
            moved[met[inside]] = True
        return moved

    @cached_property
    def final(self) -> list[tuple[MeshSurface, np.ndarray]]:
        """The final surface of each layer except laps, and the kinds of contact (P,) of its vertices."""
        ends = []
        for layer in (layer for layer in self.layers if not layer.lap):
            allowed = layer.allowed(self.spans)
            if layer.bare is not None:
                ends.append((MeshSurface(layer.bare, layer.faces), allowed))
            ends.append((MeshSurface(layer.positions(LAST), layer.faces), allowed))
        return ends


def _nearest(cloth: np.ndarray, kinds: np.ndarray, surface: MeshSurface, allowed: np.ndarray) -> np.ndarray:
    """Return, for each vertex of the cloth (V,), the nearest of the surface with a common kind, or -1."""
    near = np.full(len(cloth), -1)
    for bits in np.unique(kinds):
        mine, there = np.flatnonzero(kinds == bits), np.flatnonzero(allowed & bits)
        if len(there):
            near[mine] = there[cKDTree(surface.points[there]).query(cloth[mine])[1]]
    return near
