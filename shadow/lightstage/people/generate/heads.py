"""People with heads of ICT-FaceKit, on bodies or alone as busts: `head(seed, split, folder)`.

Half of the heads are painted so that the colours say nothing about the shape: in one plain colour, or with
random blots and stripes. The others have skin, brows and lips, and some of them a beard or make-up. Who has
which head depends on seed and split alone, so the splits share no head.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from shadow.data import records
from shadow.lightstage.figure import Figure, normalize
from shadow.lightstage.mesh import boundary_chains
from shadow.lightstage.people.accessories.hair import Skull
from shadow.lightstage.people.body import facekit
from shadow.lightstage.people.body.anatomy import Person, skin
from shadow.lightstage.people.body.facekit import EYES, METRES, MOUTH, SKIN, Head
from shadow.lightstage.people.body.skeleton import Pose
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart, Noise, colour, hair_colour
from shadow.lightstage.people.cloth.garments import Wardrobe
from shadow.lightstage.people.generate import bodies, outfits, poses
from shadow.lightstage.people.makehuman import Look

HEADS, IDENTITY = 4, 5  # distinguish these random choices from those of bodies
ALONE = 0.5  # share of busts
PAINTED = 0.5  # share of heads whose colours do not follow the face
BUST_HEIGHT = 1.25  # metres of a bust's lower edge above the floor, so that cameras are as for people
OVERLAP = 0.6  # centimetres of the body's neck inside that of the head
BLENDED = 5.0  # centimetres above the cut in which the head's neck becomes as wide as the body's
LOOSE = 1.02  # factor by which hair and hats are further from the middle of the head
AROUND = 0.3  # metres from the middle of the head within which hair and hats follow its shape


def head(seed: int, split: str, folder: Path, assets: Path | None = None) -> Figure:
    """Generate a person with a head of ICT-FaceKit. The same arguments give the same arrays in any process.

    `folder` has `ict.npz`, see `facekit`. `assets`: folder of MakeHuman's assets, of which heads get hair;
    None: busts are bald, and bodies have procedural hair and hats. `seed`, `split` and the errors are those
    of `bodies.body`.
    """
    rng = bodies.random_generator(seed, split, HEADS)
    who = facekit.load(folder).head(rng, bodies.random_generator(seed, split, IDENTITY))
    shape, alone = bodies.Shape.draw(rng), rng.random() < ALONE
    pose = Pose(shape.skeleton, rng) if alone else poses.draw(shape.skeleton, rng)
    look = None
    if assets is not None:
        look = Look.draw(assets, rng, split, shape.woman, pose.heel)
        look = replace(look, suit=None, shoes=None)
    person = shape.posed(pose)
    fitted = FittedHead(person, who)
    paint = Paint.draw(rng)
    wardrobe = Wardrobe(person, rng)
    if not alone:
        outfits.dress(wardrobe, rng, split, shape.woman, look)
    elif look is not None and look.hair is not None:
        look.wear(wardrobe, look.hair)
    parts = fitted.parts(paint, bust=alone) + [fitted.refitted(part) for part in wardrobe.parts]
    name = f"{split}-{seed:06d}"
    if not alone:
        body = bodies.skin_part(person, wardrobe, rng)
        parts.append(replace(fitted.headless(body), fabric=paint.body))
        return bodies.assemble(parts, person, name, split)
    figure = bodies.assemble(parts, person, name, split)
    return replace(figure, vertices=figure.vertices + np.array([0, BUST_HEIGHT, 0], np.float32))


@dataclass(frozen=True)
class FittedHead:
    """A head on a person: as large as their own from eyes to crown, with the eyes in their place."""

    person: Person
    head: Head

    @cached_property
    def skull(self) -> Skull:
        return Skull(self.person)

    @cached_property
    def _body(self) -> tuple[np.ndarray, csr_matrix]:
        """Return the points (V, 3) at rest and the skinning weights of the person's skin."""
        surface = self.person.base.body
        return surface.rows @ self.person.rest, surface.weights

    @cached_property
    def scale(self) -> float:
        """Metres for a centimetre of the head."""
        points, weights = self._body
        of_head = self.skull.neck_and_head(weights) > 0.5
        own = points[of_head][:, 1].max() - self.skull.eyes[1]
        return float(own / (self.head.crown - self.head.eyes[1]))

    def placed(self, points: np.ndarray) -> np.ndarray:
        """Return points (N, 3) of the head, in centimetres, on the person at rest, in metres."""
        return (points - self.head.eyes) * self.scale + self.skull.eyes

    def centimetres(self, points: np.ndarray) -> np.ndarray:
        """Return points (N, 3) on the person at rest, in metres, in the head's own frame."""
        return (points - self.skull.eyes) / self.scale + self.head.eyes

    def parts(self, paint: "Paint", bust: bool) -> list[MeshPart]:
        """Return skin, mouth and eyes in the pose. A bust keeps its shoulders, and is closed below."""
        below = None if bust else facekit.BELOW
        skin_mesh = self.head.mesh(SKIN, below)
        label = np.where(
            (skin_mesh.mean[:, 2] > 2.5) & (skin_mesh.mean[:, 1] > -8.5), records.REGIONS.index("face"), 0
        )
        parts = [self._part(skin_mesh, paint.skin, label, not bust)]
        if bust:
            parts.append(_lid(parts[0], paint.body))
        face = np.full(1, records.REGIONS.index("face"))
        parts.append(self._part(self.head.mesh(MOUTH), paint.mouth, face, False))
        return [*parts, self._part(self.head.mesh(EYES), paint.eyes(self.head.model), face, False)]

    def _part(self, mesh: facekit.Mesh, fabric: Fabric, label: np.ndarray, joined: bool) -> MeshPart:
        rest, points = mesh.rest, mesh.points
        if joined:
            shift = self._neck(rest) - rest
            rest, points = rest + shift, points + shift
        rest, points = self.placed(rest), self.placed(points)
        own, weights = self._body
        distance, near = cKDTree(own).query(rest, k=4)
        share = 1 / np.maximum(distance, 1e-4)
        rows = np.repeat(np.arange(len(rest)), 4)
        share = csr_matrix(
            ((share / share.sum(axis=1, keepdims=True)).ravel(), (rows, near.ravel())), (len(rest), len(own))
        )
        followed = (share @ weights).tocsr()
        turned = self.person.transforms.copy()
        turned[:, :, 3] = 0
        return MeshPart(
            self.person.posed(followed, points),
            mesh.faces,
            mesh.mean * METRES,
            fabric,
            label=np.broadcast_to(label, len(rest)),
            normals=normalize(skin(followed, turned, mesh.normals)),
        )

    def _neck(self, points: np.ndarray) -> np.ndarray:
        """Return points (N, 3), in centimetres, with a neck as wide as the person's at the cut."""
        own, weights = self._body
        own = self.centimetres(own[self.skull.neck_and_head(weights) > 0.3])
        body, ring = (each[np.abs(self.head.above_neck(each)) < 0.7][:, [0, 2]] for each in (own, points))
        if len(body) < 3 or len(ring) < 3:
            return points
        low, high = ring.min(axis=0), ring.max(axis=0)
        wide = np.ptp(body, axis=0) / np.maximum(high - low, 1e-3)
        wanted = (points[:, [0, 2]] - (low + high) / 2) * wide + (body.min(axis=0) + body.max(axis=0)) / 2
        share = np.clip(1 - self.head.above_neck(points) / BLENDED, 0, 1)[:, None]
        share = share * share * (3 - 2 * share)
        moved = points.copy()
        moved[:, [0, 2]] += share * (wanted - points[:, [0, 2]])
        return moved

    def headless(self, part: MeshPart) -> MeshPart:
        """Return the skin of the person without the head."""
        points = self.centimetres(part.rest)
        near = np.linalg.norm(part.rest[:, [0, 2]] - self.skull.centre[[0, 2]], axis=1) < AROUND / 2
        above = near & (self.head.above_neck(points) > OVERLAP)
        kept = ~above[part.faces].all(axis=1)
        return replace(part, faces=part.faces[kept], uv=None if part.uv is None else part.uv[kept])

    @cached_property
    def _grown(self) -> np.ndarray:
        """How much larger (N,) the head is than the person's own, in the directions of the skull."""
        shown = self.placed(self.head.mesh(("face", "head_neck")).rest)
        offset = shown - self.skull.centre
        _, near = cKDTree(normalize(offset)).query(self.skull.direction, k=10)
        radius = np.linalg.norm(offset, axis=1)[near].max(axis=1)
        ratio = np.clip(radius / self.skull.radius * LOOSE, 0.85, 1.3)
        _, around = cKDTree(self.skull.direction).query(self.skull.direction, k=60)
        for _ in range(2):
            ratio = ratio[around].mean(axis=1)
        return ratio

    def refitted(self, part: MeshPart) -> MeshPart:
        """Return hair, a hat or glasses of the person, moved to the shape of this head."""
        local = part.rest - self.skull.centre
        distance = np.linalg.norm(local, axis=1)
        chin = self.placed(self.head.chin[None])[0, 1]
        share = np.clip((part.rest[:, 1] - chin + 0.02) / 0.06, 0, 1) * (distance < AROUND)
        if not share.any():
            return part
        _, near = cKDTree(self.skull.direction).query(normalize(local), k=4)
        moved = local * ((self._grown[near].mean(axis=1) - 1) * share)[:, None]
        turned = moved @ self.person.bone("head")[:, :3].T
        return replace(part, vertices=part.vertices + turned)


