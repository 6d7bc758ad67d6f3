"""Triangle meshes: clipping, subdivision, boundaries and linings.

Mesh edits return the new faces and a sparse operator (new vertices x old vertices). Multiplied by it, all
vertex attributes (positions, skinning weights, garment coordinates) follow.
"""

from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix, identity, vstack
from scipy.spatial import cKDTree

from shadow.lightstage.figure import vertex_normals


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray, dict[str, list[list[list[int]]]]]:
    """Read a Wavefront file whose polygons have texture coordinates, with the numbers of its vertices.

    Returns the vertices (V, 3), the texture coordinates (T, 2), v up, and {name of a group: polygons}. A
    corner of a polygon is a pair of indices, of its vertex and of its texture coordinates.
    """
    vertices, texture = [], []
    groups: dict[str, list[list[list[int]]]] = {}
    group = ""
    for line in path.read_text().splitlines():
        kind, *words = line.split() or [""]
        if kind == "g":
            group = words[0]
        elif kind == "v":
            vertices.append([float(word) for word in words[:3]])
        elif kind == "vt":
            texture.append([float(word) for word in words[:2]])
        elif kind == "f":
            polygon = [[int(each) - 1 for each in word.split("/")[:2]] for word in words]
            groups.setdefault(group, []).append(polygon)
    return np.array(vertices), np.array(texture), groups


