"""Clothed, posed people, drawn at random: `body(seed, split)`.

The three splits never share a person: the split's name is hashed into the seed. They do not share all cuts
and patterns either. Validation adds floral prints; generalisation adds herringbone and tie-dye.
"""

import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix, identity

from shadow.data import records
from shadow.lightstage.figure import Figure, interpolate, unit, vertex_normals
from shadow.lightstage.people import outfits, pocketing, poses
from shadow.lightstage.people.anatomy import REGIONS, Mannequin, Person, mannequin
from shadow.lightstage.people.cloth import compact
from shadow.lightstage.people.fabric import Fabric, Noise, Part
from shadow.lightstage.people.faces import Face
from shadow.lightstage.people.garments import Wardrobe
from shadow.lightstage.people.simulation import Simulator
from shadow.lightstage.people.skeleton import Posing, Skeleton

IN_POCKET = 0.006  # metres inside a pocket from which a hand is not seen
SPLITS = ("training", "validation", "generalisation")


def body(seed: int, split: str, *, simulate: bool = False, cache: Path | None = None) -> Figure:
    """A clothed person in a pose; the same seed and split give the same arrays in any process.

    seed: any integer from 0 up. split: "training", "validation" or "generalisation". simulate: drape by
    physics, which takes some 20 s of a core in place of one; the same person in the same clothes, which fold.
    cache: a folder that keeps the simulated garments.
    Raises ValueError for any other split or a negative seed.
    """
    rng = chance(seed, split)
    shape = Shape.draw(rng)
    pose, name = poses.draw(shape.skeleton, rng), f"{split}-{seed:06d}"
    pose.on_heels(outfits.heel(rng, shape.woman))
    return shape.dressed(pose, rng, split, name, simulate=simulate, cache=cache)


def chance(seed: int, split: str, *more: int) -> np.random.Generator:
    """The generator of a figure's random choices; `more` tells kinds of figures apart."""
    if split not in SPLITS:
        raise ValueError(f"split: expected one of {', '.join(SPLITS)}, got {split!r}")
    if seed < 0:
        raise ValueError(f"seed: expected an integer from 0 up, got {seed}")
    return np.random.default_rng([zlib.crc32(split.encode()), seed, *more])


@dataclass(frozen=True)
class Shape:
    """Somebody, neither posed nor dressed. rest: (19158, 3) vertices in metres."""

    base: Mannequin
    rest: np.ndarray
    skeleton: Skeleton
    woman: bool

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Shape":
        base = mannequin()
        gender = rng.choice([rng.uniform(0, 0.2), rng.uniform(0.8, 1)])
        rest, heads = base.shape(
            dict(
                gender=gender,
                age=rng.uniform(0.55, 0.95),
                muscle=rng.uniform(0.25, 0.8),
                weight=np.clip(rng.normal(0.5, 0.17), 0.1, 0.98),
                height=rng.uniform(0.3, 0.75),
                proportions=rng.uniform(0.3, 0.9),
            ),
            Face.draw(rng),
        )
        return cls(base, rest, Skeleton(heads, base.parents, base.names), gender > 0.5)

    def dressed(
        self,
        pose: Posing,
        rng: np.random.Generator,
        split: str,
        name: str,
        *,
        simulate: bool = False,
        cache: Path | None = None,
    ) -> Figure:
        """The figure in this pose, in clothes that are drawn for it. simulate, cache: as of `body`."""
        person = self.posed(pose)
        wardrobe = Wardrobe(person, rng, Simulator(person, name, cache) if simulate else None)
        outfits.dress(wardrobe, rng, split, self.woman)
        parts = [_skin(person, wardrobe.covered, rng), _eyes(person, rng), *wardrobe.parts]
        return _assemble(parts, person, name)

    def posed(self, pose: Posing) -> Person:
        """Undressed in this pose, arms and hands moved out of the trunk, or into pockets."""
        still = Person(self.base, self.skeleton, self.rest, {})
        trunk = still.membership(self.base.tights.weights)[:, 0] > 0.75
        pose.clear_of(still.tights_rest[trunk], still.tights_normals[trunk], ease=0.012)
        for side in pose.pocketed:
            pocketing.slip(pose, side, Person(self.base, self.skeleton, self.rest, pose.rotations))
        return Person(
            self.base,
            self.skeleton,
            self.rest,
            pose.rotations,
            pose.held,
            pose.seated,
            tuple(pose.pocketed),
            pose.heel,
        )


