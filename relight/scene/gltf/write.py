"""glTF 2.0: the person, the plate's camera and the lights in one binary file."""

import io
import math
from functools import partial
from pathlib import Path

from relight.scene.asset import ROUGHNESS, Asset
from relight.scene.gltf.lights import place_nodes, punctual_lights
from relight.scene.gltf.read import EXTENSION, Tree
from relight.scene.mesh import CUTOFF
from shadow.files import replacing
from shadow.installing import install_command


def write(path: Path, asset: Asset) -> None:
    """Write a person: the nodes World, Person, Camera and the lights, the feet on the ground at y = 0."""
    try:
        import trimesh
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"glTF needs the extra scene: {install_command('scene')}") from error
    from PIL import Image

    material = trimesh.visual.material.PBRMaterial(
        name="Unlit" if asset.unlit else "Matte",
        baseColorTexture=Image.open(io.BytesIO(asset.texture)),
        metallicFactor=0.0,
        roughnessFactor=ROUGHNESS if asset.gloss else 1.0,
        alphaMode="MASK",
        alphaCutoff=CUTOFF,
        doubleSided=True,
    )
    mesh = trimesh.Trimesh(
        asset.mesh.points, asset.mesh.faces, vertex_normals=asset.mesh.normals, process=False,
        visual=trimesh.visual.TextureVisuals(uv=asset.mesh.uv, material=material),
    )  # fmt: skip
    scene = trimesh.Scene()
    scene.add_geometry(mesh, node_name="Person", geom_name="Person")
    complete = partial(_complete, asset=asset)
    content = trimesh.exchange.gltf.export_glb(scene, include_normals=True, tree_postprocessor=complete)
    with replacing(path) as written:
        written.write_bytes(content)


def _complete(tree: Tree, asset: Asset) -> None:
    """Add what trimesh does not write: the ground, the camera, the lights, what the material reflects."""
    nodes = tree["nodes"]
    (root,) = tree["scenes"][tree["scene"]]["nodes"]
    nodes[root] |= {"name": "World", "translation": [0.0, -asset.ground, 0.0]}
    nodes[root].pop("matrix", None)
    added: list[Tree] = []
    if "mesh" in nodes[root]:  # trimesh has a single mesh at the root
        added.append({"name": "Person", "mesh": nodes[root].pop("mesh")})
    height, width = asset.camera.size
    tree["cameras"] = [
        {
            "name": "Camera",
            "type": "perspective",
            "perspective": {
                "aspectRatio": width / height,
                "yfov": math.radians(asset.camera.field_of_view),
                "znear": 0.01,
            },
        }
    ]
    added.append({"name": "Camera", "camera": 0, "translation": asset.eye.tolist()})
    lights, places = punctual_lights(asset.lights)
    if lights:
        tree.setdefault("extensions", {})[EXTENSION] = {"lights": lights}
        tree.setdefault("extensionsUsed", []).append(EXTENSION)
        added += place_nodes(lights, places)
    children = nodes[root].setdefault("children", [])
    children += range(len(nodes), len(nodes) + len(added))
    nodes += added
    tree["asset"]["generator"] = "relight"
    name, settings = ("KHR_materials_unlit", {}) if asset.unlit else _specular(asset.gloss)
    tree.setdefault("extensionsUsed", []).append(name)
    for material in tree["materials"]:
        material.setdefault("extensions", {})[name] = settings


def _specular(gloss: float) -> tuple[str, Tree]:
    """Return the extension that makes F0 zero and F90 `gloss`.

    Without it, a renderer adds the reflection of plastic. KHR_materials_sheen is no alternative: its fibres
    scatter backward, so light from the front would veil the outline.
    """
    return "KHR_materials_specular", {"specularFactor": gloss, "specularColorFactor": [0.0, 0.0, 0.0]}
