"""A figure in front of the camera, and ray casting by Embree."""

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from shadow.lightstage.figure import Figure
from shadow.lightstage.normalmaps import apply_normal_map

OFFSET = 0.002  # metres from the surface at which secondary rays start, so that they do not hit it


@dataclass(frozen=True)
class Surface:
    """N points on the figure, on the side from which the ray came.

    Arrays are (N, 3) in the camera frame, except for `region`.
    """

    position: np.ndarray  # metres
    geometric: np.ndarray  # unit normal of the triangle
    normal: np.ndarray  # unit shading normal: interpolated, with the normal map applied
    albedo: np.ndarray  # linear Rec.709 in [0, 1]
    region: np.ndarray | None = None  # (N,) uint8, see `Figure.regions`

    def __len__(self) -> int:
        return len(self.position)

    def take(self, index: np.ndarray) -> "Surface":
        """Return the points that an index or a mask selects."""
        region = None if self.region is None else self.region[index]
        return Surface(
            self.position[index], self.geometric[index], self.normal[index], self.albedo[index], region
        )

    def facing(self, lights: np.ndarray) -> np.ndarray:
        """Return which of the lights (D, 3) each point faces, (N, D) bool.

        Both normals have to face the light, so that interpolated normals do not leak light through a coarse
        surface.
        """
        return (self.geometric @ lights.T > 0) & (self.normal @ lights.T > 0)


class Scene:
    """A figure in the frame of a camera at `position` (3,), with the rotation (3, 3) from world to camera."""

    def __init__(self, figure: Figure, rotation: np.ndarray, position: np.ndarray) -> None:
        self.figure = figure
        self._vertices = ((figure.vertices - position) @ rotation.T).astype(np.float32)
        self._normals = figure.normals @ rotation.T
        self._rotation = rotation
        self._embree = EmbreeScene()
        TriangleMesh(self._embree, self._vertices[figure.faces])

    def trace(self, origins: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, Surface]:
        """Trace rays (N, 3) from `origins` (N, 3): return which rays hit (N,), and the nearest hits."""
        hit = self._embree.run(origins.astype(np.float32), rays.astype(np.float32), output=True)
        is_hit = hit["primID"] >= 0
        face, u, v = hit["primID"][is_hit], hit["u"][is_hit], hit["v"][is_hit]
        barycentric = np.stack([1 - u - v, u, v], axis=1)
        triangle = self.figure.faces[face]
        corners = self._vertices[triangle]
        geometric = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        geometric /= np.linalg.norm(geometric, axis=1, keepdims=True).clip(1e-12)
        normal = np.einsum("nk,nkc->nc", barycentric, self._normals[triangle])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = np.where(length > 1e-6, normal / length.clip(1e-6), geometric)
        normal = self._apply_normal_map(normal, face, barycentric)
        # Surfaces are two-sided: the inner side, seen through an open hem, is shaded like the outer one.
        flip = np.where((geometric * rays[is_hit]).sum(axis=1) > 0, -1.0, 1.0)[:, None]
        geometric, normal = geometric * flip, normal * flip
        position = np.einsum("nk,nkc->nc", barycentric, corners)
        region = None if self.figure.regions is None else self.figure.regions[face]
        return is_hit, Surface(position, geometric, normal, self.figure.albedo(face, barycentric), region)

    def _apply_normal_map(self, normal: np.ndarray, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Apply the figure's normal map, if it has one, to unit normals (N, 3) at these points."""
        if self.figure.normal_map is None or self.figure.tangents is None:
            return normal
        tangent = np.einsum("nk,nkc->nc", barycentric, self.figure.tangents[face])
        tangent[:, :3] = tangent[:, :3] @ self._rotation.T
        return apply_normal_map(normal, tangent, self.figure.normal_map(face, barycentric))

    def visibility(self, surface: Surface, lights: np.ndarray) -> np.ndarray:
        """Return which of the lights (D, 3) each point faces and sees, (N, D) bool."""
        lit = surface.facing(lights)
        point, light = np.nonzero(lit)
        origins = (surface.position + OFFSET * surface.geometric).astype(np.float32)[point]
        occluded = self._embree.run(origins, lights.astype(np.float32)[light], query="OCCLUDED")
        lit[point, light] = occluded != 0  # Embree sets the geometry of an occluded ray to 0
        return lit

    def gather(
        self, surface: Surface, strata: tuple[int, int], rng: np.random.Generator
    ) -> tuple[np.ndarray, Surface]:
        """Cast cosine-distributed rays from each point over its hemisphere.

        Returns the index (H,) of the point of each ray that hits, and the H hits. `strata` are the steps in
        cosine and in azimuth, whose product is the number of rays of a point. Rays that miss the figure or
        point into it are left out.
        """
        rays = _cosine_rays(surface.normal, strata, rng)
        outward = np.einsum("nrc,nc->nr", rays, surface.geometric) > 0
        source = np.nonzero(outward)[0]
        origins = (surface.position + OFFSET * surface.geometric)[source]
        is_hit, hits = self.trace(origins, rays[outward])
        return source[is_hit], hits


def _cosine_rays(normals: np.ndarray, strata: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Draw cosine-distributed directions (N, rays, 3) around normals (N, 3).

    Stratified samples of the square are mapped to the disc and lifted to the hemisphere (Malley's method;
    Pharr et al., Physically Based Rendering, 13.6.3).
    """
    steps = np.stack(np.meshgrid(*map(np.arange, strata), indexing="ij"), axis=-1).reshape(-1, 2)
    square = (steps + rng.random((len(normals), len(steps), 2), np.float32)) / strata
    radius, angle = np.sqrt(square[..., :1]), 2 * np.pi * square[..., 1:]
    # Two tangents, from any vector that is not parallel to the normal.
    across = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    tangent = np.cross(normals, across)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    bitangent = np.cross(normals, tangent)
    return (
        radius * np.cos(angle) * tangent[:, None]
        + radius * np.sin(angle) * bitangent[:, None]
        + np.sqrt(1 - square[..., :1]) * normals[:, None]
    )
