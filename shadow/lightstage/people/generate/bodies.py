"""Random clothed, posed people: `body(seed, split)`.

The three splits share no person, because the name of the split is hashed into the seed. Some cuts and
patterns are reserved too: validation adds floral prints, generalisation adds herringbone and tie-dye.
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix, identity

from shadow.data import records
from shadow.lightstage.figure import (
    Figure,
    NormalMap,
    bilinear,
    flat_normals,
    interpolate,
    joined,
    normalize,
    vertex_normals,
)
from shadow.lightstage.mesh import remove_unused
from shadow.lightstage.normalmaps import tangents
from shadow.lightstage.people.body.anatomy import REGIONS, TEETH, BaseMesh, Person, base_mesh, rest_shape
from shadow.lightstage.people.body.faces import Face
from shadow.lightstage.people.body.skeleton import Pose, Skeleton
from shadow.lightstage.people.cloth import pockets
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart, Noise, replace_cloth
from shadow.lightstage.people.cloth.garments import Wardrobe
from shadow.lightstage.people.cloth.simulation import Simulator
from shadow.lightstage.people.generate import outfits, poses
from shadow.lightstage.people.makehuman import Look

LOOK = 3  # distinguishes the random choices among MakeHuman's assets
IN_POCKET = 0.006  # metres inside a pocket beyond which a hand is hidden
SPLITS = ("training", "validation", "generalisation")


def body(
    seed: int, split: str, *, simulate: bool = False, cache: Path | None = None, assets: Path | None = None
) -> Figure:
    """Generate a clothed person in a pose. The same seed and split give the same arrays in any process.

    The split is "training", "validation" or "generalisation". `simulate`: whether to simulate the cloth,
    which takes about 20 s of a core instead of one. The person and the clothes are the same, but the clothes
    fold. `cache`: folder that stores simulated garments, or None. `assets`: folder of MakeHuman's assets,
    from which the person gets a skin, brows and lashes, and often hair or a suit; None: all is procedural.
    See `makehuman`. Raises ValueError for another split, or a negative seed.
    """
    rng = random_generator(seed, split)
    shape = Shape.draw(rng)
    pose, name = poses.draw(shape.skeleton, rng), f"{split}-{seed:06d}"
    pose.raise_heels(outfits.heel(rng, shape.woman))
    look = None
    if assets is not None:
        look = Look.draw(assets, random_generator(seed, split, LOOK), split, shape.woman, pose.heel)
    return shape.dress(pose, rng, split, name, simulate=simulate, cache=cache, look=look)


def random_generator(seed: int, split: str, *more: int) -> np.random.Generator:
    """Return the generator of a figure's random choices; `more` distinguishes kinds of figures."""
    if split not in SPLITS:
        raise ValueError(f"split: expected one of {', '.join(SPLITS)}, got {split!r}")
    if seed < 0:
        raise ValueError(f"seed: expected an integer >= 0, got {seed}")
    return np.random.default_rng([zlib.crc32(split.encode()), seed, *more])


