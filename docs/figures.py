"""The figures of these pages, drawn from the bundled person by what the pages describe.

python docs/figures.py [folder]

Needs matplotlib, which the extra `train` installs. Writes axes.png (docs/conventions.md), way.png
(docs/architecture.md) and presets.png (docs/presets.md).
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np
import yaml
from matplotlib.figure import Figure

import relight
from relight.media import colour

PERSON = Path(__file__).parent.parent / "examples" / "person.png"
PRESETS = Path(relight.__file__).parent / "presets.yaml"
GREY, DARK = (0.18, 0.18, 0.18), (0.02, 0.022, 0.026)
INK = "#1d1d1f"
RIM = relight.DirectionalLight(azimuth=130, elevation=20).direction
AXES = {"x": "#c62828", "y": "#2e7d32", "z": "#1565c0"}  # the colours of every 3D application
matplotlib.rcParams |= {"font.size": 9, "text.color": INK, "axes.titlesize": 9, "axes.titlecolor": INK}


def shown(linear):
    """Linear light as a display shows it."""
    return colour.encode(np.ascontiguousarray(linear, np.float32), white=4.0)


def panel(axis, picture, title="", **options):
    axis.imshow(picture, interpolation="antialiased", **options)
    axis.set_title(title, pad=4)
    axis.set_axis_off()


def axes(subject, path):
    """The camera frame, and a light from each end of its axes."""
    figure = Figure(figsize=(9, 6.6), layout="constrained", dpi=100)
    left, right = figure.subfigures(1, 2, width_ratios=(1.15, 2))
    frame, dial = left.subplots(2, 1, height_ratios=(2.3, 1))
    camera_frame(frame, subject)
    azimuths(dial)

    height, width = subject.normals.shape[:2]
    bust = np.s_[round(0.04 * height) : round(0.64 * height), round(0.17 * width) : round(0.85 * width)]
    lights = {
        (0, 1): ("y", "from +y, above", "elevation 90", (0, 1, 0)),
        (1, 0): ("x", "from -x, image left", "azimuth -90", (-1, 0, 0)),
        (1, 1): ("z", "from +z, the camera", "azimuth 0, elevation 0", (0, 0, 1)),
        (1, 2): ("x", "from +x, image right", "azimuth 90", (1, 0, 0)),
        (2, 1): ("y", "from -y, below", "elevation -90", (0, -1, 0)),
        (0, 2): ("z", "from behind, z < 0: a rim", "azimuth 130, elevation 20", RIM),
    }
    grid = right.subplots(3, 3)
    for place, axis in np.ndenumerate(grid):
        if place not in lights:
            axis.set_axis_off()
            continue
        name, title, angle, direction = lights[place]
        picture = relight.over(
            subject.relit(relight.DirectionalLight(direction, intensity=6 if direction == RIM else 2)), GREY
        )
        panel(axis, shown(picture[bust]), f"{title}\n{angle}")
        axis.title.set_color(AXES[name])
        if name != "z":  # the light travels against its direction
            start = {"x": (0.5 + 0.68 * direction[0], 0.5), "y": (0.12, 0.5 + 0.5 * direction[1])}[name]
            tip = start - np.array([0.3, 0.2]) * direction[:2]
            style = {"arrowstyle": "-|>", "lw": 3.5, "color": AXES[name], "mutation_scale": 22}
            axis.annotate("", tip, start, "axes fraction", "axes fraction", arrowprops=style)
    save(figure, path)


def camera_frame(axis, subject):
    """The three axes over the person's normals."""
    normals = subject.normals
    inside = np.abs(normals).sum(axis=-1, keepdims=True) > 0
    panel(axis, np.where(inside, 0.5 + 0.5 * normals, 1), "camera frame, over normals as (n + 1) / 2")
    height, width = inside.shape[:2]
    origin = np.array([0.5 * width, 0.45 * height])
    ends = {
        "x": ((0.42, 0), "x: image\nright"),
        "y": ((0, -0.4), "y: up"),
        "z": ((-0.36, 0.16), "z: to the\ncamera"),
    }
    for name, ((right, down), label) in ends.items():
        tip = origin + np.array([right * width, down * height])
        style = {"arrowstyle": "-|>", "lw": 3, "color": AXES[name], "mutation_scale": 18}
        axis.annotate("", tip, origin, arrowprops=style)
        aside = {"x": (8, "left", "center"), "y": (6, "left", "bottom"), "z": (-6, "right", "center")}[name]
        axis.annotate(label, tip, (aside[0], 0), textcoords="offset points", color=AXES[name], weight="bold",
                      ha=aside[1], va=aside[2])  # fmt: skip
    axis.set_xlim(-0.35 * width, 1.35 * width)


