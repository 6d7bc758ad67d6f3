"""One EXR with a layer for each light, and a Nuke script that mixes them.

python examples/light_groups.py [photo] [folder]
"""

import sys
from pathlib import Path

import numpy as np

import relight
from relight.rendering import render
from relight.scene import nuke

photo = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_name("person.png")
folder = Path(sys.argv[2] if len(sys.argv) > 2 else "light_groups")
folder.mkdir(parents=True, exist_ok=True)

lights = [
    relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2, temperature=4500, name="key"),
    relight.DirectionalLight(azimuth=140, elevation=20, colour=(0.5, 0.7, 1), angle=20, name="rim"),
    relight.DirectionalLight(elevation=60, intensity=0.2, angle=120, name="fill"),
]
picture, layers = render(relight.read(photo), lights, passes=("albedo", "N", "visibility"))
exr = folder / "groups.exr"
relight.write(exr, picture, layers=layers)
groups = {name.removeprefix("C_"): (exr, name) for name in layers if name.startswith("C_")}
nuke.write_script(folder / "groups.nk", groups, picture.shape[:2])

# What a compositor relies on: the groups in the file add up to the beauty in the file.
stored = relight.read_layers(exr)
total = sum(layer[..., :3] for name, layer in stored.items() if name.startswith("C_"))
error = np.abs(total - relight.read(exr)[..., :3]).max()
print(f"wrote {exr} with {', '.join(stored)}; groups and beauty differ by at most {error:.2g}")
