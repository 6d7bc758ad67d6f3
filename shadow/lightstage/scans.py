"""Scans and other meshes as figures: whoever owns textured people lights them on the same stage."""

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image

from shadow.lightstage.figure import Albedo, Detail, Figure, interpolate, joined, standing, unit
from shadow.lightstage.normalmaps import decoded, tangents

GREY = 0.5  # linear albedo of a mesh that brings no colour
STORED = "_TANGENT"  # what trimesh, which drops glTF's TANGENT, keeps as an attribute of the user's own


def load(path: str | Path) -> Figure:
    """A mesh file as a figure.

    path: any file that trimesh reads (OBJ, PLY, GLB, ...), in metres, y up, the person facing +z.
    The base colour texture is read bilinearly and taken as sRGB; without one, vertex colours (sRGB), a plain
    material colour (linear in glTF, sRGB elsewhere), or a 0.5 grey. Smooth normals stored in the file are
    kept, and so is the normal map of a glTF file (.glb, .gltf), in the file's tangents or, where it has none,
    those of MikkTSpace. The figure is moved to stand on y = 0 with the middle of its bounding box at
    x = z = 0.
    Raises ValueError, naming the path, for a file that cannot be read or holds no triangles.
    """
    path = Path(path)
    try:
        scene, scales = _read(path)
        # Graph nodes carry the placement of each geometry.
        meshes = [
            _placed(scene.geometry[geometry], transform)
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
    counts = [len(mesh.faces) for mesh in meshes]
    details = [_mesh_detail(mesh, scales) for mesh in meshes]
    mapped = any(detail is not None for detail in details)
    return Figure(
        vertices=standing(vertices).astype(np.float32),
        faces=faces.astype(np.int32),
        normals=np.concatenate([unit(mesh.vertex_normals) for mesh in meshes]).astype(np.float32),
        albedo=joined([_mesh_albedo(mesh) for mesh in meshes], counts),
        name=path.stem,
        detail=joined([detail or _flat for detail in details], counts) if mapped else None,
        tangents=np.concatenate([_mesh_tangents(mesh) for mesh in meshes]) if mapped else None,
    )


def _read(path: Path) -> tuple[trimesh.Scene, dict[str, float]]:
    """The meshes of a file, and the scales of the normal maps of a glTF file by the names of their materials.

    trimesh drops both the tangents and the scales: the former are renamed on the way to it, and materials are
    numbered, since their names need not differ.
    """
    data, kind = path.read_bytes(), path.suffix.lower()
    if kind == ".glb":
        length = struct.unpack_from("<I", data, 12)[0]
        header, binary = json.loads(data[20 : 20 + length]), data[20 + length :]
    elif kind == ".gltf":
        header, binary = json.loads(data), None
    else:
        return trimesh.load_scene(path, process=False), {}
    scales = {}
    for number, material in enumerate(header.get("materials", [])):
        material["name"] = f"{number} {material.get('name', '')}"
        texture = material.get("normalTexture", {})
        scales[material["name"]] = texture.get("scale", 1.0)
        if texture.get("texCoord", 0):
            raise ValueError("expected a normal map on the first texture coordinates (texCoord 0)")
    for mesh in header.get("meshes", []):
        for primitive in mesh["primitives"]:
            if "TANGENT" in primitive["attributes"]:
                primitive["attributes"][STORED] = primitive["attributes"].pop("TANGENT")
    text = json.dumps(header).encode()
    if binary is not None:
        text += b" " * (-len(text) % 4)
        whole = 20 + len(text) + len(binary)
        text = data[:8] + struct.pack("<II", whole, len(text)) + data[16:20] + text + binary
    resolver = trimesh.resolvers.FilePathResolver(str(path))
    scene = trimesh.load_scene(io.BytesIO(text), file_type=kind[1:], resolver=resolver, process=False)
    return scene, scales


def _placed(mesh: trimesh.Trimesh, transform: np.ndarray) -> trimesh.Trimesh:
    """A copy of the mesh where its node puts it, its stored tangents too."""
    placed = mesh.copy(include_cache=True)
    if (stored := placed.vertex_attributes.get(STORED)) is not None:
        turned = np.asarray(stored, np.float64).copy()
        turned[:, :3] = unit(turned[:, :3] @ transform[:3, :3].T)
        turned[:, 3] *= np.sign(np.linalg.det(transform[:3, :3]))  # a mirror image has the other hand
        placed.vertex_attributes[STORED] = turned
    return placed.apply_transform(transform)


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """sRGB-encoded values in [0, 1] as linear float32."""
    encoded = np.asarray(encoded, np.float32)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def _mesh_albedo(mesh: trimesh.Trimesh) -> Albedo:
    faces = np.asarray(mesh.faces)
    visual: Any = mesh.visual
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


def _mesh_detail(mesh: trimesh.Trimesh, scales: dict[str, float]) -> Detail | None:
    """The mesh's normal map, or None."""
    visual: Any = mesh.visual
    material: Any = getattr(visual, "material", None)
    texture, uv = getattr(material, "normalTexture", None), getattr(visual, "uv", None)
    if not isinstance(texture, Image.Image) or uv is None:
        return None
    texels = decoded(np.asarray(texture.convert("RGB")), scales.get(material.name, 1.0))
    faces = np.asarray(mesh.faces)
    return lambda face, barycentric: _bilinear(texels, interpolate(uv, faces[face], barycentric))


def _flat(face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """The normal map of a mesh without one."""
    return np.broadcast_to(np.array([0, 0, 1], np.float32), (len(face), 3))


def _mesh_tangents(mesh: trimesh.Trimesh) -> np.ndarray:
    """Tangents (F, 3, 4) of the mesh's corners: those stored, or made; zero without texture coordinates."""
    faces, uv = np.asarray(mesh.faces), getattr(mesh.visual, "uv", None)
    if (stored := mesh.vertex_attributes.get(STORED)) is not None:
        return np.asarray(stored, np.float32)[faces]
    if uv is None:
        return np.zeros((*faces.shape, 4), np.float32)
    return tangents(np.asarray(mesh.vertices), faces, unit(mesh.vertex_normals), uv)


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