def azimuths(axis):
    """Azimuth, seen from above."""
    axis.set_title("azimuth, seen from above", pad=4)
    axis.set(xlim=(-1.9, 1.9), ylim=(-1.55, 1.45), aspect="equal")
    axis.set_axis_off()
    turn = np.radians(np.arange(361))
    axis.plot(np.sin(turn), -np.cos(turn), color=INK, lw=1)
    axis.plot(0, 0, "o", color=INK, ms=9)
    for azimuth in (0, 40, 90, 140, 180, -140, -90, -40):
        x, y = np.sin(np.radians(azimuth)), -np.cos(np.radians(azimuth))
        axis.plot(x, y, "o", color="#f9a825", mec=INK, ms=6)
        across = "center" if abs(x) < 0.1 else "left" if x > 0 else "right"
        along = "center" if abs(y) < 0.1 else "bottom" if y > 0 else "top"
        axis.text(1.2 * x, 1.2 * y, f"{azimuth}", ha=across, va=along)
    axis.text(0.62, -1.42, "camera", ha="left", va="center", style="italic")
    axis.text(0, 0.16, "person", ha="center", va="bottom", style="italic")


def way(subject, image, path):
    """What is made of a photograph on its way to a picture, and by which module."""
    light = relight.DirectionalLight(azimuth=-55, elevation=35, intensity=2.6, name="key")
    rim = relight.DirectionalLight(azimuth=130, elevation=20, intensity=4, colour=(0.3, 0.5, 1), name="rim")
    inside = image[..., 3:] > 0.5
    direction = np.float32([light.direction])
    visibility, shading = subject.visibility(direction)[0], subject.shading(direction)[0]
    picture = subject.relit([light, rim])

    def on_white(values):
        return np.where(inside, values, 1)

    def grey(values):
        return on_white(np.repeat(values[..., None], 3, axis=2))

    steps = [
        ("image and matte\nrelight/media", on_white(shown(relight.over(image, GREY)))),
        ("normals\nshadow/networks/field.py", on_white(0.5 + 0.5 * subject.normals)),
        ("visibility(L): attached × cast\nshadow/networks/field.py", grey(visibility)),
        ("shading(L)\nshading/diffuse.py", grey(shown(np.repeat(shading[..., None], 3, 2))[..., 0])),
        ("albedo\nshading/diffuse.py", on_white(shown(subject.albedo))),
        ("Σ light · shading · albedo\nrelight/subject.py", shown(relight.over(picture, GREY))),
    ]
    figure = Figure(figsize=(11, 4.05), layout="constrained", dpi=100)
    for number, (axis, (title, step)) in enumerate(zip(figure.subplots(1, len(steps)), steps, strict=True)):
        panel(axis, step, title)
        if number:
            style = {"arrowstyle": "-|>", "lw": 1.5, "color": INK, "mutation_scale": 14}
            axis.annotate("", (0.06, 0.5), (-0.14, 0.5), "axes fraction", "axes fraction", arrowprops=style)
    save(figure, path)


def presets(subject, image, path):
    """The photograph, and the upper half of the person in each preset."""
    pictures = {"photograph": image} | {
        name: subject.relit(name, gloss=entry.get("gloss", 0))
        for name, entry in yaml.safe_load(PRESETS.read_text()).items()
    }
    figure = Figure(figsize=(11, 4.2), layout="constrained", dpi=100)
    axes = figure.subplots(2, 6).ravel()
    for axis, (title, picture) in zip(axes, pictures.items(), strict=False):
        panel(axis, shown(relight.over(picture, DARK))[: int(0.52 * image.shape[0])], title)
    for axis in axes[len(pictures) :]:
        axis.set_axis_off()
    save(figure, path)


def save(figure, path):
    figure.savefig(path, facecolor="white", metadata={"Software": None})
    print(f"wrote {path}")


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    photograph = relight.read(PERSON)
    person = relight.Subject(photograph)
    axes(person, folder / "axes.png")
    way(person, photograph, folder / "way.png")
    presets(person, photograph, folder / "presets.png")
