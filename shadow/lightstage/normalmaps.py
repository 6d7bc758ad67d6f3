"""Normal maps: what a sculptor carved finer than the mesh, kept as directions in the tangent space of its
texture (glTF 2.0, section 3.9.3: +X to the right of the texture, +Y up, +Z out of the surface).
"""

import numpy as np

from shadow.lightstage.figure import unit

UNTANGENTIAL = 1e-6  # length of a tangent below which the texture says nothing of a direction


def tangents(vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Tangents as MikkTSpace makes them (Mikkelsen 2008), in which normal maps are baked.

    Each is the mean of those of the faces about a vertex, by their angles there; faces whose texture is
    mirrored have a mean of their own.

    vertices, normals: (V, 3), normals unit. faces: (F, 3). uv: (V, 2), v up.
    Returns (F, 3, 4) float32, for each corner: the unit direction in which u grows, or zero where the texture
    has no area; and the sign by which normal × tangent is the direction in which v grows.
    """
    corners, texture = vertices[faces].astype(np.float64), uv[faces].astype(np.float64)
    along, across = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    (du1, dv1), (du2, dv2) = (texture[:, k].T - texture[:, 0].T for k in (1, 2))
    sign = np.sign(du1 * dv2 - du2 * dv1)
    grows = (along * dv2[:, None] - across * dv1[:, None]) * sign[:, None]
    group = faces + len(vertices) * (sign < 0)[:, None]
    total = np.zeros((2 * len(vertices), 3))
    for corner in range(3):
        normal = normals[faces[:, corner]]
        flat = grows - normal * (grows * normal).sum(axis=1, keepdims=True)
        length = np.linalg.norm(flat, axis=1, keepdims=True)
        first, second = (unit(corners[:, (corner + k) % 3] - corners[:, corner]) for k in (1, 2))
        angle = np.arccos((first * second).sum(axis=1, keepdims=True).clip(-1, 1))
        flat = np.where(length > 0, flat / np.where(length > 0, length, 1), 0) * angle
        for axis in range(3):
            total[:, axis] += np.bincount(group[:, corner], flat[:, axis], len(total))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    total = np.where(length > UNTANGENTIAL, total / np.maximum(length, UNTANGENTIAL), 0)
    signs = np.broadcast_to(np.where(sign < 0, -1.0, 1.0)[:, None, None], (*faces.shape, 1))
    return np.concatenate([total[group], signs], axis=2).astype(np.float32)


def tilted(normals: np.ndarray, tangent: np.ndarray, detail: np.ndarray) -> np.ndarray:
    """Unit normals (N, 3) turned by tangent-space directions `detail` (N, 3), in the tangents (N, 4) of
    `tangents`. Where there is no tangent, normals stay as they are."""
    along = tangent[:, :3] - normals * (tangent[:, :3] * normals).sum(axis=1, keepdims=True)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    known = length > UNTANGENTIAL
    along = along / np.maximum(length, UNTANGENTIAL)
    across = np.cross(normals, along) * np.where(tangent[:, 3:] < 0, -1.0, 1.0)
    turned = detail[:, :1] * along + detail[:, 1:2] * across + detail[:, 2:] * normals
    return np.where(known, unit(turned), normals)


def decoded(texels: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """Texels (H, W, 3) of a normal map as 8 bits, to directions (H, W, 3) float32, z > 0 out of the surface;
    `scale` stretches their x and y (glTF's normalTexture.scale)."""
    directions = texels.astype(np.float32) * np.float32(2 / 255) - 1
    directions[..., :2] *= scale
    # JPEG and bilinear sampling may bring z to zero or below: a map describes what is seen from outside.
    directions[..., 2] = directions[..., 2].clip(1e-3)
    return directions
