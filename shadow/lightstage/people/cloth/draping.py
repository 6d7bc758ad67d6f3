"""Fast draping: cloth settles on a posed body by position-based dynamics."""

import numpy as np
from scipy.sparse import csr_matrix, diags
from scipy.spatial import cKDTree

from shadow.lightstage.figure import normalize
from shadow.lightstage.mesh import inner_edges, unique_edges

DRAPING_STEPS = 40
NOISE_WAVES = 6


def drape(
    start: np.ndarray,
    faces: np.ndarray,
    rest: np.ndarray,
    body: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    held: np.ndarray,
    *,
    gap: float = 0.004,
    weight: float = 1.0,
    bending: float = 0.3,
) -> np.ndarray:
    """Return the positions (V, 3) of cloth settled on a body, by position-based dynamics, Jacobi-averaged.

    `start`: (V, 3) initial positions in metres, y up; `rest`: those that define the lengths of the edges;
    `faces`: (F, 3). `body`: for each group of cloth vertices that collides with the same obstacle: the
    indices of these vertices, the points (P, 3) of the obstacle, and their outward normals (P, 3). `held`:
    (V,) in [0, 1]: 1 stays at the start, 0 is free. `gap`: metres between cloth and obstacle. `weight`:
    factor of gravity. `bending`: resistance to it in [0, 1].
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
    for step in range(DRAPING_STEPS):
        velocity = (position - previous) * np.float32(0.8)
        velocity[:, 1] += fall
        previous = position
        position = position + free * velocity
        for _ in range(4):
            span = position[springs[:, 1]] - position[springs[:, 0]]
            now = np.sqrt(np.einsum("ij,ij->i", span, span)) + np.float32(1e-9)
            pull = stiffness * (1 - length / now)
            # Compressed edges are weaker than stretched ones, since cloth buckles.
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
    """Return the vertices (S, 2), stiffness (S,) and rest length (S,) of the springs of cloth.

    There is one along each edge, and one of stiffness `bending` across each inner edge, between the two
    opposite vertices.
    """
    edges, _, _ = unique_edges(faces)
    across = inner_edges(faces)[:, 2:]
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
    """Move the vertices `index`, in place, to `gap` metres above planes with points and normals (N, 3)."""
    depth = gap - np.einsum("ij,ij->i", position[index] - points, normals)
    touching = np.flatnonzero((depth > 0) & (depth < 0.12))
    where = index[touching]
    position[where] += normals[touching] * depth[touching, None]
    # Friction: vertices that touch the body lose a part of their velocity.
    previous[where] += 0.6 * (position[where] - previous[where])


def fold_noise(points: np.ndarray, rng: np.random.Generator, wavelength: float) -> np.ndarray:
    """Return smooth noise (V,) of about unit amplitude at points (V, 3) in metres.

    It is a sum of sines of random directions that distort one another, so that crests meander like creases.
    """
    value = np.zeros(len(points))
    bend = np.zeros(len(points))
    for _ in range(NOISE_WAVES):
        direction = normalize(rng.normal(size=3)) * 2 * np.pi / (wavelength * rng.uniform(0.7, 1.5))
        wave = np.sin(points @ direction + 1.5 * bend + rng.uniform(0, 2 * np.pi))
        bend = 0.6 * bend + 0.6 * wave
        value += wave
    return value / np.sqrt(NOISE_WAVES)
