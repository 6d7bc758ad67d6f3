"""Bounce light: light that the body reflects onto itself, for all lights of the set at once.

A path tracer needs minutes for the lights of one view, although the paths do not depend on the light. Here
the paths are traced once, by final gathering over an irradiance cache (Ward et al. 1988; Jensen 1996). Rays
are cast from each visible point over its hemisphere. Where they hit, the irradiance is that of the nearest of
some thousand cache points. The cache points trace shadow rays to every light, and rays to one another.
tests/shadow/lightstage/test_bounce.py compares the result with Mitsuba's path tracer.
"""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import KDTree

from shadow.data.records import BOUNCE_RANK
from shadow.lightstage.scene import Scene, Surface

STRATA = (4, 8)  # of the 32 rays of a point; Section 3 has 32 samples for each pixel
CACHE_POINTS = 4096  # about 2 cm apart on a person
BOUNCES = 4
# Distance in metres that counts as much as a radian between normals in the lookup of cache points.
METRES_PER_RADIAN = 0.05
PLANE_DISTANCE = 0.01  # metres from a pixel's tangent plane at which a neighbour's weight falls to 1/e
NORMAL_DISTANCE = 0.1  # one minus the cosine between normals at which it falls to 1/e


def indirect_shading(
    scene: Scene, surface: Surface, lights: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Trace the indirect diffuse shading of the N points of a surface of the figure by each light alone.

    `lights`: (D, 3) unit directions to distant lights of intensity 1, which give a surface that faces them
    the shading 1. Returns (N, D, 3) float32, linear Rec.709, >= 0: light after one to four bounces, coloured
    by the albedo of the surfaces that it met. Added to max(N·L, 0) × visibility it gives the path-traced
    shading of Section 3.
    """
    source, hits = scene.gather(surface, STRATA, rng)
    if not len(hits):
        return np.zeros((len(surface), len(lights), 3), np.float32)
    cache = hits.take(rng.choice(len(hits), min(CACHE_POINTS, len(hits)), replace=False))
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


def factorise(shading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the best factors of rank K (Eckart and Young 1936) of bounce light (N, D, 3).

    The factors are (N, K) and (K, D, 3), where K is BOUNCE_RANK.
    """
    flat = shading.reshape(len(shading), -1).astype(np.float64)
    patterns = np.linalg.eigh(flat.T @ flat)[1][:, : -BOUNCE_RANK - 1 : -1].T
    return flat @ patterns.T, patterns.reshape(-1, *shading.shape[1:])


def upsample(values: np.ndarray, sparse: Surface, surface: Surface, mask: np.ndarray) -> np.ndarray:
    """Upsample values (M, K) at every second pixel of every second row to all pixels (N, K) of a mask (H, W).

    This is joint bilateral upsampling: weights depend on the distance in the picture, the distance to the
    tangent plane, and the angle between normals. It removes noise, and light on an arm does not leak to the
    body behind it. `sparse` are the M points, `surface` the N points.
    """
    coarse = mask[::2, ::2]
    reach = 2  # coarse pixels on either side
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
            exponent = -apart / 8 - (offset / PLANE_DISTANCE) ** 2 - turn / NORMAL_DISTANCE
            weight = np.exp(exponent)[:, None] + 1e-12
            total[there] += weight * values[at]
            weights[there] += weight
    return total / weights.clip(1e-12)


def _place(surface: Surface) -> np.ndarray:
    """Return the lookup keys (N, 6) of points: positions and normals, which tell the sides of cloth apart."""
    return np.concatenate([surface.position / METRES_PER_RADIAN, surface.normal], axis=1)


def _transfer(count: int, source: np.ndarray, hits: Surface, tree: KDTree) -> list[csr_matrix]:
    """Return, for each colour channel, the matrix (count, cache points) that maps irradiance of the cache to
    irradiance of the sources."""
    nearest = tree.query(_place(hits))[1]
    albedo = (hits.albedo / np.prod(STRATA)).astype(np.float32)
    return [csr_matrix((colour, (source, nearest)), shape=(count, tree.n)) for colour in albedo.T]