def _lid(part: MeshPart, fabric: Fabric) -> MeshPart:
    """Return the surface that closes a bust below."""
    chains = [chain[:-1] for chain in boundary_chains(part.faces)]
    ring = min(chains, key=lambda chain: part.vertices[chain, 1].mean())
    points = np.concatenate([part.vertices[ring], part.vertices[ring].mean(axis=0, keepdims=True)])
    rest = np.concatenate([part.rest[ring], part.rest[ring].mean(axis=0, keepdims=True)])
    count = len(ring)
    faces = np.stack([np.arange(count), np.roll(np.arange(count), -1), np.full(count, count)], axis=1)
    normal = np.cross(points[1] - points[count], points[0] - points[count])
    if normal[1] > 0:
        faces = faces[:, ::-1]
    return MeshPart(points, faces, rest, fabric)


# Colours ---------------------------------------------------------------------------------------------------

Texture = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
# Places on the mean head, in metres: x to the figure's left, y up, z to the front.
EYE, BROW, MOUTH_PLACE, CHEEK = (0.032, 0.036), (0.033, 0.053), (0.0, -0.034), (0.045, 0.002)


@dataclass(frozen=True)
class Paint:
    """The colours of a head and of the skin below it."""

    skin: Fabric
    body: Fabric
    mouth: Fabric
    iris: np.ndarray

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Paint":
        """Draw skin with its features, or colours that do not follow the face."""
        depth = rng.random() ** 0.75
        tone = np.array([0.06, 0.032, 0.02]) ** (1 - depth) * np.array([0.62, 0.42, 0.32]) ** depth
        tone = tone * rng.uniform(0.92, 1.08, 3)
        iris = [np.array([0.03, 0.018, 0.012]), np.array([0.06, 0.1, 0.14]), np.array([0.06, 0.08, 0.04])]
        chosen = iris[rng.choice(3, p=[0.7, 0.18, 0.12])]
        mouth = Fabric(lambda u, v, p: np.where(p[:, 1:2] > -0.5, np.array([0.35, 0.1, 0.09]), 0.0))
        if rng.random() < PAINTED:
            if rng.random() < 0.5:
                plain = Fabric.plain(tone if rng.random() < 0.5 else colour(rng))
                return cls(plain, plain, mouth, chosen)
            painted = Fabric(_blots(rng))
            return cls(painted, painted, mouth, chosen)
        below = Fabric(_skin(tone, Noise(rng)))
        return cls(Fabric(_features(tone, rng)), below, mouth, chosen)

    def eyes(self, model: facekit.FaceKit) -> Fabric:
        """Return the eyeballs, which look straight ahead on the mean head."""
        centres = [
            model.neutral[np.unique(model.polygons[eye][..., 0])].mean(axis=0) * METRES for eye in EYES
        ]

        def texture(u: np.ndarray, v: np.ndarray, p: np.ndarray) -> np.ndarray:
            centre = np.where(p[:, :1] > 0, *(each for each in sorted(centres, key=lambda c: -c[0])))
            off = np.hypot(p[:, 0] - centre[:, 0], p[:, 1] - centre[:, 1])
            front = p[:, 2] > centre[:, 2]
            white = np.array([0.55, 0.5, 0.47])
            coloured = np.where(
                (off < 0.0026)[:, None], 0.02, np.where((off < 0.0062)[:, None], self.iris, white)
            )
            return np.where(front[:, None], coloured, white)

        return Fabric(texture)


