"""Light that the body throws on itself, for every light of the set at once.

A path tracer needs minutes for the lights of one view, and most of its work is the same for all of them:
where the paths go does not depend on the light. So the paths are traced once, by final gathering over a
radiosity cache (Ward et al. 1988; Jensen 1996): from each point seen, rays over its hemisphere; where they
hit, the irradiance of the nearest of some thousand cache points, which know every light by shadow rays, and
each other by rays of their own. tests/test_bounce.py holds it against Mitsuba's path tracer.
"""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import KDTree

from shadow.data.records import BOUNCE_RANK
from shadow.lightstage.scene import Scene, Surface

STRATA = (4, 8)  # of the rays of a point: 32, as Section 3 has samples a pixel
CACHE = 4096  # points: 2 cm apart on a person
BOUNCES = 4
# Metres of distance that weigh as much as a radian between normals, when cache points are looked up.
NEAR = 0.05
PLANE = 0.01  # metres off a pixel's tangent plane, and
TURN = 0.1  # one minus the cosine between normals, at which a neighbour counts 1/e


def bounce(scene: Scene, surface: Surface, lights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Indirect diffuse shading of points by each light alone.

    Parameters
    ----------
    scene: Scene. surface: Surface of N points in it.
    lights: (D, 3) unit directions to distant lights of intensity 1: a surface that faces one directly has
        shading 1.
    rng: numpy Generator.

    Returns
    -------
    (N, D, 3) float32 linear Rec.709, >= 0: what arrives after one to four bounces, coloured by the albedo
    that it met. The sum with max(N·L, 0) × visibility is the path-traced shading of Section 3.
    """
    source, hits = scene.gather(surface, STRATA, rng)
    if not len(hits):
        return np.zeros((len(surface), len(lights), 3), np.float32)
    cache = hits.take(rng.choice(len(hits), min(CACHE, len(hits)), replace=False))
    tree = KDTree(_place(cache))
    direct = (cache.normal @ lights.T).clip(0) * scene.visibility(cache, lights)
    seen = _transfer(len(surface), source, hits, tree)
    seen_by_cache = _transfer(len(cache), *scene.gather(cache, STRATA, rng), tree)
    shading = np.empty((len(surface), len(lights), 3), np.float32)
    for channel in range(3):
        irradiance = direct.astype(np.float32)
        for _ in range(BOUNCES - 1):
            irradiance = direct + seen_by_cache[channel] @ irradiance
        shading[..., channel] = seen[channel] @ irradiance
    return shading


def factors(shading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The best factors of rank K (Eckart and Young 1936) of bounce light (N, D, 3): (N, K) and (K, D, 3)."""
    flat = shading.reshape(len(shading), -1).astype(np.float64)
    patterns = np.linalg.eigh(flat.T @ flat)[1][:, : -BOUNCE_RANK - 1 : -1].T
    return flat @ patterns.T, patterns.reshape(-1, *shading.shape[1:])


def spread(values: np.ndarray, sparse: Surface, surface: Surface, mask: np.ndarray) -> np.ndarray:
    """Values (M, K) at every second pixel of every second row, to all pixels of the mask (N, K).

    A joint bilateral filter: neighbours count by their distance in the picture, to the plane of the surface,
    and between normals, so that noise goes and an arm's light does not spill on the body behind it.

    sparse: Surface of the M. surface: Surface of the N. mask: (H, W) bool.
    """
    coarse = mask[::2, ::2]
    reach = 2
    index = np.pad(
        np.where(coarse, np.cumsum(coarse).reshape(coarse.shape) - 1, -1), reach, constant_values=-1
    )
    rows, columns = np.nonzero(mask)
    total, weights = np.zeros((len(surface), values.shape[1])), np.zeros((len(surface), 1))
    for down in range(-reach, reach + 1):
        for across in range(-reach, reach + 1):
            row, column = rows // 2 + down, columns // 2 + across
            at = index[row + reach, column + reach]
            there = np.flatnonzero(at >= 0)
            at = at[there]
            apart = (2 * row[there] - rows[there]) ** 2 + (2 * column[there] - columns[there]) ** 2
            offset = ((sparse.position[at] - surface.position[there]) * surface.normal[there]).sum(axis=1)
            turn = 1 - (sparse.normal[at] * surface.normal[there]).sum(axis=1)
            weight = np.exp(-apart / 8 - (offset / PLANE) ** 2 - turn / TURN)[:, None] + 1e-12
            total[there] += weight * values[at]
            weights[there] += weight
    return total / weights.clip(1e-12)


def _place(surface: Surface) -> np.ndarray:
    """Where points are and which way they face (N, 6): a cache point must lie on the same side of a cloth."""
    return np.concatenate([surface.position / NEAR, surface.normal], axis=1)


def _transfer(count: int, source: np.ndarray, hits: Surface, tree: KDTree) -> list[csr_matrix]:
    """For each colour a matrix (count, cache points) from the cache's irradiance to that of the sources."""
    nearest = tree.query(_place(hits))[1]
    albedo = (hits.albedo / np.prod(STRATA)).astype(np.float32)
    return [csr_matrix((colour, (source, nearest)), shape=(count, tree.n)) for colour in albedo.T]
