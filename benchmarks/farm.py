"""Measure the tasks of a render farm: core-seconds and bytes for a 4K frame, for making a training record,
and for reading one.

OMP_NUM_THREADS=1 python benchmarks/farm.py [person.png]

Times are processor time of one thread, the shortest of several runs. The bundled person (or another image
with alpha) fills the height of a 3840 x 2160 plate and is relit by a key light and a rim light. Records are
512 x 512 pixels, with 96 directions and bounce light.

Figures to compare with are in docs/farm.md.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

import relight
from relight.media.movies import write_movie
from relight.rendering import render_subject
from shadow import directions, visibility
from shadow.data import photographs
from shadow.data import records as record_files
from shadow.framing import canvas_size
from shadow.lightstage import stage
from shadow.lightstage.people.generate import bodies

HEIGHT, WIDTH = 2160, 3840
LIGHTS = [
    relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2, name="key"),
    relight.DirectionalLight(azimuth=150, elevation=20, name="rim"),
]


def least(function, repeats=3):
    """(processor seconds, result)"""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        result = function()
        times.append(time.process_time() - start)
    return min(times), result


def megabytes(path):
    return path.stat().st_size / 1e6


def frame(person, folder):
    """The steps of one frame of a shot, from files to files."""
    plate = folder / "plate.exr"
    height = person.shape[0]
    scale = HEIGHT / height
    placed = relight.place(person, (HEIGHT, WIDTH), mode="centre", scale=scale)
    relight.write(plate, placed)
    reading, image = least(lambda: relight.read(plate))
    analysing, subject = least(lambda: relight.Subject(image))
    steadying, steady = least(lambda: subject.temporally_filtered([subject] * 4), 2)
    kept = folder / "frame.safetensors"
    saving, _ = least(lambda: steady.save(kept))
    loading, loaded = least(lambda: relight.Subject.load(kept))
    lighting, (picture, layers) = least(lambda: render_subject(loaded, LIGHTS, background=None))
    relit = folder / "relit.exr"
    writing, _ = least(lambda: relight.write(relit, picture, layers=layers))
    encoding, _ = least(lambda: write_movie(folder / "relit.mov", [picture] * 2), 2)
    print(f"a frame of {WIDTH} x {HEIGHT}, the person {height * scale:.0f} pixels high, core-seconds:")
    print(
        f"  analyse: read {reading:.2f}, analyse {analysing:.2f}, steady {steadying:.2f}, keep {saving:.2f}"
    )
    print(f"  light: load {loading:.2f}, light {lighting:.2f}, write {writing:.2f}")
    print(f"  finish: encode {encoding / 2:.2f}")
    print(f"  MB: plate {megabytes(plate):.1f}, kept {megabytes(kept):.1f}, relit {megabytes(relit):.1f}")


def record(folder):
    """A view of a clothed body, and reading it back as training does."""
    bodies.body(0, "training")  # loads the body model
    making, figure = least(lambda: bodies.body(1, "training"))
    rendering, view = least(
        lambda: stage.render(figure, stage.View(), 512, directions.olat(True), bounced=True), 2
    )
    size = record_files.write(folder / "record.npz", view)
    (shard,) = record_files.pack(folder, folder / "shards")
    records = record_files.Records([shard])
    reading, _ = least(lambda: records[0], 5)
    rng, canvas = np.random.default_rng(0), canvas_size(visibility.load().size)
    photographing, _ = least(lambda: photographs.sample(records[0], rng, canvas, 20, True), 5)
    print(f"a body {making:.2f} core-seconds, a view of it {rendering:.2f}, {size / 1e3:.0f} KB")
    print(f"reading a record {reading * 1e3:.0f} ms, with its photograph {photographing * 1e3:.0f} ms")


if __name__ == "__main__":
    torch.set_num_threads(1)
    person = relight.read(sys.argv[1] if len(sys.argv) > 1 else "examples/person.png")
    with tempfile.TemporaryDirectory() as folder:
        frame(person, Path(folder))
        record(Path(folder))