def _skin(tone: np.ndarray, noise: Noise) -> Texture:
    def texture(u: np.ndarray, v: np.ndarray, p: np.ndarray) -> np.ndarray:
        uneven = 0.9 + 0.12 * noise.octaves(p, 0.03) + 0.08 * noise(p, 0.004)
        ruddy = 0.25 * noise.octaves(p + 1, 0.06)
        return tone * uneven[:, None] * (1 + ruddy[:, None] * np.array([0.15, -0.12, -0.15]))

    return texture


def _blots(rng: np.random.Generator) -> Texture:
    """Return blots and stripes of random colours, with sharp or soft edges."""
    noise, size = Noise(rng), np.exp(rng.uniform(np.log(0.006), np.log(0.08)))
    colours = np.stack([colour(rng) for _ in range(rng.integers(2, 5))])
    axis, period = normalize(rng.normal(size=3)), rng.uniform(0.01, 0.08)
    striped, sharp = rng.random() < 0.4, np.exp(rng.uniform(0, 3))

    def texture(u: np.ndarray, v: np.ndarray, p: np.ndarray) -> np.ndarray:
        values = np.stack([noise.octaves(p + 3 * k, size) for k in range(len(colours))], axis=1)
        if striped:
            values[:, 0] += 0.4 * np.sin(p @ axis * 2 * np.pi / period)
        shares = np.exp(20 * sharp * (values - values.max(axis=1, keepdims=True)))
        return shares / shares.sum(axis=1, keepdims=True) @ colours

    return texture


