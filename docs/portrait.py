"""A real portrait in new lights, docs/portrait.png (README.md), and what goes wrong, docs/limits.png.

python docs/portrait.py [folder]

Needs the extra `test` (scikit-image, matplotlib), and the networks of `relight fetch person` and `relight
fetch silhouette`.
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
    plate, light = subject.clean_plate(photograph), relight.DirectionalLight
    lamps = [
        light(azimuth=-55, elevation=25, intensity=2.6, colour=(1, 0.82, 0.6), angle=20),
        light(azimuth=130, elevation=25, intensity=3, colour=(0.35, 0.55, 1)),
        light(azimuth=20, elevation=0, intensity=0.12, colour=(0.5, 0.7, 1), angle=60),
    ]
    pictures = {
        "photograph (NASA, public domain)": photograph,
        "--preset rembrandt": shown(relight.over(subject.relit("rembrandt"), plate)),
        "--preset golden-hour": shown(relight.over(subject.relit("golden-hour"), plate)),
        "a warm key, a blue rim, in a studio": shown(relight.over(subject.relit(lamps, gloss=0.5), STUDIO)),
    }
    figure = Figure(figsize=(11, 2.95), layout="constrained", dpi=100)
    for axis, (title, picture) in zip(figure.subplots(1, 4), pictures.items(), strict=True):
        panel(axis, np.asarray(picture)[:320, 80:410], title)
    save(figure, path)


def limits(path):
    """Lav Varshney's photograph of a cameraman, whole and right, and two pictures with faults."""
    photograph, face = np.stack([data.camera()] * 3, axis=-1), data.astronaut()
    subject = relight.Subject(photograph)
    plate = subject.clean_plate(photograph)
    above = relight.DirectionalLight(elevation=75, intensity=2.5)
    dark = relight.over(relight.Subject(face, height=0.9).relit(above), STUDIO)
    pictures = {
        "photograph (CC0)": photograph,
        "--preset rembrandt": shown(relight.over(subject.relit("rembrandt"), plate)),
        "--preset golden-hour": shown(relight.over(subject.relit("golden-hour"), plate)),
        "light from above": np.asarray(shown(dark))[:220, 110:330],
    }
    figure = Figure(figsize=(11, 2.95), layout="constrained", dpi=100)
    for axis, (title, picture) in zip(figure.subplots(1, 4), pictures.items(), strict=True):
        panel(axis, np.asarray(picture), title)
    save(figure, path)


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    portrait(folder / "portrait.png")
    limits(folder / "limits.png")
