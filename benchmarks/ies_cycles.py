"""Compare lamps with IES profiles with Cycles: the light on a floor below a lamp of the same file.

python benchmarks/ies_cycles.py

Needs `pip install bpy==4.5.3` (Blender as a module, 370 MB), which no test needs. A lamp without size hangs
2 m above a white floor of 6 m and shines straight down; Cycles renders it from above without bounces. Blender
measures lamps in watts, so one scale is fitted for each profile. In Cycles the plane C0 points to -Y and
angles grow clockwise seen from above; ours points to the right, and they grow the other way. So our picture
is mirrored at its diagonal. The error is relative to theirs, where a pixel has 1 % of the brightest or more.
Left out are 15 degrees to each side of C0, where Cycles 4.5.3 makes an even lamp up to 7 % too bright; all
around in a file of one plane. Cycles interpolates by cubic polynomials, we in straight lines.

Figures to compare with are in docs/lights.md.
"""

import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from helpers.lamps import ies

import relight

SIDE = 128  # pixels
FLOOR = 6.0  # metres
HEIGHT = 2.0
STEP = 2.5  # degrees of the profiles, as many lamps' files have
SEAM = 15.0  # degrees
DARK = 0.01  # of the brightest
VERTICAL = np.arange(0, 91, STEP)
AROUND = np.arange(0, 361, 15.0)


def profiles():
    """Candela (H, V) by name."""
    cosine = np.cos(np.radians(VERTICAL))
    batwing = 800 * (0.3 + np.sin(np.radians(2 * VERTICAL)) ** 2) * cosine**0.5
    around = np.ones_like(AROUND)
    turned = 0.6 + 0.4 * np.cos(np.radians(AROUND - 70))
    return {
        "even": np.outer(around, 1000 + 0 * cosine),
        "spot (cosine to the eighth)": np.outer(around, 1000 * cosine**8),
        "batwing": np.outer(around, batwing),
        "asymmetric": 900 * cosine**3 * (1 + np.outer(turned, np.sin(np.radians(VERTICAL)))),
    }


def floor():
    """Positions (3, SIDE, SIDE) of the pixels on the floor, x to the right and y up in the picture."""
    steps = ((np.arange(SIDE) + 0.5) / SIDE - 0.5) * FLOOR
    x, y = np.meshgrid(steps, -steps)
    return np.stack([x, y, np.zeros_like(x)])


def seam():
    """Where Cycles joins the planes of 0 and 360 degrees, (SIDE, SIDE)."""
    x, y, _ = floor()
    return (y < 0) & (np.abs(np.degrees(np.arctan2(x, -y))) < SEAM)


def ours(path):
    light = relight.PointLight((0, 0, HEIGHT), toward=(0, 0, 0), profile=path)
    total = torch.zeros(SIDE, SIDE)
    for rays in light.rays(torch.from_numpy(np.float32(floor()))):
        total += rays.irradiance * rays.directions[2]
    return total.numpy()


def theirs(path, folder):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    material = bpy.data.materials.new("white")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    diffuse, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    diffuse.inputs["Color"].default_value = (1, 1, 1, 1)
    material.node_tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    bpy.ops.mesh.primitive_plane_add(size=2 * FLOOR)
    bpy.context.object.data.materials.append(material)
    lamp = bpy.data.lights.new("lamp", "POINT")
    lamp.energy, lamp.shadow_soft_size, lamp.use_nodes = 100, 0, True
    tree = lamp.node_tree
    texture = tree.nodes.new("ShaderNodeTexIES")
    texture.mode, texture.filepath = "EXTERNAL", str(path)
    emission = next(node for node in tree.nodes if node.type == "EMISSION")
    tree.links.new(texture.outputs[0], emission.inputs["Strength"])
    hung = bpy.data.objects.new("lamp", lamp)
    hung.location = (0, 0, HEIGHT)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", FLOOR, (0, 0, 10)
    for each in (hung, camera):
        scene.collection.objects.link(each)
    scene.camera = camera
    scene.render.engine, scene.cycles.samples, scene.cycles.max_bounces = "CYCLES", 64, 0
    scene.cycles.use_denoising, scene.cycles.pixel_filter_type = False, "BOX"
    scene.render.resolution_x = scene.render.resolution_y = SIDE
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(folder / "floor.exr")
    bpy.ops.render.render(write_still=True)
    return relight.read(folder / "floor.exr")[..., 1]


def main():
    print("| profile | mean error | 99 % of the pixels | most |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title, candela in profiles().items():
            path = folder / "lamp.ies"
            path.write_text(ies(candela, VERTICAL, AROUND))
            true, found = theirs(path, folder), ours(path).T  # mirrored
            bright = (true > DARK * true.max()) & ~seam()
            found = found * (true[bright].sum() / found[bright].sum())
            error = 100 * np.abs(found - true)[bright] / true[bright]
            print(
                f"| {title} | {error.mean():.2f} % | {np.quantile(error, 0.99):.2f} % | {error.max():.2f} % |"
            )


if __name__ == "__main__":
    main()
