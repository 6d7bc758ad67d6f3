"""Load scans and other textured meshes of people as figures for the same stage."""

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image

from shadow.lightstage.figure import (
    Albedo,
    Figure,
    NormalMap,
    bilinear,
    flat_normals,
    interpolate,
    joined,
    normalize,
    stand_on_floor,
)
from shadow.lightstage.normalmaps import decode_normal_map, tangents
from shadow.srgb import decode_srgb

GREY = 0.5  # linear albedo of a mesh without colour
TANGENT_ATTRIBUTE = "_TANGENT"  # user-defined attribute: trimesh keeps these, but drops glTF's TANGENT


def load(path: str | Path, normal_map: bool = True) -> Figure:
    """Load a mesh file as a figure: any that trimesh reads (OBJ, PLY, GLB, ...), in metres, y up, facing +z.

    The base colour comes from the texture (sRGB, sampled bilinearly), or else from vertex colours (sRGB), a
    plain material colour (linear in glTF, sRGB elsewhere), or a grey of 0.5. Normals in the file are kept.
    The normal map of a glTF file (.glb, .gltf) is used, unless `normal_map` is false, with the file's
    tangents or, without these, those of MikkTSpace. The figure is moved to stand on y = 0 with the centre of
    its bounding box at x = z = 0. Raises ValueError, which names the path, if the file cannot be read, or has
    no triangles.
    """
    path = Path(path)
    try:
        scene, scales = _read(path)
        # The nodes of the scene graph place the geometries.
        meshes = [
            _transformed(scene.geometry[geometry], transform)
            for transform, geometry in (scene.graph[node] for node in scene.graph.nodes_geometry)
        ]
    except Exception as error:  # trimesh's readers raise many kinds of errors
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
    maps = [_mesh_normal_map(mesh, scales) for mesh in meshes]
    mapped = normal_map and any(each is not None for each in maps)
    return Figure(
        vertices=stand_on_floor(vertices).astype(np.float32),
        faces=faces.astype(np.int32),
        normals=np.concatenate([normalize(mesh.vertex_normals) for mesh in meshes]).astype(np.float32),
        albedo=joined([_mesh_albedo(mesh) for mesh in meshes], counts),
        name=path.stem,
        normal_map=joined([each or flat_normals for each in maps], counts) if mapped else None,
        tangents=np.concatenate([_mesh_tangents(mesh) for mesh in meshes]) if mapped else None,
    )


def _read(path: Path) -> tuple[trimesh.Scene, dict[str, float]]:
    """Read the meshes of a file, and {material name: scale of its normal map} of a glTF file.

    trimesh drops tangents and scales. So tangents are renamed to a user-defined attribute, and materials are
    numbered, because their names need not be unique.
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
                primitive["attributes"][TANGENT_ATTRIBUTE] = primitive["attributes"].pop("TANGENT")
    text = json.dumps(header).encode()
    if binary is not None:
        text += b" " * (-len(text) % 4)
        whole = 20 + len(text) + len(binary)
        text = data[:8] + struct.pack("<II", whole, len(text)) + data[16:20] + text + binary
    resolver = trimesh.resolvers.FilePathResolver(str(path))
    scene = trimesh.load_scene(io.BytesIO(text), file_type=kind[1:], resolver=resolver, process=False)
    return scene, scales


def _transformed(mesh: trimesh.Trimesh, transform: np.ndarray) -> trimesh.Trimesh:
    """Return a copy of the mesh, with its stored tangents, transformed by its node."""
    placed = mesh.copy(include_cache=True)
    if (stored := placed.vertex_attributes.get(TANGENT_ATTRIBUTE)) is not None:
        turned = np.asarray(stored, np.float64).copy()
        turned[:, :3] = normalize(turned[:, :3] @ transform[:3, :3].T)
        turned[:, 3] *= np.sign(np.linalg.det(transform[:3, :3]))  # a reflection changes the handedness
        placed.vertex_attributes[TANGENT_ATTRIBUTE] = turned
    return placed.apply_transform(transform)


def _mesh_albedo(mesh: trimesh.Trimesh) -> Albedo:
    faces = np.asarray(mesh.faces)
    visual: Any = mesh.visual
    material = getattr(visual, "material", None)
    texture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    uv = getattr(visual, "uv", None)
    if isinstance(texture, Image.Image) and uv is not None:
        texels = decode_srgb(np.asarray(texture.convert("RGB")) / np.float32(255))
        factor = _factor(material, default=1.0)
        return lambda face, barycentric: bilinear(texels, interpolate(uv, faces[face], barycentric)) * factor
    if getattr(visual, "kind", None) in ("vertex", "face"):
        colours = decode_srgb(visual.vertex_colors[:, :3] / np.float32(255))
        return lambda face, barycentric: interpolate(colours, faces[face], barycentric).astype(np.float32)
    plain = _factor(material, default=GREY)
    return lambda face, barycentric: np.broadcast_to(plain, (len(face), 3)).astype(np.float32)


def _mesh_normal_map(mesh: trimesh.Trimesh, scales: dict[str, float]) -> NormalMap | None:
    """Return the normal map of the mesh, or None."""
    visual: Any = mesh.visual
    material: Any = getattr(visual, "material", None)
    texture, uv = getattr(material, "normalTexture", None), getattr(visual, "uv", None)
    if not isinstance(texture, Image.Image) or uv is None:
        return None
    texels = decode_normal_map(np.asarray(texture.convert("RGB")), scales.get(material.name, 1.0))
    faces = np.asarray(mesh.faces)
    return lambda face, barycentric: bilinear(texels, interpolate(uv, faces[face], barycentric))


def _mesh_tangents(mesh: trimesh.Trimesh) -> np.ndarray:
    """Return the tangents (F, 3, 4) of the corners, from the file or computed; zero without texture
    coordinates."""
    faces, uv = np.asarray(mesh.faces), getattr(mesh.visual, "uv", None)
    if (stored := mesh.vertex_attributes.get(TANGENT_ATTRIBUTE)) is not None:
        return np.asarray(stored, np.float32)[faces]
    if uv is None:
        return np.zeros((*faces.shape, 4), np.float32)
    return tangents(np.asarray(mesh.vertices), faces, normalize(mesh.vertex_normals), uv)


def _factor(material: object, default: float) -> np.ndarray:
    """Return the material's plain linear colour (3,); glTF stores it linear, OBJ as sRGB."""
    if (factor := getattr(material, "baseColorFactor", None)) is not None:
        return np.asarray(factor[:3], np.float32) / np.float32(255)
    if default == GREY and (diffuse := getattr(material, "diffuse", None)) is not None:
        return decode_srgb(np.asarray(diffuse[:3]) / np.float32(255))
    return np.full(3, default, np.float32)
