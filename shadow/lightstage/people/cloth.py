"""Cloth as triangles: cutting, refining, draping over a posed body, wrinkles and hems.

Mesh edits return a sparse operator (new vertices x old vertices) beside the new faces, so that every quantity
kept on the vertices (positions, skinning weights, garment coordinates) follows by one product.
"""

import numpy as np
from scipy.sparse import csr_matrix, diags, identity, vstack
from scipy.spatial import cKDTree

from shadow.lightstage.figure import unit, vertex_normals


def edges_of(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unique edges (E, 2) sorted, the edge of each face side (F, 3), and how many faces share each edge (E,).

    Side k of a face runs from its vertex k to vertex k + 1.
    """
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1)
    sides = np.sort(sides.reshape(-1, 2), axis=1).astype(np.int64)
    key = sides[:, 0] * (faces.max() + 1) + sides[:, 1]
    _, first, inverse, count = np.unique(key, return_index=True, return_inverse=True, return_counts=True)
    return sides[first], inverse.reshape(-1, 3), count


def subdivide(faces: np.ndarray, count: int) -> tuple[np.ndarray, csr_matrix]:
    """One step of Loop subdivision of a mesh of `count` vertices: (4F, 3) faces and the operator."""
    edges, side, shared = edges_of(faces)
    border = shared == 1
    # Vertex opposite each side, for the 3-3-1-1 rule of the new edge points.
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
    fine = np.concatenate(
        [np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
    )
    return fine, vstack([old_points, edge_points], format="csr")


def _snapped(faces: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, csr_matrix]:
    """`inside` (V,), zero at vertices close to its zero line, and the operator (V, V) that moves these onto
    the line, along an edge."""
    count = len(inside)
    inside = inside.astype(float).copy()
    edges, _, _ = edges_of(faces)
    both = np.concatenate([edges, edges[:, ::-1]])
    crossing = inside[both[:, 0]] * inside[both[:, 1]] < 0
    both = both[crossing]
    along = inside[both[:, 0]] / (inside[both[:, 0]] - inside[both[:, 1]])
    near = along < 0.35
    order = np.argsort(-along[near], kind="stable")  # the last write, the nearest crossing, wins
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
    """Cut a mesh along the zero line of `inside` (V,), keeping where it is positive.

    Vertices close to the line are first moved onto it, so the cut leaves no slivers.
    Returns the faces and the operator; vertices that no face uses are gone.
    """
    count = len(inside)
    inside, snap = _snapped(faces, inside)
    sign = np.sign(inside).astype(int)
    corner = sign[faces]
    kept = faces[(corner >= 0).all(axis=1) & (corner > 0).any(axis=1)]
    mixed = (corner > 0).any(axis=1) & (corner < 0).any(axis=1)
    cut, corner = faces[mixed], corner[mixed]
    # Turn each cut face so that its first vertex is alone on its side, or lies on the line.
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
    parts = [kept]
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
    return compact(faces, operator)


def compact(faces: np.ndarray, operator: csr_matrix) -> tuple[np.ndarray, csr_matrix]:
    """Drop the vertices that no face uses."""
    used, renumbered = np.unique(faces, return_inverse=True)
    return renumbered.reshape(-1, 3), operator[used]


def border_chains(faces: np.ndarray) -> list[np.ndarray]:
    """The border of a mesh as chains of vertices, each walked with the surface on its left; loops are closed
    by repeating their first vertex."""
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, side, shared = edges_of(faces)
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


def drape(
    start: np.ndarray,
    faces: np.ndarray,
    rest: np.ndarray,
    body: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    held: np.ndarray,
    *,
    steps: int = 40,
    gap: float = 0.004,
    weight: float = 1.0,
    bending: float = 0.3,
) -> np.ndarray:
    """Let cloth settle on a body: position-based dynamics with Jacobi averaging.

    start (V, 3): where the cloth begins, metres, y up. rest (V, 3): the shape its edge lengths come from.
    body: for each group of cloth vertices that meets the same obstacle, (cloth vertex indices, obstacle
    points (P, 3), their outward normals (P, 3)). held (V,) in [0, 1]: 1 stays at the start, 0 is free.
    gap: metres kept from the obstacle. weight: of gravity. bending in [0, 1]: resistance to folding.
    """
    count = len(start)
    springs, stiffness, length = _springs(faces, rest, bending)
    column = np.arange(len(springs))
    incidence = csr_matrix(
        (
            np.concatenate([np.ones(len(springs)), -np.ones(len(springs))]).astype(np.float32),
            (np.concatenate([springs[:, 0], springs[:, 1]]), np.tile(column, 2)),
        ),
        (count, len(springs)),
    )
    degree = np.bincount(springs.ravel(), np.repeat(stiffness, 2), count)
    free = (1 - held).astype(np.float32)[:, None]
    spread = diags((1.6 * free[:, 0] / np.maximum(degree, 1)).astype(np.float32)) @ incidence
    trees = [
        (index, cKDTree(points), points.astype(np.float32), normals.astype(np.float32))
        for index, points, normals in body
    ]
    position = start.astype(np.float32)
    previous = position.copy()
    fall = np.float32(-0.0003 * weight)
    planes: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for step in range(steps):
        velocity = (position - previous) * np.float32(0.8)
        velocity[:, 1] += fall
        previous = position
        position = position + free * velocity
        for _ in range(4):
            span = position[springs[:, 1]] - position[springs[:, 0]]
            now = np.sqrt(np.einsum("ij,ij->i", span, span)) + np.float32(1e-9)
            pull = stiffness * (1 - length / now)
            # Compressed edges give way more easily than stretched ones: cloth buckles.
            pull *= np.where(pull < 0, np.float32(0.6), np.float32(1))
            position = position + spread @ (span * (0.5 * pull)[:, None])
        if step % 5 == 0:
            planes = []
            for index, tree, points, normals in trees:
                nearest = tree.query(position[index])[1]
                planes.append((index, points[nearest], normals[nearest]))
        for index, points, normals in planes:
            _push_out(position, previous, index, points, normals, gap)
    return position.astype(float)


def _springs(
    faces: np.ndarray, rest: np.ndarray, bending: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The springs of cloth: the vertices (S, 2) that each joins, its stiffness (S,) and length at rest (S,).

    There is one along each edge, and one across each inner edge, of stiffness `bending`, between the two
    vertices opposite to it.
    """
    edges, side, shared = edges_of(faces)
    opposite = np.roll(faces, 1, axis=1).ravel()
    order = np.argsort(side.ravel(), kind="stable")
    inner = np.flatnonzero(shared == 2)
    first = np.concatenate([[0], np.cumsum(shared)])[inner]
    across = np.stack([opposite[order[first]], opposite[order[first + 1]]], axis=1)
    springs = np.concatenate([edges, across])
    stiffness = np.concatenate([np.ones(len(edges)), np.full(len(across), bending)]).astype(np.float32)
    length = np.linalg.norm(rest[springs[:, 1]] - rest[springs[:, 0]], axis=1).astype(np.float32)
    return springs, stiffness, length


def _push_out(
    position: np.ndarray,
    previous: np.ndarray,
    index: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    gap: float,
) -> None:
    """Bring the vertices `index` to `gap` metres before the planes at `points` with these `normals`, (N, 3)
    each, in place."""
    depth = gap - np.einsum("ij,ij->i", position[index] - points, normals)
    touching = np.flatnonzero((depth > 0) & (depth < 0.12))
    where = index[touching]
    position[where] += normals[touching] * depth[touching, None]
    # Friction: what touches the body keeps a part of its place.
    previous[where] += 0.6 * (position[where] - previous[where])


def fold_noise(points: np.ndarray, rng: np.random.Generator, wavelength: float, waves: int = 6) -> np.ndarray:
    """Smooth noise (V,) of about unit amplitude at points (V, 3) in metres: sines of random direction bent by
    one another, so that crests wander as creases do."""
    value = np.zeros(len(points))
    bend = np.zeros(len(points))
    for _ in range(waves):
        direction = unit(rng.normal(size=3)) * 2 * np.pi / (wavelength * rng.uniform(0.7, 1.5))
        wave = np.sin(points @ direction + 1.5 * bend + rng.uniform(0, 2 * np.pi))
        bend = 0.6 * bend + 0.6 * wave
        value += wave
    return value / np.sqrt(waves)


def line(
    vertices: np.ndarray, faces: np.ndarray, thickness: float, depth: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give cloth an inner side up to `depth` metres from its borders, so that an edge has thickness and
    whoever looks into a sleeve or under a hem finds cloth.

    Returns vertices, faces and, for each vertex, the old vertex that it comes from.
    """
    chains = border_chains(faces)
    if not chains:
        return vertices, faces, np.arange(len(vertices))
    reach = cKDTree(vertices[np.unique(np.concatenate(chains))]).query(vertices, distance_upper_bound=depth)[
        0
    ]
    lined = faces[np.isfinite(reach)[faces].all(axis=1)]
    source, inner = np.unique(lined, return_inverse=True)
    count = len(vertices)
    place = np.full(count, -1)
    place[source] = count + np.arange(len(source))
    rims = []
    for chain in chains:
        a, b = chain[:-1], chain[1:]
        whole = (place[a] >= 0) & (place[b] >= 0)
        a, b = a[whole], b[whole]
        rims += [np.stack([b, a, place[a]], 1), np.stack([b, place[a], place[b]], 1)]
    behind = vertices[source] - vertex_normals(vertices, faces)[source] * thickness
    return (
        np.concatenate([vertices, behind]),
        np.concatenate([faces, (count + inner.reshape(-1, 3))[:, ::-1], *rims]),
        np.concatenate([np.arange(count), source]),
    )


def strip(rings: np.ndarray, closed: bool) -> np.ndarray:
    """Faces of a band through rings of vertices (R, N, 3), numbered ring by ring.

    The first ring is a border as `border_chains` walks it; the band continues that surface.
    """
    count, size = rings.shape[:2]
    a = np.arange(count - 1)[:, None] * size + np.arange(size)
    b = np.roll(a, -1, axis=1)
    if not closed:
        a, b = a[:, :-1], b[:, :-1]
    a, b = a.ravel(), b.ravel()
    return np.concatenate([np.stack([b, a, a + size], 1), np.stack([b, a + size, b + size], 1)])


def stretch(chain: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """The longest run of wanted vertices along a chain of `border_chains`; a loop may be entered anywhere,
    and stays a loop if all of it is wanted."""
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
