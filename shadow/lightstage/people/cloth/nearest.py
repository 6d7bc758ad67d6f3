"""Signed distances of points to a triangle mesh, which say whether cloth is inside the body.

During the simulation cloth collides with tangent planes, which is fast and nearly exact; at the end the
nearest point of the triangles counts. Kernels here are not called by kernels of other files, since numba's
cache of a kernel does not notice changes in other files.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from shadow.lightstage.figure import vertex_normals
from shadow.lightstage.mesh import adjacency
from shadow.lightstage.people.cloth.solver import compiled

MIN_INSIDE_COSINE = 0.4  # between the inward normal and the direction from the surface to a point inside


@dataclass(frozen=True)
class MeshSurface:
    """A mesh whose triangles face outward. points: (P, 3) in metres. faces: (F, 3)."""

    points: np.ndarray
    faces: np.ndarray

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normals (P, 3) of the vertices."""
        return vertex_normals(self.points, self.faces)

    @cached_property
    def around(self) -> tuple[np.ndarray, np.ndarray]:
        """The faces at each vertex and its neighbours, as the arrays indptr (P + 1,) and indices of a CSR
        matrix."""
        count = len(self.points)
        first, ring = neighbours(self.faces, count)
        at = csr_matrix((np.ones(len(ring), np.int32), ring, first), (count, count))
        corner = (np.ones(self.faces.size, np.int32), (self.faces.ravel(), np.arange(self.faces.size) // 3))
        own = csr_matrix(corner, (count, len(self.faces)))
        near = (own + at @ own).tocsr()
        return near.indptr.astype(np.int32), near.indices.astype(np.int32)

    @cached_property
    def used(self) -> np.ndarray:
        """Indices of the points that belong to a face, in rising order."""
        return np.unique(self.faces)

    def heights(self, x: np.ndarray, near: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
        """Return the signed distances (N,) in metres of points x (N, 3), negative inside the surface.

        Also returns the nearest points of the surface (N, 3), and its unit normals there (N, 3). near (N,): a
        vertex close to each point, whose faces and neighbours' faces are searched; by default the
        nearest that belongs to a face.
        """
        if near is None:
            near = self.used[cKDTree(self.points[self.used]).query(x)[1]]
        first, face = self.around
        columns = (x, self.points, self.normals)
        x, points, normals = (np.ascontiguousarray(column, np.float32) for column in columns)
        return _heights(x, near.astype(np.int32), points, normals, self.faces.astype(np.int32), first, face)


def neighbours(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the neighbours of each vertex, as indptr (count + 1,) and indices of a CSR matrix."""
    graph = adjacency(faces, count)
    return graph.indptr.astype(np.int32), graph.indices.astype(np.int32)


@compiled
def _heights(x, near, points, normals, faces, first, around):
    height, foot, up = np.empty(len(x), np.float32), np.empty_like(x), np.empty_like(x)
    weight, here = np.empty(3, np.float32), np.empty(3, np.float32)
    for i in range(len(x)):
        best = np.float32(1e9)
        for r in range(first[near[i]], first[near[i] + 1]):
            a, b, c = faces[around[r], 0], faces[around[r], 1], faces[around[r], 2]
            _closest(x[i], points[a], points[b], points[c], weight)
            square = np.float32(0)
            for k in range(3):
                here[k] = weight[0] * points[a, k] + weight[1] * points[b, k] + weight[2] * points[c, k]
                square += (x[i, k] - here[k]) ** 2
            if square < best:
                best = square
                for k in range(3):
                    foot[i, k] = here[k]
                    up[i, k] = (
                        weight[0] * normals[a, k] + weight[1] * normals[b, k] + weight[2] * normals[c, k]
                    )
        out, length = np.float32(0), np.float32(1e-12)
        for k in range(3):
            out += (x[i, k] - foot[i, k]) * up[i, k]
            length += up[i, k] * up[i, k]
        # Beyond a boundary the direction to the surface is tangential: such points are not inside.
        away = np.sqrt(best)
        height[i] = -away if out < -MIN_INSIDE_COSINE * away * np.sqrt(length) else away
        for k in range(3):
            up[i, k] /= np.sqrt(length)
    return height, foot, up


@compiled
def _closest(p, a, b, c, weight):
    """Write the barycentric coordinates of the point of a triangle nearest to p into `weight`.

    Source: Ericson, Real-Time Collision Detection, 5.1.5.
    """
    d1, d2, d3 = np.float32(0), np.float32(0), np.float32(0)
    d4, d5, d6 = np.float32(0), np.float32(0), np.float32(0)
    for k in range(3):
        ab, ac = b[k] - a[k], c[k] - a[k]
        d1 += ab * (p[k] - a[k])
        d2 += ac * (p[k] - a[k])
        d3 += ab * (p[k] - b[k])
        d4 += ac * (p[k] - b[k])
        d5 += ab * (p[k] - c[k])
        d6 += ac * (p[k] - c[k])
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    tiny = np.float32(1e-20)
    u, v = np.float32(0), np.float32(0)
    if d1 <= 0 and d2 <= 0:
        pass
    elif d3 >= 0 and d4 <= d3:
        u = np.float32(1)
    elif d6 >= 0 and d5 <= d6:
        v = np.float32(1)
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        u = d1 / (d1 - d3 + tiny)
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        v = d2 / (d2 - d6 + tiny)
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        v = (d4 - d3) / ((d4 - d3) + (d5 - d6) + tiny)
        u = 1 - v
    else:
        scale = np.float32(1) / (va + vb + vc + tiny)
        u, v = vb * scale, vc * scale
    weight[0], weight[1], weight[2] = 1 - u - v, u, v
