"""Normal maps in tangent space (glTF 2.0, section 3.9.3).

+X points to the right of the texture, +Y up in the texture, +Z out of the surface.
"""

import numpy as np

from shadow.lightstage.figure import normalize

MIN_TANGENT = 1e-6  # length below which a tangent has no direction


def tangents(vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Return the tangents of MikkTSpace (Mikkelsen 2008), for which normal maps are baked.

    A tangent is the mean over the faces at a vertex, weighted by their angles there. Faces with a mirrored
    texture have a mean of their own. `vertices`, `normals`: (V, 3); normals are unit vectors. `faces`: (F, 3)
    vertex indices. `uv`: (V, 2) texture coordinates, v up.

    Returns (F, 3, 4) float32. For each corner: the unit direction of increasing u, or zero where the texture
    has no area; and the sign s such that v increases along s (normal × tangent).
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
        first, second = (normalize(corners[:, (corner + k) % 3] - corners[:, corner]) for k in (1, 2))
        angle = np.arccos((first * second).sum(axis=1, keepdims=True).clip(-1, 1))
        flat = np.where(length > 0, flat / np.where(length > 0, length, 1), 0) * angle
        for axis in range(3):
            total[:, axis] += np.bincount(group[:, corner], flat[:, axis], len(total))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    total = np.where(length > MIN_TANGENT, total / np.maximum(length, MIN_TANGENT), 0)
    signs = np.broadcast_to(np.where(sign < 0, -1.0, 1.0)[:, None, None], (*faces.shape, 1))
    return np.concatenate([total[group], signs], axis=2).astype(np.float32)


def apply_normal_map(normals: np.ndarray, tangent: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return the unit normals (N, 3) that the directions `directions` (N, 3) of a normal map describe.

    `tangent` (N, 4) are those of `tangents`. A normal without a tangent does not change.
    """
    along = tangent[:, :3] - normals * (tangent[:, :3] * normals).sum(axis=1, keepdims=True)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    known = length > MIN_TANGENT
    along = along / np.maximum(length, MIN_TANGENT)
    across = np.cross(normals, along) * np.where(tangent[:, 3:] < 0, -1.0, 1.0)
    turned = directions[:, :1] * along + directions[:, 1:2] * across + directions[:, 2:] * normals
    return np.where(known, normalize(turned), normals)


def decode_normal_map(texels: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """Decode the 8-bit texels (H, W, 3) of a normal map to directions (H, W, 3), float32, with z > 0.

    `scale` multiplies x and y (glTF's normalTexture.scale).
    """
    directions = texels.astype(np.float32) * np.float32(2 / 255) - 1
    directions[..., :2] *= scale
    # JPEG compression and bilinear sampling may make z negative, but normals point out of the surface.
    directions[..., 2] = directions[..., 2].clip(1e-3)
    return directions
