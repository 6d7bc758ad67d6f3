"""Figures: static, posed, coloured surfaces that stand on the stage."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Albedo = Callable[[np.ndarray, np.ndarray], np.ndarray]
NormalMap = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Figure:
    """A person, ready to be rendered."""

    # (V, 3) float32 metres, y up, facing +z, the lowest point at y = 0, pelvis near x = z = 0.
    vertices: np.ndarray
    faces: np.ndarray  # (F, 3) int32 vertex indices, counter-clockwise seen from outside
    # (V, 3) float32 unit shading normals; a vertex is repeated where the surface has a crease.
    normals: np.ndarray
    # (face index (N,), barycentric (N, 3)) -> (N, 3) float32, linear Rec.709 in [0, 1].
    albedo: Albedo
    name: str  # in the records
    # (face index (N,), barycentric (N, 3)) -> (N, 3) directions in tangent space, whose z is along the
    # shading normal; None if the figure has none.
    normal_map: NormalMap | None = None
    # (F, 3, 4) float32 of the corners, see `normalmaps.tangents`; None without a normal map.
    tangents: np.ndarray | None = None
    regions: np.ndarray | None = None  # (F,) uint8 indices into `records.REGIONS`; None if they are unknown
    # Draws the albedo with other fabrics and colours of the clothes; None if these are part of the mesh.
    redraw_fabrics: Callable[[np.random.Generator], Albedo] | None = None


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the area-weighted unit normals (V, 3) of a mesh; a vertex without area gets +y."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    normals = np.stack(
        [sum(np.bincount(faces[:, k], area[:, axis], len(vertices)) for k in range(3)) for axis in range(3)],
        axis=1,
    )
    return normalize(normals)


def outwards(vertices: np.ndarray, faces: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Return faces, all reversed if they point to `inside`: a point (3,), or one for each vertex (V, 3)."""
    away = (vertex_normals(vertices, faces) * (vertices - inside)).sum()
    return faces[:, ::-1] if away < 0 else faces


def normalize(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (..., 3) scaled to length 1; the zero vector becomes +y."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), np.array([0.0, 1.0, 0.0]))


def stand_on_floor(vertices: np.ndarray) -> np.ndarray:
    """Translate vertices (V, 3): the lowest to y = 0, the centre of their bounding box to x = z = 0."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return vertices - [(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2]


def interpolate(values: np.ndarray, faces: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Interpolate vertex values (V, C) at N surface points.

    faces: (N, 3) vertex indices of the face of each point. barycentric: (N, 3). Returns (N, C).
    """
    corners = values[faces]
    return (
        corners[:, 0] * barycentric[:, :1]
        + corners[:, 1] * barycentric[:, 1:2]
        + corners[:, 2] * barycentric[:, 2:]
    )


def bilinear(texels: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Sample texels (H, W, C) bilinearly at uv (N, 2), with v up from the bottom row; the texture repeats."""
    height, width = texels.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right, down = (x - column).astype(np.float32)[:, None], (y - row).astype(np.float32)[:, None]

    def at(row: np.ndarray, column: np.ndarray) -> np.ndarray:
        return texels[row % height, column % width]

    upper = at(row, column) * (1 - right) + at(row, column + 1) * right
    lower = at(row + 1, column) * (1 - right) + at(row + 1, column + 1) * right
    return upper * (1 - down) + lower * down


def flat_normals(face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Return the directions of a flat normal map, for a part of a figure without one."""
    return np.broadcast_to(np.array([0, 0, 1], np.float32), (len(face), 3))


def joined(textures: list[Albedo], face_counts: list[int]) -> Albedo:
    """Return the albedo or normal map of concatenated meshes with these textures and numbers of faces."""
    ends = np.cumsum(face_counts)

    def texture(face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        owner = np.searchsorted(ends, face, side="right")
        values = np.empty((len(face), 3), np.float32)
        for k in np.unique(owner):
            mine = owner == k
            values[mine] = textures[k](face[mine] - (ends[k] - face_counts[k]), barycentric[mine])
        return values

    return texture
