"""Light that was painted on a portrait, docs/painting.png (lights.md).

python docs/painting.py [folder]

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

STROKES = (  # x and y in pixels, radius, factor
    ((185, 60), (196, 130), 26, 2.0),
    ((262, 70), (262, 150), 24, 0.35),
    ((120, 280), (170, 250), 34, 1.6),
    ((330, 270), (360, 330), 40, 0.4),
)
COLOURS = {True: (1.0, 0.25, 0.2), False: (0.25, 0.45, 1.0)}  # brighter, darker
STRENGTH = 0.45  # of the colour over the photograph


def stroke(size, start, end, radius):
    """Coverage (H, W) of a stroke from one place to another."""
    y, x = np.mgrid[: size[0], : size[1]]
    along = np.linspace(0, 1, 60)[:, None, None]
    places = [a + (b - a) * along for a, b in zip(start, end, strict=True)]
    distance = np.hypot(x - places[0], y - places[1]).min(axis=0)
    return (radius - distance + 0.5).clip(0, 1).astype(np.float32)


def painting(path):
    """NASA's portrait of Eileen Collins, with strokes, and in the lights that they became."""
    photograph = data.astronaut()
    subject = relight.Subject(photograph, height=0.9)  # metres, of the person in the frame
    plate = subject.clean_plate(photograph)
    strokes = [(stroke(subject.size, start, end, radius), factor) for start, end, radius, factor in STROKES]
    drawn = photograph / 255
    for mask, factor in strokes:
        share = STRENGTH * mask[..., None]
        drawn = drawn * (1 - share) + np.array(COLOURS[factor > 1]) * share
    lights = relight.paint_lights(subject, strokes, subject.preset("overcast"), count=3)
    pictures = {
        "--preset overcast": shown(relight.over(subject.relit("overcast"), plate)),
        "strokes: red brighter, blue darker": drawn.clip(0, 1),
        f"{len(lights)} lights": shown(relight.over(subject.relit(lights), plate)),
    }
    figure = Figure(figsize=(9, 3.2), layout="constrained", dpi=100)
    for axis, (title, picture) in zip(figure.subplots(1, len(pictures)), pictures.items(), strict=True):
        panel(axis, np.asarray(picture)[:360, 60:430], title)
    save(figure, path)
    for light in lights:
        print(light)


if __name__ == "__main__":
    painting((Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent) / "painting.png")
