"""A figure: one static, posed, coloured surface that stands on the stage."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Albedo = Callable[[np.ndarray, np.ndarray], np.ndarray]
Detail = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Figure:
    """A person ready to be rendered.

    vertices: (V, 3) float32 metres, y up, facing +z, the lowest point at y = 0, pelvis about x = z = 0.
    faces: (F, 3) int32 vertex indices, counter-clockwise seen from outside.
    normals: (V, 3) float32 unit shading normals; a vertex is repeated where the surface has a crease.
    albedo: (face index (N,), barycentric (N, 3)) -> (N, 3) float32 linear Rec.709 in [0, 1].
    name: what the records call it.
    detail: a normal map: (face index (N,), barycentric (N, 3)) -> (N, 3) directions in tangent space, whose
        z is the shading normal's; None if the figure has none.
    tangents: (F, 3, 4) float32 of each corner, as `normalmaps.tangents` makes them; None where detail is.
    regions: (F,) uint8 of each face, an index into `records.REGIONS`; None if nobody knows.
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    albedo: Albedo
    name: str
    detail: Detail | None = None
    tangents: np.ndarray | None = None
    regions: np.ndarray | None = None


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area-weighted unit normals (V, 3) of a mesh; a vertex without area gets +y."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    normals = np.stack(
        [sum(np.bincount(faces[:, k], area[:, axis], len(vertices)) for k in range(3)) for axis in range(3)],
        axis=1,
    )
    return unit(normals)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) scaled to length 1; the zero vector becomes +y."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), np.array([0.0, 1.0, 0.0]))


def standing(vertices: np.ndarray) -> np.ndarray:
    """Vertices (V, 3) moved so that the lowest is at y = 0, the middle of their box at x = z = 0."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return vertices - [(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2]


def interpolate(values: np.ndarray, faces: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Vertex values (V, C) at surface points: faces (N, 3) vertex indices, barycentric (N, 3) -> (N, C)."""
    corners = values[faces]
    return (
        corners[:, 0] * barycentric[:, :1]
        + corners[:, 1] * barycentric[:, 1:2]
        + corners[:, 2] * barycentric[:, 2:]
    )


def joined(textures: list[Albedo], face_counts: list[int]) -> Albedo:
    """One albedo, or one normal map, for meshes whose faces follow one another."""
    ends = np.cumsum(face_counts)

    def texture(face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        owner = np.searchsorted(ends, face, side="right")
        values = np.empty((len(face), 3), np.float32)
        for k in np.unique(owner):
            mine = owner == k
            values[mine] = textures[k](face[mine] - (ends[k] - face_counts[k]), barycentric[mine])
        return values

    return texture
