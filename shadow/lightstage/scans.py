"""Scans and other meshes as figures: whoever owns textured people lights them on the same stage."""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from shadow.lightstage.figure import Albedo, Figure, interpolate, joined, standing, unit

GREY = 0.5  # linear albedo of a mesh that brings no colour


def load(path: str | Path) -> Figure:
    """A mesh file as a figure.

    path: any file that trimesh reads (OBJ, PLY, GLB, ...), in metres, y up, the person facing +z.
    The base colour texture is read bilinearly and taken as sRGB; without one, vertex colours (sRGB), a plain
    material colour (linear in glTF, sRGB elsewhere), or a 0.5 grey. Smooth normals stored in the file are
    kept. The figure is moved to stand on y = 0 with the middle of its bounding box at x = z = 0.
    Raises ValueError, naming the path, for a file that cannot be read or holds no triangles.
    """
    path = Path(path)
    try:
        scene = trimesh.load_scene(path, process=False)
        # Graph nodes carry the placement of each geometry.
        meshes = [
            scene.geometry[geometry].copy(include_cache=True).apply_transform(transform)
            for transform, geometry in (scene.graph[node] for node in scene.graph.nodes_geometry)
        ]
    except Exception as error:  # trimesh's readers raise whatever their parsers do
        raise ValueError(f"path: cannot read a mesh from {path}: {error}") from error
    meshes = [mesh for mesh in meshes if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]
    if not meshes:
        raise ValueError(f"path: expected a mesh with triangles, found none in {path}")
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    if not np.isfinite(vertices).all():
        raise ValueError(f"path: expected finite vertices, found NaN or infinity in {path}")
    first_vertex = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first_vertex, strict=True)])
    return Figure(
        vertices=standing(vertices).astype(np.float32),
        faces=faces.astype(np.int32),
        normals=np.concatenate([unit(mesh.vertex_normals) for mesh in meshes]).astype(np.float32),
        albedo=joined([_mesh_albedo(mesh) for mesh in meshes], [len(mesh.faces) for mesh in meshes]),
        name=path.stem,
    )


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """sRGB-encoded values in [0, 1] as linear float32."""
    encoded = np.asarray(encoded, np.float32)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def _mesh_albedo(mesh: trimesh.Trimesh) -> Albedo:
    faces, visual = np.asarray(mesh.faces), mesh.visual
    material = getattr(visual, "material", None)
    texture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    uv = getattr(visual, "uv", None)
    if isinstance(texture, Image.Image) and uv is not None:
        texels = srgb_to_linear(np.asarray(texture.convert("RGB")) / np.float32(255))
        factor = _factor(material, default=1.0)
        return lambda face, barycentric: _bilinear(texels, interpolate(uv, faces[face], barycentric)) * factor
    if getattr(visual, "kind", None) in ("vertex", "face"):
        colours = srgb_to_linear(visual.vertex_colors[:, :3] / np.float32(255))
        return lambda face, barycentric: interpolate(colours, faces[face], barycentric).astype(np.float32)
    plain = _factor(material, default=GREY)
    return lambda face, barycentric: np.broadcast_to(plain, (len(face), 3)).astype(np.float32)


def _factor(material: object, default: float) -> np.ndarray:
    """The material's plain colour (3,), linear; glTF stores it linear, OBJ's diffuse colour is sRGB."""
    if (factor := getattr(material, "baseColorFactor", None)) is not None:
        return np.asarray(factor[:3], np.float32) / np.float32(255)
    if default == GREY and (diffuse := getattr(material, "diffuse", None)) is not None:
        return srgb_to_linear(np.asarray(diffuse[:3]) / np.float32(255))
    return np.full(3, default, np.float32)


def _bilinear(texels: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Texels (H, W, 3) at uv (N, 2), v up from the bottom row; texture coordinates repeat."""
    height, width = texels.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right, down = (x - column).astype(np.float32)[:, None], (y - row).astype(np.float32)[:, None]

    def at(row: np.ndarray, column: np.ndarray) -> np.ndarray:
        return texels[row % height, column % width]

    upper = at(row, column) * (1 - right) + at(row, column + 1) * right
    lower = at(row + 1, column) * (1 - right) + at(row + 1, column + 1) * right
    return upper * (1 - down) + lower * down