# Skin ------------------------------------------------------------------------------------------------------


def _skin(person: Person, covered: np.ndarray, rng: np.random.Generator) -> Part:
    """The body where no garment hides it, with the colours of a face."""
    surface = person.base.body
    rest = surface.rows @ person.rest
    hidden = covered[person.base.tights_under_body]
    for side in person.pocketed:
        hidden |= pocketing.inside(person, side) > IN_POCKET
    faces, rows = compact(surface.faces[~hidden[surface.faces].all(axis=1)], surface.rows)
    rest, weights = rows @ person.rest, rows @ person.base.weights
    # From deep brown to pale, about evenly in perceived lightness.
    depth = rng.random() ** 0.75
    tone = np.array([0.06, 0.032, 0.02]) ** (1 - depth) * np.array([0.62, 0.42, 0.32]) ** depth
    tone = tone * rng.uniform(0.92, 1.08, 3)
    mouth, left, right = _face(person)
    brows, noise = rng.uniform(0.2, 0.85), Noise(rng)

    def pattern(u: np.ndarray, v: np.ndarray, p: np.ndarray) -> np.ndarray:
        uneven = 0.9 + 0.12 * noise.octaves(p, 0.03) + 0.08 * noise(p, 0.004)
        colour = tone * uneven[:, None]
        ruddy = 0.25 * noise.octaves(p + 1, 0.06)
        colour = colour * (1 + ruddy[:, None] * np.array([0.15, -0.12, -0.15]))
        lip = np.clip(1.6 - np.hypot((p[:, 0] - mouth[0]) / 0.026, (p[:, 1] - mouth[1]) / 0.009) * 1.2, 0, 1)
        lip = lip * (p[:, 2] > mouth[2])
        colour = colour * (1 + lip[:, None] * np.array([-0.05, -0.35, -0.25]))
        for eye in (left, right):
            side = np.sign(eye[0])
            x, y = (p[:, 0] - eye[0]) * side, p[:, 1] - eye[1] - 0.024
            brow = np.clip(1.5 - np.hypot(x / 0.022, (y + 6 * x * x) / 0.0045), 0, 1) * (p[:, 2] > eye[2])
            lash = np.clip(1.4 - np.hypot(x / 0.017, (y + 0.017) / 0.006), 0, 1) * (p[:, 2] > eye[2])
            colour = colour * (
                1 - (brows * brow * (0.6 + 0.4 * noise(p, 0.003)) + 0.3 * lash * 0.5).clip(0, 0.95)[:, None]
            )
        return colour

    shown = _face_and_hands(person, rest, weights)
    return Part(person.posed(weights, rest), faces, rest, np.zeros(len(rest), int), Fabric(pattern), shown)


def _face_and_hands(person: Person, rest: np.ndarray, weights: csr_matrix) -> np.ndarray:
    """What each vertex (V,) of the skin belongs to, as an index into `records.REGIONS`: the head before the
    ears, from the chin up; the hands from the wrists on."""
    names = person.base.names
    head = weights @ np.array([name == "head" or name.startswith("eye.") for name in names], float)
    hand = weights @ np.array([name.startswith(("finger", "metacarpal", "wrist")) for name in names], float)
    _, left, right = _face(person)
    ears = (left[2] + right[2]) / 2 - 0.055  # metres behind the eyes
    face = (head > 0.5) & (rest[:, 2] > ears)
    return np.where(
        face, records.REGIONS.index("face"), np.where(hand > 0.5, records.REGIONS.index("hands"), 0)
    )


