"""Relight a person with three lights and write a picture.

python examples/simple.py [person.png] [folder]
"""

import sys
from pathlib import Path

import relight

person = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("person.png")
folder = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("out")
folder.mkdir(parents=True, exist_ok=True)

lights = [
    relight.DirectionalLight(azimuth=-50, elevation=35, intensity=1.6, temperature=4500, name="key"),
    relight.DirectionalLight(azimuth=60, elevation=10, intensity=0.4, angle=40, name="fill"),
    relight.DirectionalLight(azimuth=150, elevation=30, intensity=1.2, colour=(0.7, 0.8, 1.0), name="rim"),
]
image = relight.read(person)  # linear Rec.709, premultiplied; the alpha is the person's matte
picture = relight.apply(image, lights)

relight.write(folder / "simple.exr", picture)  # scene-linear, premultiplied, for compositing
relight.write(folder / "simple.png", relight.over(picture, (0.18, 0.18, 0.18)))  # for looking at
print(f"wrote {folder / 'simple.exr'} and {folder / 'simple.png'}")
