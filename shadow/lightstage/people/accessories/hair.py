"""Hair, beards and hats: shells over the skull, hanging hair, and brims."""

import numpy as np
import trimesh
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from shadow.data.records import REGIONS
from shadow.lightstage.figure import normalize, outwards, vertex_normals
from shadow.lightstage.mesh import add_lining, boundary_chains, clip, loft, longest_run
from shadow.lightstage.people.body.anatomy import TEETH, Person
from shadow.lightstage.people.cloth.draping import drape, fold_noise
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart
from shadow.lightstage.people.cloth.garments import Wardrobe

# The hairline: metres above the eyes, at angles in degrees around the head from the face to the nape.
HAIRLINE_ANGLES = np.array([0, 35, 55, 68, 82, 92, 112, 130, 180])
HAIRLINE_HEIGHTS = np.array([0.066, 0.06, 0.045, 0.012, -0.03, 0.002, 0.004, -0.05, -0.085])
HAT_HAIR = 0.005  # metres of hair under a hat
SHOULDER_CLEARANCE = 0.012  # metres between a shoulder and hair that ends above it


class Skull:
    """A smooth surface around the head of a person, without ears and face, as a base for hair and hats."""

    def __init__(self, person: Person) -> None:
        self.person = person
        self.head = person.base.names.index("head")
        surface = person.base.body
        points = surface.rows @ person.rest
        of_head = np.asarray(surface.weights[:, self.head].todense()).ravel() > 0.5
        points = points[of_head]
        left_eye, right_eye = person.eyes
        self.eyes = eyes = (left_eye + right_eye) / 2
        cranium = points[points[:, 1] > eyes[1] + 0.035]
        self.half_width = np.abs(cranium[:, 0]).max()
        middle = (cranium[:, 2].min() + cranium[:, 2].max()) / 2
        self.centre = np.array([0.0, eyes[1] + 0.015, middle])
        ear = (np.abs(points[:, 0]) > self.half_width * 0.97) & (points[:, 1] < eyes[1] + 0.035)
        socket = (points[:, 2] < eyes[2] - 0.005) | (points[:, 1] > eyes[1] + 0.03)
        points = points[~ear & socket]
        sphere = trimesh.creation.icosphere(5)
        self.faces, self.direction = np.asarray(sphere.faces), np.asarray(sphere.vertices)
        offset = points - self.centre
        _, near = cKDTree(normalize(offset)).query(self.direction, k=10)
        near = np.linalg.norm(offset, axis=1)[near]
        radius = near.max(axis=1)
        # Average over neighbouring directions, to close the gap of the ears smoothly. Brow and temples have
        # no gap, and hair is close to the skin there.
        _, around = cKDTree(self.direction).query(self.direction, k=24)
        for _ in range(2):
            radius = np.maximum(radius[around].mean(axis=1), radius * 0.97)
        front = np.clip((self.direction[:, 2] - 0.1) / 0.3, 0, 1)
        radius = radius + (near[:, :4].mean(axis=1) - radius) * front
        self.radius = radius
        self.points = self.centre + self.direction * radius[:, None]

    def around(self, points: np.ndarray) -> np.ndarray:
        """Return the angles (N,) of points around the head, in degrees: 0 at the face, 180 at the nape."""
        local = points - self.centre
        return np.degrees(np.abs(np.arctan2(local[:, 0], local[:, 2])))

    def posed(self, points: np.ndarray) -> np.ndarray:
        """Return points (N, 3) at rest, moved with the head to the pose."""
        return self.person.moved("head", points)

    def neck_and_head(self, weights: csr_matrix) -> np.ndarray:
        """Return how much (V,) vertices with skinning weights (V, J) follow neck and head, in [0, 1]."""
        return weights @ np.isin(self.person.base.names, ("neck01", "neck02", "neck03", "head"))

    def closed(self, points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Extend a shell over the skull into the head, so that no gap under its boundary is visible."""
        bands, inner, count = [faces], [points], len(points)
        for chain in boundary_chains(faces):
            ring = chain[:-1]
            ids = np.concatenate([ring, count + np.arange(len(ring))])
            inner.append(self.centre + (points[ring] - self.centre) * 0.7)
            bands.append(ids[loft(np.stack([points[ring], inner[-1]]), closed=True)])
            count += len(ring)
        return np.concatenate(inner), np.concatenate(bands)

    def part(self, points: np.ndarray, faces: np.ndarray, fabric: Fabric) -> MeshPart:
        """Return the part of a mesh at rest that moves with the head."""
        return MeshPart(self.posed(points), faces, points, fabric)


def grow(
    skull: Skull,
    wardrobe: Wardrobe,
    rng: np.random.Generator,
    style: str,
    fabric: Fabric,
    *,
    pressed: bool = False,
) -> None:
    """Put hair on the head.

    style: "buzz", "short", "afro", "bob", "long", "bun", "ponytail" or "curls". pressed: whether it is under
    a hat.
    """
    volume = {
        "buzz": 0.003,
        "short": rng.uniform(0.008, 0.02),
        "afro": rng.uniform(0.03, 0.07),
        "curls": rng.uniform(0.018, 0.035),
        "bun": 0.007,
        "ponytail": 0.007,
    }.get(style, rng.uniform(0.012, 0.022))
    volume = min(volume, HAT_HAIR) if pressed else volume
    points = skull.points
    recede = rng.uniform(-0.008, 0.014)
    line_height = skull.eyes[1] + np.interp(skull.around(points), HAIRLINE_ANGLES, HAIRLINE_HEIGHTS)
    line_height = line_height + recede * (skull.around(points) < 60) + 0.0015 * fold_noise(points, rng, 0.03)
    above = points[:, 1] - line_height
    # No hair grows on the throat.
    nape = np.maximum(-skull.direction[:, 2] - 0.35, skull.direction[:, 1] + 0.55)
    above = np.minimum(above, 0.08 * nape)
    full = np.clip(above / (0.03 if style not in ("afro", "curls") else 0.018), 0, 1)
    full = full * (2 - full)
    up = np.clip(skull.direction[:, 1], 0, 1)
    lift = volume * (0.12 + 0.88 * full * (0.6 + 0.4 * up)) + 0.001
    if style in ("bob", "long"):
        # The sides cover the ears; only the hairline at the face tapers.
        lift = volume * (0.35 + 0.65 * np.clip(above / 0.02, 0, 1)) + 0.0015
        lift += np.where(skull.around(points) > 60, 0.002 if pressed else 0.006, 0)
    strands = points * ([1, 0.2, 1] if style not in ("afro", "curls") else [1, 1, 1])
    size = 0.035 if style in ("afro", "curls") else 0.02
    rough = {"curls": 0.22, "short": rng.uniform(0.1, 0.22), "afro": 0.13}.get(style, 0.06)
    lift = lift * (1 + rough * fold_noise(strands, rng, size) + 0.12 * fold_noise(points, rng, 0.07))
    lift += np.minimum(volume, 0.012) * 0.16 * fold_noise(strands, rng, 0.007)
    if style in ("bob", "long") or (style == "short" and rng.random() < 0.5):
        parting = rng.choice([-0.028, 0, 0.028])
        lift -= 0.45 * volume * np.exp(-(((points[:, 0] - parting) / 0.005) ** 2)) * up
    raised = points + skull.direction * np.maximum(lift, 0.001)[:, None]
    faces, rows = clip(skull.faces, above)
    raised = rows @ raised
    if style in ("bob", "long"):
        _curtain(
            skull,
            wardrobe,
            rng,
            raised,
            faces,
            fabric,
            rng.uniform(0.06, 0.14) if style == "bob" else rng.uniform(0.2, 0.42),
        )
        return
    wardrobe.parts.append(skull.part(*skull.closed(raised, faces), fabric))
    if style == "bun":
        _bun(skull, wardrobe, rng, fabric)
    elif style == "ponytail":
        _tail(skull, wardrobe, rng, fabric)


def _curtain(
    skull: Skull,
    wardrobe: Wardrobe,
    rng: np.random.Generator,
    raised: np.ndarray,
    faces: np.ndarray,
    fabric: Fabric,
    length: float,
) -> None:
    """Extend the hair behind the temples down by `length` metres, and drape it over the shoulders."""
    chain = max(boundary_chains(faces), key=len)
    chain = longest_run(chain, skull.around(raised[chain]) > 72)
    here = raised[chain]
    count = max(4, round(length / 0.009))
    outward = normalize((here - skull.centre) * [1, 0, 1])
    sideways = np.abs(outward[:, :1])
    fall = np.linspace(0, 1, count + 1)[1:]
    # The back has its whole length. The sides end above the shoulders, where they would lie like a cape.
    behind = np.clip((skull.around(here) - 100) / 35, 0, 1)[:, None]
    side_length = min(length, rng.uniform(0.11, 0.17))
    down = side_length + (length - side_length) * behind * behind * (3 - 2 * behind)
    room = _above_shoulders(skull.posed(here + outward * 0.012 * sideways), wardrobe)[:, None]
    room = np.minimum(down, room)  # avoids NaN from infinity times 0, where nothing is below
    down = np.where(behind < 1, room + (down - room) * behind**2, down)
    ragged = 1 + 0.06 * fold_noise(here, rng, 0.03)[:, None]
    stack = [here]
    for f in fall:
        # Ears and cheeks are wider than the skull behind them: hair goes outward first, then down, and
        # gathers at the neck.
        ring = here + outward * (0.012 * min(1, 4 * f) * sideways) - np.array([0, 1.0, 0]) * f * down * ragged
        ring[:, 0] *= 1 - 0.25 * np.clip((f * down[:, 0] - 0.08) / 0.2, 0, 1)
        stack.append(ring)
    rings = np.stack(stack)
    band = loft(rings, closed=False)
    ids = np.concatenate([chain, len(raised) + np.arange(count * len(chain))])
    rest = np.concatenate([raised, rings[1:].reshape(-1, 3)])
    faces = np.concatenate([faces, ids[band]])
    start = skull.posed(rest)
    held = np.concatenate(
        [np.ones(len(raised)), np.repeat(np.clip(0.9 - fall * length / 0.06, 0, 1), len(chain))]
    )
    person = wardrobe.person
    body = person.base.body
    head = skull.neck_and_head(body.weights)
    skin = person.posed(body.weights, body.rows @ person.rest)
    normal = vertex_normals(skin, body.faces)
    layers = [(skin[head > 0.5], normal[head > 0.5])] + [
        (points, normals) for points, normals, *_ in wardrobe.obstacles
    ]
    surface, upward = (np.concatenate(column) for column in zip(*layers, strict=True))
    falling = np.arange(len(raised), len(rest))
    posed = drape(start, faces, rest, [(falling, surface, upward)], held, gap=0.008, bending=0.5, weight=0.8)
    below = 1 - held
    strand = fold_noise(rest * [1, 0.1, 1], rng, 0.012) + 0.6 * fold_noise(rest * [1, 0.1, 1], rng, 0.03)
    posed += vertex_normals(posed, faces) * (0.0022 * strand * (0.3 + 0.7 * below))[:, None]
    vertices, lined, source = add_lining(posed, faces, 0.003, 0.5)
    wardrobe.parts.append(MeshPart(vertices, lined, rest[source], fabric))


def _above_shoulders(points: np.ndarray, wardrobe: Wardrobe) -> np.ndarray:
    """Return how far (N,), in metres, hair can hang from posed points (N, 3) before it meets a shoulder.

    It is infinite where no shoulder is below.
    """
    under = wardrobe.worn[0]
    near = cKDTree(under[:, [0, 2]]).query_ball_point(points[:, [0, 2]], 0.025)
    highest = [max((y for y in under[ids, 1] if y < point[1]), default=-np.inf)
               for point, ids in zip(points, near, strict=True)]  # fmt: skip
    return np.maximum(points[:, 1] - highest - SHOULDER_CLEARANCE, 0.02)


def _bun(skull: Skull, wardrobe: Wardrobe, rng: np.random.Generator, fabric: Fabric) -> None:
    height = rng.uniform(-0.2, 0.9)
    direction = normalize(np.array([0.0, height, -1.0]))
    radius = rng.uniform(0.028, 0.045)
    nearest = np.argmax(skull.direction @ direction)
    ball = trimesh.creation.icosphere(4)
    shape = np.asarray(ball.vertices) * [1, 0.9, 0.85]
    wound = 1 + 0.07 * np.sin(7 * np.arctan2(shape[:, 0], shape[:, 1]) + 9 * shape[:, 2])
    points = skull.points[nearest] + direction * radius * 0.75 + shape * radius * wound[:, None]
    wardrobe.parts.append(skull.part(points, np.asarray(ball.faces), fabric))


def _tail(skull: Skull, wardrobe: Wardrobe, rng: np.random.Generator, fabric: Fabric) -> None:
    direction = normalize(np.array([0.0, rng.uniform(-0.2, 0.8), -1.0]))
    root = skull.points[np.argmax(skull.direction @ direction)]
    length, width = rng.uniform(0.15, 0.35), rng.uniform(0.018, 0.03)
    along = np.linspace(0, 1, 40)
    turn = skull.person.transforms[skull.head, :, :3]
    away = normalize(turn @ (direction * [1, 0.5, 1]))
    # Away from the head first, then down in the world.
    down = np.clip(along * length / 0.1, 0, 1)[:, None]
    step = normalize(away * (1 - down) + np.array([0, -1.0, 0]) * down + away * 0.12) * length / 39
    path = skull.posed(root[None])[0] + np.cumsum(step, axis=0)
    side = normalize(np.cross(away, [0, 1.0, 0]))
    forward = normalize(np.cross(side, step))
    angle = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    thick = width * (0.5 + 1.1 * along**0.5 * (1 - along**3) ** 0.8)
    locks = 1 + 0.1 * np.sin(9 * angle + 4 * along[:, None])
    spoke = np.cos(angle)[None, :, None] * side + np.sin(angle)[None, :, None] * forward[:, None, :]
    rings = path[:, None] + spoke * (thick[:, None] * locks)[..., None]
    faces = loft(rings, closed=True)
    rest = np.stack(
        [
            np.broadcast_to(angle * width, rings.shape[:2]),
            np.broadcast_to(along[:, None] * length, rings.shape[:2]),
            np.zeros(rings.shape[:2]),
        ],
        -1,
    ).reshape(-1, 3)
    points = rings.reshape(-1, 3)
    faces = outwards(points, faces, np.repeat(path, 36, axis=0))
    wardrobe.parts.append(MeshPart(points, faces, rest, fabric))


def beard(skull: Skull, wardrobe: Wardrobe, rng: np.random.Generator, fabric: Fabric) -> None:
    """Put a beard of 3 to 14 mm on jaw and chin."""
    person = skull.person
    surface = person.base.body
    rest = surface.rows @ person.rest
    mouth = person.rest[TEETH].mean(axis=0)
    around = skull.around(rest)
    jaw = mouth[1] - 0.012 + 0.05 * np.clip((around - 25) / 50, 0, 1)
    lip = np.hypot(rest[:, 0] / 0.03, (rest[:, 1] - mouth[1]) / 0.016) - 1
    inside = np.minimum.reduce(
        [
            jaw - rest[:, 1],
            rest[:, 1] - (mouth[1] - 0.075),
            (rest[:, 2] - skull.centre[2] - 0.005),
            lip * 0.015,
        ]
    )
    of_head = skull.neck_and_head(surface.weights) > 0.6
    inside = np.where(of_head & (rest[:, 2] > mouth[2] - 0.12), inside, -1)
    outside = vertex_normals(rest, surface.faces)
    # The inside of the mouth, behind the lips, stays bare.
    inside = np.where(
        (np.abs(rest[:, 0]) < 0.03) & (rest[:, 2] < mouth[2] - 0.0) & (rest[:, 1] > mouth[1] - 0.03),
        -1,
        inside,
    )
    if (inside > 0).sum() < 50:
        return
    faces, rows = clip(surface.faces, inside)
    depth = rng.choice([0.003, 0.006, 0.014])
    root, weights = rows @ rest, rows @ surface.weights
    length = depth * np.clip((rows @ inside) / 0.012, 0.1, 1) * (1 + 0.25 * fold_noise(root, rng, 0.012))
    grown = root + normalize(rows @ outside + [0, -0.3, 0]) * length[:, None]
    label = REGIONS.index("face")
    grown = person.posed(weights, grown)
    wardrobe.parts.append(MeshPart(grown, faces, root, fabric, label=label))


def hat(skull: Skull, wardrobe: Wardrobe, rng: np.random.Generator, style: str, fabric: Fabric) -> None:
    """Put a "beanie", a "cap" with a visor, a brimmed "hat" or a "helmet" on the head."""
    points = skull.points
    tilt = {"beanie": 0.25, "helmet": 0.1}.get(style, 0.12)
    level = skull.eyes[1] + rng.uniform(0.035, 0.055)
    above = points[:, 1] - (level + tilt * (points[:, 2] - skull.centre[2] - 0.09))
    thick = {"beanie": 0.012, "cap": 0.012, "hat": 0.016, "helmet": 0.035}[style]
    up = np.clip(skull.direction[:, 1], 0, 1)
    lift = thick + {"beanie": 0.03 * up**2, "hat": 0.06 * up**3}.get(style, 0.01 * up)
    if style == "beanie":
        lift = lift + 0.003 * fold_noise(points, rng, 0.04) + np.where(above < 0.05, 0.006, 0.0)
    raised = points + skull.direction * np.asarray(lift)[:, None]
    faces, rows = clip(skull.faces, above)
    raised = rows @ raised
    wardrobe.parts.append(skull.part(*skull.closed(raised, faces), fabric))
    if style in ("cap", "hat"):
        chain = max(boundary_chains(faces), key=len)
        if style == "cap":
            chain = longest_run(chain, skull.around(raised[chain]) < 62)
        closed = chain[0] == chain[-1]
        here = raised[chain[:-1] if closed else chain]
        out = normalize((here - skull.centre) * [1, 0, 1])
        width = rng.uniform(0.055, 0.075) if style == "cap" else rng.uniform(0.045, 0.09)
        taper = np.ones(len(here))
        if style == "cap":
            taper = np.sin(np.linspace(0, np.pi, len(here))) ** 0.5
            out = normalize(out * [0.35, 0, 1])
        profile = [(0, 0), (0.35, 0), (0.7, -0.05), (1, -0.14), (1, -0.19), (0.6, -0.12), (0, -0.08)]
        rings = np.stack([here + out * (width * x * taper)[:, None] + [0, width * y, 0] for x, y in profile])
        wardrobe.parts.append(skull.part(rings.reshape(-1, 3), loft(rings, closed), fabric))
