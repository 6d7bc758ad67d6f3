"""Relight a person once, then change the lights' strengths without running anything again.

python examples/layers.py [person.png] [folder]
"""

import sys
from pathlib import Path

import numpy as np

import relight

person = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("person.png")
folder = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("out")
folder.mkdir(parents=True, exist_ok=True)

lights = [
    relight.DirectionalLight(azimuth=-50, elevation=35, name="key"),
    relight.DirectionalLight(azimuth=60, elevation=10, angle=40, name="fill"),
    relight.DirectionalLight(azimuth=150, elevation=30, name="rim"),
]
subject = relight.Subject(relight.read(person))  # the networks run here, and never again
layers = subject.layers(lights)

# Light adds: the layers' colours sum to the picture in all lights. (Each carries the matte as its alpha.)
total = sum(layer[..., :3] for layer in layers.values())
difference = np.abs(total - subject.relit(lights)[..., :3]).max()
print(f"largest difference between the sum of the layers and all lights at once: {difference:.1e}")

# So a remix is a weighted sum, the same here as in a compositing application.
strengths = {"key": 0.3, "fill": 0.2, "rim": 2.0}
night = layers["key"].copy()  # for its alpha
night[..., :3] = sum(strengths[name] * layer[..., :3] for name, layer in layers.items())

groups = {f"C_{name}": layer for name, layer in layers.items()}
relight.write(folder / "layers.exr", subject.relit(lights), layers=groups)
relight.write(folder / "night.png", relight.over(night, (0.01, 0.01, 0.02)))
print(f"wrote {folder / 'layers.exr'} and {folder / 'night.png'}")
