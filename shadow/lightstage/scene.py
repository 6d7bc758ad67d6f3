"""A figure before the camera, and the rays that are cast at it, through Embree."""

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from shadow.lightstage.figure import Figure
from shadow.lightstage.normalmaps import tilted

OFFSET = 0.002  # metres: rays leave from above the surface, or they would hit it


@dataclass(frozen=True)
class Surface:
    """Points on the figure, each on the side that the ray came from. Arrays are (N, 3), camera frame, unless
    they say otherwise."""

    position: np.ndarray  # metres
    geometric: np.ndarray  # unit normal of the triangle
    normal: np.ndarray  # unit shading normal: smooth, and turned by the figure's normal map
    albedo: np.ndarray  # linear Rec.709 in [0, 1]
    region: np.ndarray | None = None  # (N,) uint8, as of Figure

    def __len__(self) -> int:
        return len(self.position)

    def take(self, index: np.ndarray) -> "Surface":
        """The points of an index or a mask."""
        region = None if self.region is None else self.region[index]
        return Surface(
            self.position[index], self.geometric[index], self.normal[index], self.albedo[index], region
        )

    def facing(self, lights: np.ndarray) -> np.ndarray:
        """Which of the lights (D, 3) each point turns to, (N, D) bool: by its geometric and its shading
        normal, so that smooth normals cannot leak light through a coarse surface."""
        return (self.geometric @ lights.T > 0) & (self.normal @ lights.T > 0)


class Scene:
    """The figure in the frame of a camera at `position` (3,); `rotation` (3, 3) is from world to camera."""

    def __init__(self, figure: Figure, rotation: np.ndarray, position: np.ndarray) -> None:
        self.figure = figure
        self._vertices = ((figure.vertices - position) @ rotation.T).astype(np.float32)
        self._normals = figure.normals @ rotation.T
        self._rotation = rotation
        self._embree = EmbreeScene()
        TriangleMesh(self._embree, self._vertices[figure.faces])

    def trace(self, origins: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, Surface]:
        """Nearest hits of rays (N, 3) from `origins` (N, 3): which rays hit (N,), and the Surface there."""
        hit = self._embree.run(origins.astype(np.float32), rays.astype(np.float32), output=True)
        found = hit["primID"] >= 0
        face, u, v = hit["primID"][found], hit["u"][found], hit["v"][found]
        barycentric = np.stack([1 - u - v, u, v], axis=1)
        triangle = self.figure.faces[face]
        corners = self._vertices[triangle]
        geometric = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        geometric /= np.linalg.norm(geometric, axis=1, keepdims=True).clip(1e-12)
        normal = np.einsum("nk,nkc->nc", barycentric, self._normals[triangle])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = np.where(length > 1e-6, normal / length.clip(1e-6), geometric)
        normal = self._detailed(normal, face, barycentric)
        # A surface has two sides: the far one of a shell, seen through an open hem, is lit as the near one.
        flip = np.where((geometric * rays[found]).sum(axis=1) > 0, -1.0, 1.0)[:, None]
        geometric, normal = geometric * flip, normal * flip
        position = np.einsum("nk,nkc->nc", barycentric, corners)
        region = None if self.figure.regions is None else self.figure.regions[face]
        return found, Surface(position, geometric, normal, self.figure.albedo(face, barycentric), region)

    def _detailed(self, normal: np.ndarray, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Unit normals (N, 3) turned as the figure's normal map, if it has one, says at these points."""
        if self.figure.detail is None or self.figure.tangents is None:
            return normal
        tangent = np.einsum("nk,nkc->nc", barycentric, self.figure.tangents[face])
        tangent[:, :3] = tangent[:, :3] @ self._rotation.T
        return tilted(normal, tangent, self.figure.detail(face, barycentric))

    def visibility(self, surface: Surface, lights: np.ndarray) -> np.ndarray:
        """Which of the lights (D, 3) each point of a Surface faces and sees: (N, D) bool."""
        lit = surface.facing(lights)
        point, light = np.nonzero(lit)
        origins = (surface.position + OFFSET * surface.geometric).astype(np.float32)[point]
        occluded = self._embree.run(origins, lights.astype(np.float32)[light], query="OCCLUDED")
        lit[point, light] = occluded != 0  # Embree sets the geometry of an occluded ray to 0
        return lit

    def gather(
        self, surface: Surface, strata: tuple[int, int], rng: np.random.Generator
    ) -> tuple[np.ndarray, Surface]:
        """Rays from each point over its hemisphere, by the cosine: (source (H,), Surface hit (H)).

        `strata` (steps of the cosine, steps around) multiply to the rays of a point. Rays that leave the
        figure, or go into it, are not among the hits.
        """
        rays = _cosine_rays(surface.normal, strata, rng)
        outward = np.einsum("nrc,nc->nr", rays, surface.geometric) > 0
        source = np.nonzero(outward)[0]
        origins = (surface.position + OFFSET * surface.geometric)[source]
        found, hits = self.trace(origins, rays[outward])
        return source[found], hits


def _cosine_rays(normals: np.ndarray, strata: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Directions (N, rays, 3) around normals (N, 3), as dense as their cosine: the square, in strata, to the
    disc, lifted to the hemisphere (Malley's method; Pharr et al., Physically Based Rendering, 13.6.3)."""
    steps = np.stack(np.meshgrid(*map(np.arange, strata), indexing="ij"), axis=-1).reshape(-1, 2)
    square = (steps + rng.random((len(normals), len(steps), 2), np.float32)) / strata
    radius, angle = np.sqrt(square[..., :1]), 2 * np.pi * square[..., 1:]
    # Two tangents: any vector that is not near the normal gives them.
    across = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    tangent = np.cross(normals, across)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    bitangent = np.cross(normals, tangent)
    return (
        radius * np.cos(angle) * tangent[:, None]
        + radius * np.sin(angle) * bitangent[:, None]
        + np.sqrt(1 - square[..., :1]) * normals[:, None]
    )