def unique_edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the edges (E, 2) of a mesh, the edge of each face side (F, 3), and the faces at each edge (E,).

    Edges are unique and sorted. Side k of a face runs from its vertex k to vertex k + 1.
    """
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1)
    sides = np.sort(sides.reshape(-1, 2), axis=1).astype(np.int64)
    key = sides[:, 0] * (faces.max() + 1) + sides[:, 1]
    _, first, inverse, count = np.unique(key, return_index=True, return_inverse=True, return_counts=True)
    return sides[first], inverse.reshape(-1, 3), count


def adjacency(faces: np.ndarray, count: int) -> csr_matrix:
    """Return the adjacency matrix (V, V) of the vertices of a mesh."""
    edges, _, _ = unique_edges(faces)
    both = np.concatenate([edges, edges[:, ::-1]])
    return csr_matrix((np.ones(len(both)), (both[:, 0], both[:, 1])), (count, count))


def inner_edges(faces: np.ndarray) -> np.ndarray:
    """Return the vertices (E, 4) of each edge between two faces: its ends, and the vertices opposite it."""
    edges, side, shared = unique_edges(faces)
    opposite = np.roll(faces, 1, axis=1).ravel()
    order = np.argsort(side.ravel(), kind="stable")
    inner = np.flatnonzero(shared == 2)
    first = np.concatenate([[0], np.cumsum(shared)])[inner]
    across = np.stack([opposite[order[first]], opposite[order[first + 1]]], axis=1)
    return np.concatenate([edges[inner], across], axis=1)


def subdivide(faces: np.ndarray, count: int) -> tuple[np.ndarray, csr_matrix]:
    """Apply one step of Loop subdivision to a mesh of `count` vertices: (4F, 3) faces and the operator."""
    edges, side, shared = unique_edges(faces)
    border = shared == 1
    # The vertex opposite each side, for the 3-3-1-1 rule of the new edge points.
    opposite = np.roll(faces, 1, axis=1).ravel()
    inner_side = ~border[side.ravel()]
    rows = [np.arange(len(edges))] * 2 + [side.ravel()[inner_side]]
    columns = [edges[:, 0], edges[:, 1], opposite[inner_side]]
    weight = np.where(border, 0.5, 0.375)
    values = [weight, weight, 0.25 / shared[side.ravel()[inner_side]]]
    edge_points = csr_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (len(edges), count)
    )
    on_border = np.zeros(count, bool)
    on_border[edges[border]] = True
    ring = edges[border | ~on_border[edges].all(axis=1)]
    ends = np.concatenate([ring, ring[:, ::-1]])
    neighbours_border = np.concatenate([edges[border], edges[border][:, ::-1]])
    inside = ends[~on_border[ends[:, 0]]]
    valence = np.bincount(inside[:, 0], minlength=count)
    beta = np.where(valence == 3, 3 / 16, 3 / (8 * np.maximum(valence, 1)))
    border_valence = np.maximum(np.bincount(neighbours_border[:, 0], minlength=count), 1)
    own = np.where(on_border, 0.75, 1 - beta * valence)
    old_points = csr_matrix(
        (
            np.concatenate([own, beta[inside[:, 0]], 0.25 / border_valence[neighbours_border[:, 0]]]),
            (
                np.concatenate([np.arange(count), inside[:, 0], neighbours_border[:, 0]]),
                np.concatenate([np.arange(count), inside[:, 1], neighbours_border[:, 1]]),
            ),
        ),
        (count, count),
    )
    m = side + count
    a, b, c = faces.T
    ab, bc, ca = m.T
    return _quarter(a, b, c, ab, bc, ca), vstack([old_points, edge_points], format="csr")


def subdivide_corners(values: np.ndarray) -> np.ndarray:
    """Return values (F, 3, C) of the corners of faces for the faces of `subdivide`: (4F, 3, C)."""
    a, b, c = values[:, 0], values[:, 1], values[:, 2]
    return _quarter(a, b, c, (a + b) / 2, (b + c) / 2, (c + a) / 2)


def _quarter(*corners: np.ndarray) -> np.ndarray:
    """Return the four parts of each face, given its corners a, b, c and the middles ab, bc, ca."""
    a, b, c, ab, bc, ca = corners
    return np.concatenate(
        [np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
    )


def _snap_to_line(faces: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, csr_matrix]:
    """Move vertices that are close to the zero line of `inside` (V,) along an edge onto it.

    Returns `inside`, which is then zero there, and the operator (V, V).
    """
    count = len(inside)
    inside = inside.astype(float).copy()
    edges, _, _ = unique_edges(faces)
    both = np.concatenate([edges, edges[:, ::-1]])
    crossing = inside[both[:, 0]] * inside[both[:, 1]] < 0
    both = both[crossing]
    along = inside[both[:, 0]] / (inside[both[:, 0]] - inside[both[:, 1]])
    near = along < 0.35
    order = np.argsort(-along[near], kind="stable")  # the last write wins: the nearest crossing
    moved, target, step = both[near][order, 0], both[near][order, 1], along[near][order]
    partner, amount = np.arange(count), np.zeros(count)
    partner[moved], amount[moved] = target, step
    snap = csr_matrix(
        (
            np.concatenate([1 - amount, amount]),
            (np.tile(np.arange(count), 2), np.concatenate([np.arange(count), partner])),
        ),
        (count, count),
    )
    inside[moved] = 0.0
    return inside, snap


def clip(faces: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, csr_matrix]:
    """Clip a mesh along the zero line of `inside` (V,), and keep the part where it is positive.

    Vertices close to the line are first moved onto it, so that the cut leaves no slivers. Returns the faces
    and the operator, without vertices that no face uses.
    """
    count = len(inside)
    inside, snap = _snap_to_line(faces, inside)
    sign = np.sign(inside).astype(int)
    corner = sign[faces]
    whole = faces[(corner >= 0).all(axis=1) & (corner > 0).any(axis=1)]
    mixed = (corner > 0).any(axis=1) & (corner < 0).any(axis=1)
    cut, corner = faces[mixed], corner[mixed]
    # Rotate each cut face so that its first vertex is alone on its side, or lies on the line.
    alone = np.where(
        (corner == 0).any(axis=1),
        np.argmax(corner == 0, axis=1),
        np.argmax(corner == -np.sign(corner.sum(axis=1, keepdims=True)), axis=1),
    )
    turn = (alone[:, None] + np.arange(3)) % 3
    cut, corner = np.take_along_axis(cut, turn, 1), np.take_along_axis(corner, turn, 1)
    new_edges: list[np.ndarray] = []

    def crossing_point(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        new_edges.append(np.stack([start, end], axis=1))
        return count + sum(map(len, new_edges[:-1])) + np.arange(len(start))

    on_line = corner[:, 0] == 0
    parts = [whole]
    a, b, c = cut[on_line].T
    m = crossing_point(b, c)
    b_in = corner[on_line, 1] > 0
    parts.append(np.where(b_in[:, None], np.stack([a, b, m], 1), np.stack([a, m, c], 1)))
    one_in = ~on_line & (corner[:, 0] > 0)
    a, b, c = cut[one_in].T
    parts.append(np.stack([a, crossing_point(a, b), crossing_point(a, c)], 1))
    two_in = ~on_line & (corner[:, 0] < 0)
    a, b, c = cut[two_in].T
    ab, ac = crossing_point(a, b), crossing_point(a, c)
    parts += [np.stack([ab, b, c], 1), np.stack([ab, c, ac], 1)]

    # Faces on both sides of a cut edge share its crossing point.
    cuts = np.concatenate(new_edges)
    low = np.sort(cuts, axis=1).astype(np.int64)
    _, first, merged = np.unique(low[:, 0] * count + low[:, 1], return_index=True, return_inverse=True)
    low = low[first]
    share = inside[low[:, 0]] / (inside[low[:, 0]] - inside[low[:, 1]])
    points = csr_matrix(
        (
            np.concatenate([1 - share, share]),
            (np.tile(np.arange(len(low)), 2), np.concatenate([low[:, 0], low[:, 1]])),
        ),
        (len(low), count),
    )
    renumber = np.concatenate([np.arange(count), count + merged])
    faces = renumber[np.concatenate(parts)]
    operator = vstack([identity(count, format="csr"), points], format="csr") @ snap
    return remove_unused(faces, operator)


def remove_unused(faces: np.ndarray, operator: csr_matrix) -> tuple[np.ndarray, csr_matrix]:
    """Remove the vertices that no face uses from faces and an operator."""
    used, renumbered = np.unique(faces, return_inverse=True)
    return renumbered.reshape(-1, 3), operator[used]


def boundary_chains(faces: np.ndarray) -> list[np.ndarray]:
    """Return the boundary of a mesh as chains of vertices, with the surface on their left.

    A loop repeats its first vertex at its end.
    """
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, side, shared = unique_edges(faces)
    border = sides[shared[side.ravel()] == 1]
    following = dict(border.tolist())
    chains = []
    while following:
        start = next(iter(following))
        chain = [start]
        while (step := following.pop(chain[-1], None)) is not None:
            chain.append(step)
            if step == start:
                break
        chains.append(np.array(chain))
    return chains


def add_lining(
    vertices: np.ndarray, faces: np.ndarray, thickness: float, depth: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give cloth an inner side, `thickness` metres below it and up to `depth` metres from its boundary.

    Edges get a thickness, and cloth is visible inside a sleeve or under a hem. Returns vertices, faces and,
    for each vertex, the old vertex that it comes from.
    """
    chains = boundary_chains(faces)
    if not chains:
        return vertices, faces, np.arange(len(vertices))
    reach = cKDTree(vertices[np.unique(np.concatenate(chains))]).query(vertices, distance_upper_bound=depth)[
        0
    ]
    lined = faces[np.isfinite(reach)[faces].all(axis=1)]
    source, inner = np.unique(lined, return_inverse=True)
    count = len(vertices)
    opposite = np.full(count, -1)
    opposite[source] = count + np.arange(len(source))
    rims = []
    for chain in chains:
        a, b = chain[:-1], chain[1:]
        whole = (opposite[a] >= 0) & (opposite[b] >= 0)
        a, b = a[whole], b[whole]
        rims += [np.stack([b, a, opposite[a]], 1), np.stack([b, opposite[a], opposite[b]], 1)]
    behind = vertices[source] - vertex_normals(vertices, faces)[source] * thickness
    return (
        np.concatenate([vertices, behind]),
        np.concatenate([faces, (count + inner.reshape(-1, 3))[:, ::-1], *rims]),
        np.concatenate([np.arange(count), source]),
    )