@dataclass(frozen=True)
class Shape:
    """A person's body at rest, neither posed nor dressed. rest: (19158, 3) vertices in metres."""

    base: BaseMesh
    rest: np.ndarray
    skeleton: Skeleton
    woman: bool

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Shape":
        """Draw a random adult."""
        base = base_mesh()
        gender = rng.choice([rng.uniform(0, 0.2), rng.uniform(0.8, 1)])
        rest, heads = rest_shape(
            base.model,
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

    def dress(
        self,
        pose: Pose,
        rng: np.random.Generator,
        split: str,
        name: str,
        *,
        simulate: bool = False,
        cache: Path | None = None,
        look: Look | None = None,
    ) -> Figure:
        """Return the figure in a pose and in clothes that are drawn for it. simulate, cache: see `body`.

        `look` replaces the skin, and what it has of hair, clothes and shoes.
        """
        person = self.posed(pose)
        wardrobe = Wardrobe(person, rng, Simulator(person, name, cache) if simulate else None)
        outfits.dress(wardrobe, rng, split, self.woman, look)
        face = [] if look is None else look.face(person)
        parts = [skin_part(person, wardrobe, rng, look), _eyes(person, rng), *face, *wardrobe.parts]
        return assemble(parts, person, name, split)

    def posed(self, pose: Pose) -> Person:
        """Return the undressed person in a pose, with arms moved out of the trunk, and hands into pockets."""
        still = Person(self.base, self.skeleton, self.rest, {})
        trunk = still.region_weights(self.base.tights.weights)[:, 0] > 0.75
        pose.keep_arms_off(still.tights_rest[trunk], still.tights_normals[trunk], ease=0.012)
        for side in pose.pocketed:
            pockets.put_in(pose, side, Person(self.base, self.skeleton, self.rest, pose.rotations))
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


def skin_part(
    person: Person, wardrobe: Wardrobe, rng: np.random.Generator, look: Look | None = None
) -> MeshPart:
    """Return the skin that no garment hides, of a look or painted."""
    surface = person.base.body
    rest = surface.rows @ person.rest
    hidden = wardrobe.covered[person.base.tights_under_body] | (surface.rows @ wardrobe.hidden > 0.999)
    for side in person.pocketed:
        hidden |= pockets.inside(person, side) > IN_POCKET
    shown = ~hidden[surface.faces].all(axis=1)
    faces, rows = remove_unused(surface.faces[shown], surface.rows)
    rest, weights = rows @ person.rest, rows @ person.base.weights
    fabric, uv = (_painted(person, rng), None) if look is None else (look.skin, surface.uv[shown])
    label = _face_and_hands(person, rest, weights)
    return MeshPart(person.posed(weights, rest), faces, rest, fabric, label=label, uv=uv)


def _painted(person: Person, rng: np.random.Generator) -> Fabric:
    """Return a skin with the colours of a face."""
    # From deep brown to pale, about uniformly in perceived lightness.
    depth = rng.random() ** 0.75
    tone = np.array([0.06, 0.032, 0.02]) ** (1 - depth) * np.array([0.62, 0.42, 0.32]) ** depth
    tone = tone * rng.uniform(0.92, 1.08, 3)
    teeth, (left, right) = person.rest[TEETH], person.eyes
    mouth = np.array([0, teeth[:, 1].mean(), teeth[:, 2].mean()])
    brows, noise = rng.uniform(0.2, 0.85), Noise(rng)

    def texture(u: np.ndarray, v: np.ndarray, p: np.ndarray) -> np.ndarray:
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

    return Fabric(texture)


def _face_and_hands(person: Person, rest: np.ndarray, weights: csr_matrix) -> np.ndarray:
    """Return the index into `records.REGIONS` of each vertex (V,) of the skin.

    The face is the head in front of the ears, from the chin up. Hands begin at the wrists.
    """
    names = person.base.names
    head = weights @ np.array([name == "head" or name.startswith("eye.") for name in names], float)
    hand = weights @ np.array([name.startswith(("finger", "metacarpal", "wrist")) for name in names], float)
    left, right = person.eyes
    ears = (left[2] + right[2]) / 2 - 0.055  # metres behind the eyes
    face = (head > 0.5) & (rest[:, 2] > ears)
    return np.where(
        face, records.REGIONS.index("face"), np.where(hand > 0.5, records.REGIONS.index("hands"), 0)
    )


def _eyes(person: Person, rng: np.random.Generator) -> MeshPart:
    surface = person.base.eyes
    rest = surface.rows @ person.rest
    left, right = person.eyes
    iris = [np.array([0.03, 0.018, 0.012]), np.array([0.06, 0.1, 0.14]), np.array([0.06, 0.08, 0.04])][
        rng.choice(3, p=[0.7, 0.18, 0.12])
    ]

    def texture(u: np.ndarray, v: np.ndarray, p: np.ndarray) -> np.ndarray:
        centre = np.where(p[:, :1] > 0, left, right)
        off = np.hypot(p[:, 0] - centre[:, 0], p[:, 1] - centre[:, 1])
        white = np.array([0.55, 0.5, 0.47])
        return np.where((off < 0.0028)[:, None], 0.02, np.where((off < 0.0062)[:, None], iris, white))

    posed, label = person.posed(surface.weights, rest), records.REGIONS.index("face")
    return MeshPart(posed, surface.faces, rest, Fabric(texture), label=label)


# Assembly --------------------------------------------------------------------------------------------------


def assemble(parts: list[MeshPart], person: Person, name: str, split: str) -> Figure:
    """Join the parts of a dressed person into a figure on the floor."""
    for part in parts:
        part.faces, rows = remove_unused(part.faces, identity(len(part.vertices), format="csr"))
        used = rows.indices
        part.vertices, part.rest = part.vertices[used], part.rest[used]
        part.region = np.broadcast_to(part.region, rows.shape[1])[used]
        part.label = np.broadcast_to(part.label, rows.shape[1])[used]
        if part.normals is not None:
            part.normals = part.normals[used]
    first = np.cumsum([0] + [len(part.vertices) for part in parts])
    vertices = np.concatenate([part.vertices for part in parts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, first[:-1], strict=True)])
    rest = np.concatenate([part.rest for part in parts])
    region = np.concatenate([part.region for part in parts])[faces[:, 0]]
    label = np.concatenate([part.label for part in parts])[faces[:, 0]].astype(np.uint8)
    face_counts = [len(part.faces) for part in parts]
    owner, first_face = np.repeat(np.arange(len(parts)), face_counts), np.cumsum([0, *face_counts])
    normals = np.concatenate(
        [vertex_normals(p.vertices, p.faces) if p.normals is None else p.normals for p in parts]
    )
    pelvis = person.transforms[0, :, :3] @ person.skeleton.heads[0] + person.transforms[0, :, 3]
    vertices = vertices - [pelvis[0], vertices[:, 1].min(), pelvis[2]]
    fabrics = [part.fabric for part in parts]
    frames = {k: _frame(person.limb_joints(k)) for k in range(1, len(REGIONS))}
    middle = person.skeleton.head("spine03")

    def albedo(worn: Sequence[Fabric], face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
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
            if (uv := parts[k].uv) is not None:
                corners = uv[face[mine] - first_face[k]]
                u[mine], v[mine] = np.einsum("nk,nkc->cn", barycentric[mine], corners)
            colour[mine] = worn[k](u[mine], v[mine], points[mine])
        return colour

    normal_map, tangent = joined_normal_map(parts)
    return Figure(
        vertices.astype(np.float32),
        faces.astype(np.int32),
        normals.astype(np.float32),
        partial(albedo, fabrics),
        name,
        normal_map=normal_map,
        tangents=tangent,
        regions=label,
        redraw_fabrics=lambda rng: partial(albedo, replace_cloth(fabrics, rng, split)),
    )


def joined_normal_map(parts: list[MeshPart]) -> tuple[NormalMap | None, np.ndarray | None]:
    """Return the normal map of all parts, and the tangents (F, 3, 4); None if no part has one."""
    if all(part.normal_map is None for part in parts):
        return None, None
    tangent = [np.zeros((*part.faces.shape, 4), np.float32) for part in parts]
    maps: list[NormalMap] = []
    for k, part in enumerate(parts):
        if part.normal_map is None or part.uv is None or part.normals is None:
            maps.append(flat_normals)
            continue
        corners, uv = np.arange(part.faces.size).reshape(-1, 3), part.uv
        tangent[k] = tangents(
            part.vertices[part.faces.ravel()], corners, part.normals[part.faces.ravel()], uv.reshape(-1, 2)
        )
        maps.append(partial(_mapped, part.normal_map, uv))
    return joined(maps, [len(part.faces) for part in parts]), np.concatenate(tangent)


def _mapped(texels: np.ndarray, uv: np.ndarray, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Sample texels (H, W, 3) of a normal map at points of faces with texture coordinates (F, 3, 2)."""
    return bilinear(texels, np.einsum("nk,nkc->nc", barycentric, uv[face]))


def _frame(joints: np.ndarray) -> tuple[np.ndarray, float]:
    """Return two axes (2, 3) across a limb with joints (3, 3), and its mean radius in metres."""
    along = joints[2] - joints[0]
    length = float(np.linalg.norm(along))
    side = normalize(np.cross([0, 0, 1.0], along))
    return np.stack([side, np.cross(along / length, side)]), 0.11 * length
