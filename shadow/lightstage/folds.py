"""Folds in the mesh of a scan that has none: its cloth subdivided once and raised by ridged noise, so that
folds turn the surface and cast shadows, which a normal map and painted folds cannot.
"""

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components

from shadow.lightstage.figure import Albedo, Figure, unit, vertex_normals
from shadow.lightstage.people.fabric import Noise

HEIGHTS = 0.008, 0.024  # metres from the floor to the crest of a fold
WIDTHS = 0.045, 0.11  # metres from crest to crest
LENGTH = 2.0, 4.5  # of a fold, in its widths
SMOOTHINGS = 12  # of where cloth ends, from vertex to neighbours: folds run out over some 2 cm
HEAD = 0.84  # of the height: what lies above is taken for a head, or raised hands
TOUCHING = 1e-5  # metres: vertices nearer than this are one, split by the texture
SKIN_RED, SKIN_GREEN = (0.4, 0.72), (0.2, 0.36)  # shares of linear skin's red and green in its colour's sum
TONE = 0.35  # distance in log colour ratios at which something is no longer of this person's skin
# Barycentric coordinates in the parent of the corners of the four faces that it is divided into.
QUARTERS = np.array(
    [
        [[1, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5]],
        [[0.5, 0.5, 0], [0, 1, 0], [0, 0.5, 0.5]],
        [[0.5, 0, 0.5], [0, 0.5, 0.5], [0, 0, 1]],
        [[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]],
    ]
)


def folded(figure: Figure, rng: np.random.Generator) -> Figure:
    """The figure with random folds in its cloth: not its head, its skin, or what is separate from its body.

    Its mesh is four times as fine. Its shading normals turn as the surface does, and its colours and normal
    map stay where they were.
    """
    share = _smoothed(figure, _cloth(figure))
    fine, share = _subdivided(figure, share)
    point = _points(fine.vertices)
    normals = _averaged(fine.normals, point)
    height = share * _relief(fine.vertices, rng)
    raised = fine.vertices + (height[:, None] * normals).astype(np.float32)
    before, after = (_averaged(vertex_normals(each, fine.faces), point) for each in (fine.vertices, raised))
    turned = unit(fine.normals + after - before)
    return replace(fine, vertices=raised.astype(np.float32), normals=turned.astype(np.float32))


def _relief(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Heights (V,) in metres: two systems of long ridges in directions of their own, stronger here and
    weaker there."""
    total = np.zeros(len(points))
    for strength in (1.0, rng.uniform(0.3, 0.7)):
        noise, width = Noise(rng), np.exp(rng.uniform(*np.log(WIDTHS)))
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0] * [1, 1, 1 / rng.uniform(*LENGTH)]
        bend = np.stack([noise(points + 5 * k, 3 * width) for k in range(3)], axis=1) - 0.5
        ridged = 1 - np.abs(2 * noise((points + 0.8 * width * bend) @ axes, width) - 1)  # a crest at 1/2
        patches = np.clip(3 * noise(points + 11, 0.25) - 0.6, 0.15, 1)
        total += strength * patches * ridged**2
    return rng.uniform(*HEIGHTS) * total


def _cloth(figure: Figure) -> np.ndarray:
    """Which vertices (V,) are cloth: below the head, of the largest piece, and not of the skin's colour.

    A scan does not say what it is made of. Skin is taken to have the tone that most of what looks like skin
    has in the upper part of the figure, where faces are.
    """
    colour = _vertex_colours(figure)
    share = colour / colour.sum(axis=1, keepdims=True)
    red, green = share[:, 0], share[:, 1]
    skin = (SKIN_RED[0] < red) & (red < SKIN_RED[1]) & (SKIN_GREEN[0] < green) & (green < SKIN_GREEN[1])
    above = figure.vertices[:, 1] > HEAD * figure.vertices[:, 1].max()
    if (face := skin & above).any():
        tone = np.log(colour[:, :2] / colour[:, 1:])
        skin &= np.linalg.norm(tone - np.median(tone[face], axis=0), axis=1) < TONE
    return ~skin & ~above & _largest_piece(figure)


def _vertex_colours(figure: Figure) -> np.ndarray:
    """The albedo (V, 3) at the vertices, and a little above zero."""
    face, corner = np.divmod(np.arange(figure.faces.size), 3)
    albedo = figure.albedo(face, np.eye(3)[corner])
    colours = np.full(figure.vertices.shape, 0.5)
    colours[figure.faces.ravel()] = albedo
    return colours + 1e-3


def _points(vertices: np.ndarray) -> np.ndarray:
    """The number (V,) of each vertex's place: those that a texture's seam splits share one."""
    places = np.round(vertices / TOUCHING).astype(np.int64)
    return np.unique(places, axis=0, return_inverse=True)[1].ravel()


def _averaged(vectors: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Unit vectors (V, 3) averaged over the vertices in one place, so that no seam opens."""
    sums = np.stack([np.bincount(point, vectors[:, axis]) for axis in range(3)], axis=1)
    return unit(sums)[point]


def _edges(figure: Figure, point: np.ndarray) -> csr_matrix:
    """Which places are joined by an edge (P, P)."""
    ends = point[figure.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)]
    count = point.max() + 1
    joined = coo_matrix((np.ones(2 * len(ends)), (ends.ravel(), ends[:, ::-1].ravel())), shape=(count, count))
    matrix = joined.tocsr()
    matrix.data[:] = 1
    return matrix


def _largest_piece(figure: Figure) -> np.ndarray:
    """Which vertices (V,) are of the largest connected piece: the rest are eyes, hair, things."""
    point = _points(figure.vertices)
    label = connected_components(_edges(figure, point), directed=False)[1][point]
    return label == np.bincount(label).argmax()


def _smoothed(figure: Figure, cloth: np.ndarray) -> np.ndarray:
    """A share of cloth (V,) in [0, 1]: one inside it, falling to zero at what is not."""
    point = _points(figure.vertices)
    edges = _edges(figure, point)
    count = np.bincount(point)
    share = np.bincount(point, cloth) / count
    other = share < 0.5
    neighbours = np.asarray(edges.sum(axis=1)).ravel()
    for _ in range(SMOOTHINGS):
        share = (share + edges @ share / np.maximum(neighbours, 1)) / 2
        share[other] = 0
    return share[point]


def _subdivided(figure: Figure, share: np.ndarray) -> tuple[Figure, np.ndarray]:
    """The figure and its vertices' values (V,) with each face divided into four; textures follow."""
    faces = figure.faces
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    ends, inverse = np.unique(edges, axis=0, return_inverse=True)
    first, second, third = inverse.reshape(-1, 3).T + len(figure.vertices)
    a, b, c = faces.T
    quarters = np.stack(
        [a, first, third, first, b, second, third, second, c, first, second, third], axis=1
    ).reshape(-1, 3)

    def halved(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, values[ends].mean(axis=1)])

    def follow(texture: Albedo) -> Albedo:
        return lambda face, barycentric: texture(
            face // 4, np.einsum("nk,nkc->nc", barycentric, QUARTERS[face % 4])
        )

    tangents = figure.tangents
    if tangents is not None:
        tangents = np.einsum("qkc,fcd->fqkd", QUARTERS, tangents).reshape(-1, 3, 4).astype(np.float32)
    fine = replace(
        figure,
        vertices=halved(figure.vertices).astype(np.float32),
        faces=quarters.astype(np.int32),
        normals=unit(halved(figure.normals)).astype(np.float32),
        albedo=follow(figure.albedo),
        detail=None if figure.detail is None else follow(figure.detail),
        tangents=tangents,
    )
    return fine, halved(share)
