"""Light a person by a sky with a low sun, and put them in front of it, at three times of the turn.

python examples/environment.py [person.png] [folder]

The sky is made here, as a latitude-longitude map such as an HDRI is; yours is a file: EnvironmentLight(path).
"""

import dataclasses
import sys
from pathlib import Path

import numpy as np

import relight

person = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("person.png")
folder = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("out")
folder.mkdir(parents=True, exist_ok=True)


def evening_sky(sun, rows=512):
    """A map (rows, 2 rows, 3) of linear radiance: sky, a glow around the sun, the sun, and dark ground."""
    elevation = np.radians(90 - (np.arange(rows)[:, None, None] + 0.5) * 180 / rows)
    azimuth = np.radians(180 - (np.arange(2 * rows)[:, None] + 0.5) * 180 / rows)
    across, up, toward = (
        np.cos(elevation) * np.sin(azimuth),
        np.sin(elevation),
        np.cos(elevation) * np.cos(azimuth),
    )
    to_sun = across * sun[0] + up * sun[1] + toward * sun[2]
    height = np.clip(up, 0, 1) ** 0.5
    sky = np.float32((0.75, 0.48, 0.33)) * (1 - height) + np.float32((0.10, 0.20, 0.42)) * height
    sky = sky + np.float32((2.2, 0.9, 0.25)) * np.exp(5 * (to_sun - 1)) + 6 * np.exp(300 * (to_sun - 1))
    ground = np.float32((0.10, 0.075, 0.055)) * (1 + np.exp(8 * (to_sun - 1)))
    horizon = np.clip(up * rows / 4 + 0.5, 0, 1)
    disc = np.clip((to_sun - np.cos(np.radians(0.7))) * 1e5, 0, 1)
    return (ground * (1 - horizon) + sky * horizon + disc * np.float32((24000, 13500, 6000))).astype(
        np.float32
    )


sun = relight.DirectionalLight(azimuth=125, elevation=14).direction  # behind the person, at image right
relight.write(folder / "sky.exr", evening_sky(sun))
sky = relight.EnvironmentLight(folder / "sky.exr", name="sky")

image = relight.read(person)
subject = relight.Subject(image)  # the networks run here, once
frame = image.shape[:2]
pictures = []
for rotation in (0, 110, 200):  # the sun behind at the right, behind at the left, in front
    turned = dataclasses.replace(sky, rotation=rotation)
    pictures.append(relight.over(subject.relit(turned), turned.view(frame, field_of_view=35)))

relight.write_lights(folder / "sky.yaml", [sky])  # relight apply person.png --lights sky.yaml does the same
relight.write(folder / "environment.exr", pictures[0])
relight.write(folder / "environment.png", np.concatenate(pictures, axis=1))
print(f"wrote {folder / 'environment.exr'} and {folder / 'environment.png'}")
