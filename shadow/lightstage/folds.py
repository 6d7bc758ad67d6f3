"""Add geometric folds to the clothes of a scan.

The mesh is subdivided once and displaced by ridged noise. Unlike folds in a normal map or texture, these turn
the surface and cast shadows.
"""

from dataclasses import replace

import numpy as np
from scipy.sparse.csgraph import connected_components

from shadow.lightstage.figure import Albedo, Figure, normalize, vertex_normals
from shadow.lightstage.mesh import adjacency, unique_edges
from shadow.lightstage.people.cloth.fabric import Noise

FOLD_HEIGHTS = 0.008, 0.024  # metres from the valley to the crest of a fold: lowest and highest
FOLD_WIDTHS = 0.045, 0.11  # metres from crest to crest: smallest and largest
FOLD_LENGTHS = 2.0, 4.5  # in widths: smallest and largest
SMOOTHING_STEPS = 12  # over which folds fade out at the edge of the cloth, within about 2 cm
HEAD_HEIGHT = 0.84  # share of the height above which everything counts as head or raised hands
WELD_DISTANCE = 1e-5  # metres: closer vertices are one vertex that a texture seam has split
SKIN_RED, SKIN_GREEN = (0.4, 0.72), (0.2, 0.36)  # ranges in linear skin, as shares of red + green + blue
SKIN_DISTANCE = 0.35  # largest distance in log colour ratios to the skin of the same person
# Barycentric coordinates, in the parent face, of the corners of its four children.
QUARTERS = np.array(
    [
        [[1, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5]],
        [[0.5, 0.5, 0], [0, 1, 0], [0, 0.5, 0.5]],
        [[0.5, 0, 0.5], [0, 0.5, 0.5], [0, 0, 1]],
        [[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]],
    ]
)


def add_folds(figure: Figure, rng: np.random.Generator) -> Figure:
    """Return the figure with random folds in its cloth.

    The head, skin, and parts that are not connected to the body have no folds. The mesh has four times as
    many faces. Shading normals follow the surface; colours and normal map stay in place.
    """
    share = _smooth_mask(figure, _cloth_mask(figure))
    fine, share = subdivide(figure, share)
    point = _weld(fine.vertices)
    normals = _average_welded(fine.normals, point)
    height = share * _ridge_heights(fine.vertices, rng)
    raised = fine.vertices + (height[:, None] * normals).astype(np.float32)
    before, after = (
        _average_welded(vertex_normals(each, fine.faces), point) for each in (fine.vertices, raised)
    )
    turned = normalize(fine.normals + after - before)
    return replace(fine, vertices=raised.astype(np.float32), normals=turned.astype(np.float32))


def _ridge_heights(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw heights (V,) in metres: two systems of long ridges in random directions, whose strength varies."""
    total = np.zeros(len(points))
    for strength in (1.0, rng.uniform(0.3, 0.7)):
        noise, width = Noise(rng), np.exp(rng.uniform(*np.log(FOLD_WIDTHS)))
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0] * [1, 1, 1 / rng.uniform(*FOLD_LENGTHS)]
        bend = np.stack([noise(points + 5 * k, 3 * width) for k in range(3)], axis=1) - 0.5
        ridged = 1 - np.abs(2 * noise((points + 0.8 * width * bend) @ axes, width) - 1)  # a crest at 1/2
        patches = np.clip(3 * noise(points + 11, 0.25) - 0.6, 0.15, 1)
        total += strength * patches * ridged**2
    return rng.uniform(*FOLD_HEIGHTS) * total


def _cloth_mask(figure: Figure) -> np.ndarray:
    """Return which vertices (V,) are cloth: below the head, in the largest component, not skin-coloured.

    A scan has no labels. The tone of the skin is assumed to be the median of the skin-like colours in the
    upper part of the figure, where the face is.
    """
    colour = _vertex_colours(figure)
    share = colour / colour.sum(axis=1, keepdims=True)
    red, green = share[:, 0], share[:, 1]
    skin = (SKIN_RED[0] < red) & (red < SKIN_RED[1]) & (SKIN_GREEN[0] < green) & (green < SKIN_GREEN[1])
    above = figure.vertices[:, 1] > HEAD_HEIGHT * figure.vertices[:, 1].max()
    if (face := skin & above).any():
        tone = np.log(colour[:, :2] / colour[:, 1:])
        skin &= np.linalg.norm(tone - np.median(tone[face], axis=0), axis=1) < SKIN_DISTANCE
    return ~skin & ~above & _largest_component(figure)


def _vertex_colours(figure: Figure) -> np.ndarray:
    """Return the albedo (V, 3) at the vertices, bounded away from zero."""
    face, corner = np.divmod(np.arange(figure.faces.size), 3)
    albedo = figure.albedo(face, np.eye(3)[corner])
    colours = np.full(figure.vertices.shape, 0.5)
    colours[figure.faces.ravel()] = albedo
    return colours + 1e-3


def _weld(vertices: np.ndarray) -> np.ndarray:
    """Return the index (V,) of each vertex's position; vertices that a texture seam splits share one."""
    places = np.round(vertices / WELD_DISTANCE).astype(np.int64)
    return np.unique(places, axis=0, return_inverse=True)[1].ravel()


def _average_welded(vectors: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Average unit vectors (V, 3) over the vertices at the same position, so that no seam opens."""
    sums = np.stack([np.bincount(point, vectors[:, axis]) for axis in range(3)], axis=1)
    return normalize(sums)[point]


def _largest_component(figure: Figure) -> np.ndarray:
    """Return which vertices (V,) belong to the largest connected component; others are eyes, hair, props."""
    point = _weld(figure.vertices)
    label = connected_components(adjacency(point[figure.faces], point.max() + 1), directed=False)[1][point]
    return label == np.bincount(label).argmax()


def _smooth_mask(figure: Figure, cloth: np.ndarray) -> np.ndarray:
    """Return the weight of the folds (V,) in [0, 1]: 1 inside the cloth, falling to 0 at its edge."""
    point = _weld(figure.vertices)
    count = np.bincount(point)
    edges = adjacency(point[figure.faces], len(count))
    share = np.bincount(point, cloth) / count
    other = share < 0.5
    neighbours = np.asarray(edges.sum(axis=1)).ravel()
    for _ in range(SMOOTHING_STEPS):
        share = (share + edges @ share / np.maximum(neighbours, 1)) / 2
        share[other] = 0
    return share[point]


def subdivide(figure: Figure, share: np.ndarray) -> tuple[Figure, np.ndarray]:
    """Divide each face of the figure into four; also interpolates the vertex values `share` (V,)."""
    ends, side, _ = unique_edges(figure.faces)
    first, second, third = side.T + len(figure.vertices)
    a, b, c = figure.faces.T
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
        normals=normalize(halved(figure.normals)).astype(np.float32),
        albedo=follow(figure.albedo),
        normal_map=None if figure.normal_map is None else follow(figure.normal_map),
        tangents=tangents,
    )
    return fine, halved(share)