def loft(rings: np.ndarray, closed: bool) -> np.ndarray:
    """Return the faces of a surface through rings of vertices (R, N, 3), which are numbered ring by ring.

    The first ring is a chain of `boundary_chains`, whose surface is continued.
    """
    count, size = rings.shape[:2]
    a = np.arange(count - 1)[:, None] * size + np.arange(size)
    b = np.roll(a, -1, axis=1)
    if not closed:
        a, b = a[:, :-1], b[:, :-1]
    a, b = a.ravel(), b.ravel()
    return np.concatenate([np.stack([b, a, a + size], 1), np.stack([b, a + size, b + size], 1)])


def longest_run(chain: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the longest run of `wanted` vertices along a chain of `boundary_chains`.

    In a loop it may begin anywhere. A loop stays a loop if all of its vertices are wanted.
    """
    if wanted.all():
        return chain
    loop = chain[:-1] if chain[0] == chain[-1] else chain
    wanted = wanted[: len(loop)]
    start = int(np.argmin(wanted))
    loop, wanted = np.roll(loop, -start), np.roll(wanted, -start)
    runs = np.flatnonzero(np.diff(np.concatenate([[0], wanted.astype(int), [0]]))).reshape(-1, 2)
    if not len(runs):
        return loop[:0]
    low, high = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    return loop[low:high]