def _face(person: Person) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the mouth and the eyes are at rest, by MakeHuman's teeth and eyeballs."""
    teeth = person.rest[14992:15128]
    left, right = person.rest[14598:14670].mean(axis=0), person.rest[14670:14742].mean(axis=0)
    return np.array([0, teeth[:, 1].mean(), teeth[:, 2].mean()]), left, right


def _eyes(person: Person, rng: np.random.Generator) -> Part:
    surface = person.base.eyes
    rest = surface.rows @ person.rest
    _, left, right = _face(person)
    iris = [np.array([0.03, 0.018, 0.012]), np.array([0.06, 0.1, 0.14]), np.array([0.06, 0.08, 0.04])][
        rng.choice(3, p=[0.7, 0.18, 0.12])
    ]

    def pattern(u: np.ndarray, v: np.ndarray, p: np.ndarray) -> np.ndarray:
        centre = np.where(p[:, :1] > 0, left, right)
        off = np.hypot(p[:, 0] - centre[:, 0], p[:, 1] - centre[:, 1])
        white = np.array([0.55, 0.5, 0.47])
        return np.where((off < 0.0028)[:, None], 0.02, np.where((off < 0.0062)[:, None], iris, white))

    return Part(
        person.posed(surface.weights, rest),
        surface.faces,
        rest,
        np.zeros(len(rest), int),
        Fabric(pattern),
        records.REGIONS.index("face"),
    )


# Assembly --------------------------------------------------------------------------------------------------


def _assemble(parts: list[Part], person: Person, name: str) -> Figure:
    for part in parts:
        part.faces, rows = compact(part.faces, identity(len(part.vertices), format="csr"))
        kept = rows.indices
        part.vertices, part.rest, part.region = part.vertices[kept], part.rest[kept], part.region[kept]
        part.shown = np.broadcast_to(part.shown, rows.shape[1])[kept]
    first = np.cumsum([0] + [len(part.vertices) for part in parts])
    vertices = np.concatenate([part.vertices for part in parts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, first[:-1], strict=True)])
    rest = np.concatenate([part.rest for part in parts])
    region = np.concatenate([part.region for part in parts])[faces[:, 0]]
    shown = np.concatenate([part.shown for part in parts])[faces[:, 0]].astype(np.uint8)
    owner = np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts])
    normals = np.concatenate([vertex_normals(part.vertices, part.faces) for part in parts])
    pelvis = person.transforms[0, :, :3] @ person.skeleton.heads[0] + person.transforms[0, :, 3]
    vertices = vertices - [pelvis[0], vertices[:, 1].min(), pelvis[2]]
    fabrics = [part.fabric for part in parts]
    frames = {k: _frame(person.polyline(k)) for k in range(1, len(REGIONS))}
    middle = person.skeleton.head("spine03")

    def albedo(face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        points = interpolate(rest, faces[face], barycentric)
        u, v = np.arctan2(points[:, 0], points[:, 2] - middle[2]) * 0.15, points[:, 1].copy()
        here = region[face]
        for k, (across, radius) in frames.items():
            mine = np.flatnonzero(here == k)
            _, axis, metres = person.limb_coordinates(k, points[mine])
            local = (points[mine] - axis) @ across.T
            u[mine], v[mine] = np.arctan2(local[:, 0], local[:, 1]) * radius, metres
        colour = np.empty((len(face), 3), np.float32)
        part = owner[face]
        for k in np.unique(part):
            mine = part == k
            colour[mine] = fabrics[k](u[mine], v[mine], points[mine])
        return colour

    return Figure(
        vertices.astype(np.float32),
        faces.astype(np.int32),
        normals.astype(np.float32),
        albedo,
        name,
        regions=shown,
    )


def _frame(joints: np.ndarray) -> tuple[np.ndarray, float]:
    """Two axes (2, 3) across a limb with joints (3, 3), and its mean radius, for garment coordinates."""
    along = joints[2] - joints[0]
    length = float(np.linalg.norm(along))
    side = unit(np.cross([0, 0, 1.0], along))
    return np.stack([side, np.cross(along / length, side)]), 0.11 * length