def _features(tone: np.ndarray, rng: np.random.Generator) -> Texture:
    """Return skin with brows and lips, and sometimes a beard or make-up."""
    base, noise, hair = _skin(tone, Noise(rng)), Noise(rng), np.minimum(hair_colour(rng), 0.15)
    brows = rng.uniform(0.3, 0.95)
    beard = rng.uniform(0.2, 0.9) if rng.random() < 0.3 else 0.0
    made_up = rng.random() < 0.3
    lips = rng.choice([0.4, 0.8]) * np.array([0.6, 0.06, 0.09]) if made_up else tone * [0.9, 0.55, 0.6]
    shadow = colour(rng) if made_up and rng.random() < 0.6 else None
    blush = rng.uniform(0.1, 0.5) if made_up else rng.uniform(0, 0.15)

    def blend(under: np.ndarray, over: np.ndarray, share: np.ndarray) -> np.ndarray:
        return under + (over - under) * share[:, None]

    def texture(u: np.ndarray, v: np.ndarray, p: np.ndarray) -> np.ndarray:
        x, y, front = np.abs(p[:, 0]), p[:, 1], p[:, 2] > 0.04
        colours = base(u, v, p)
        cheek = np.clip(1.3 - np.hypot((x - CHEEK[0]) / 0.028, (y - CHEEK[1]) / 0.022), 0, 1) * front
        colours = blend(colours, tone * [1.1, 0.6, 0.6], blush * cheek)
        lip = np.clip(2 - 1.6 * np.hypot(x / 0.029, (y - MOUTH_PLACE[1]) / 0.0105), 0, 1) * (p[:, 2] > 0.085)
        jaw = np.clip((-0.012 - y) / 0.012, 0, 1) * np.clip((p[:, 2] - 0.01) / 0.03, 0, 1)
        jaw = jaw * np.clip((y + 0.105) / 0.02, 0, 1) * (1 - np.clip(lip * 2, 0, 1))
        colours = blend(colours, hair, beard * jaw * (0.55 + 0.45 * noise(p, 0.002)))
        colours = blend(colours, lips, 0.8 * lip)
        if shadow is not None:
            lid = np.clip(1.4 - np.hypot((x - EYE[0]) / 0.019, (y - EYE[1] - 0.006) / 0.01), 0, 1) * front
            colours = blend(colours, shadow, 0.6 * lid)
        brow = np.clip(
            1.6 - np.hypot((x - BROW[0]) / 0.02, (y - BROW[1] + 12 * (x - BROW[0]) ** 2) / 0.0045), 0, 1
        )
        return blend(colours, hair, brows * brow * front * (0.6 + 0.4 * noise(p, 0.0015)))

    return texture
