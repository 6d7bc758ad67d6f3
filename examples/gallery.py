"""One photograph and four new lightings, side by side.

python examples/gallery.py [person.png] [file]
"""

import sys
from pathlib import Path

import numpy as np

import relight

person = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("person.png")
path = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("relit.png")

room = relight.DirectionalLight(azimuth=0, elevation=60, angle=180, intensity=0.25, name="room")
lightings = [
    [relight.DirectionalLight(azimuth=-55, elevation=30, intensity=2.6), room],
    [relight.DirectionalLight(azimuth=55, elevation=30, intensity=2.6), room],
    [relight.DirectionalLight(azimuth=0, elevation=75, intensity=3.0), room],
    [
        relight.DirectionalLight(azimuth=-70, elevation=15, intensity=2.2, colour=(1, 0.35, 0.15)),
        relight.DirectionalLight(azimuth=75, elevation=20, intensity=2.2, colour=(0.1, 0.35, 1)),
        relight.DirectionalLight(azimuth=170, elevation=40, intensity=2.0),
    ],
]
image = relight.read(person)
subject = relight.Subject(image)
grey = (0.06, 0.06, 0.065)
pictures = [relight.over(picture, grey) for picture in (image, *map(subject.relit, lightings))]
relight.write(path, np.concatenate(pictures, axis=1))
print(f"wrote {path}")
