"""A real portrait in three lights, docs/portrait.png (docs/lights.md).

python docs/portrait.py [folder]

Needs the extra `test` (scikit-image, matplotlib) and the networks of `relight fetch person`.
"""

import sys
from pathlib import Path

import numpy as np
from figures import panel, save, shown
from matplotlib.figure import Figure
from skimage import data

import relight

STUDIO = (0.02, 0.025, 0.03)


def portrait(path):
    """A real photograph, NASA's portrait of Eileen Collins, and the person in three lights."""
    photograph = data.astronaut()
    subject = relight.Subject(photograph, height=0.9)  # metres, of the person in the frame
    light = relight.DirectionalLight
    fill = light(azimuth=20, elevation=0, intensity=0.12, colour=(0.5, 0.7, 1), angle=60)
    lights = {
        "a warm key, a blue rim": [
            light(azimuth=-55, elevation=25, intensity=2.6, colour=(1, 0.82, 0.6), angle=20),
            light(azimuth=130, elevation=25, intensity=3, colour=(0.35, 0.55, 1)),
            fill,
        ],
        "a large softbox, from above": [
            light(azimuth=-25, elevation=50, intensity=2.2, angle=40),
            light(azimuth=150, elevation=25, intensity=2.5, colour=(1, 0.6, 0.3)),
            light(azimuth=20, elevation=-20, intensity=0.3, angle=60),
        ],
        "the preset rembrandt, + 0.7 stops": relight.presets()["rembrandt"],
    }
    pictures = {"photograph (NASA, public domain)": photograph}
    for title, those in lights.items():
        gain = 2**0.7 if "preset" in title else 1
        pictures[title] = shown(gain * relight.over(subject.relit(those), np.float32(STUDIO) / gain))
    figure = Figure(figsize=(11, 2.95), layout="constrained", dpi=100)
    for axis, (title, picture) in zip(figure.subplots(1, 4), pictures.items(), strict=True):
        panel(axis, picture[:320, 80:410], title)
    save(figure, path)


if __name__ == "__main__":
    portrait(Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent) / "portrait.png")
