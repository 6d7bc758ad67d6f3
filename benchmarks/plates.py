"""Measure large plates. Prints the peak memory, and the time of each step as a multiple of its time on a 1920
x 1080 plate in the same run, which is comparable between machines. Times are processor time of one thread.

python benchmarks/plates.py [person.png]

The bundled person (or another image with alpha) fills the height of the plate, over grey, and is relit by a
key light, a rim light and an environment. Each plate is measured in its own process. Linux only.

A good peak is at most 1.8 GiB for 3840 x 2160. Measured figures are in docs/compositing.md.
"""

import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

PLATES = {"1920 x 1080": (1080, 1920), "3840 x 2160": (2160, 3840), "7680 x 4320": (4320, 7680)}
GREEN = (0.05, 0.45, 0.08)


class Meter:
    """Runs steps and keeps of each its processor time and the most memory that was resident, in bytes."""

    def __init__(self):
        self.steps = {}

    def __call__(self, name, function, *arguments, **settings):
        peak, done = [_resident()], threading.Event()

        def watch():
            while not done.wait(0.005):
                peak[0] = max(peak[0], _resident())

        watcher = threading.Thread(target=watch)
        watcher.start()
        start = time.process_time()
        result = function(*arguments, **settings)
        seconds = time.process_time() - start
        done.set()
        watcher.join()
        self.steps[name] = seconds, max(peak[0], _resident())
        return result


def _resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


def prepare(person, size, folder):
    """Write the photograph, its matte, and the same person before a green screen."""
    import relight

    placed = relight.place(relight.read(person), size)
    relight.write(folder / "photo.png", relight.over(placed, (0.3, 0.3, 0.3)))
    relight.write_mask(folder / "matte.png", placed[..., 3])
    relight.write(folder / "screen.png", relight.over(placed, GREEN))


def measure(folder):
    """Relight the photograph in `folder`, step by step, and print what each took as JSON."""
    import numpy as np
    import torch

    import relight
    from relight.rendering import render_subject

    torch.set_num_threads(1)
    sky = np.linspace(2, 0.1, 64, dtype=np.float32)[:, None, None] * np.ones((64, 128, 3), np.float32)
    lights = [
        relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2, name="key"),
        relight.DirectionalLight(azimuth=150, elevation=20, name="rim"),
        relight.EnvironmentLight(sky, name="sky"),
    ]
    small = np.zeros((64, 48, 4), np.float32)
    small[8:60, 12:36] = (0.4, 0.3, 0.2, 1)
    relight.Subject(small).relit(lights)  # the networks' weights are loaded, and the first steps made

    meter = Meter()
    image = meter("read", relight.read, folder / "photo.png")
    matte = meter("read the matte", relight.read_mask, folder / "matte.png")
    subject = meter("analyse", relight.Subject, image, matte)
    meter("one light", subject.relit, lights[0])
    sky = meter("the environment's view", lights[2].view, matte.shape)
    picture, layers = meter("three lights, layers", render_subject, subject, lights, background=sky)
    meter("write .exr", relight.write, folder / "out.exr", picture, layers=layers)
    del layers
    meter("write .png", relight.write, folder / "out.png", picture)
    del picture, sky, subject, matte
    image = relight.read(folder / "screen.png")
    meter("key", relight.key, image)
    print(json.dumps(meter.steps))


def main(person):
    results = {}
    for name, size in PLATES.items():
        with tempfile.TemporaryDirectory() as folder:
            for step in (["prepare", str(person), *map(str, size)], ["measure"]):
                command = [sys.executable, __file__, "--step", folder, *step]
                output = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        results[name] = json.loads(output)
    print(f"{'':24}" + "".join(f"{name:>26}" for name in results))
    first = next(iter(results.values()))
    for step, (unit, _) in first.items():
        cells = [
            f"{seconds:7.2f} s {seconds / unit:5.1f} x {peak / 2**30:5.2f} GiB"
            for seconds, peak in (steps[step] for steps in results.values())
        ]
        print(f"{step:24}" + "".join(f"{cell:>26}" for cell in cells))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--step"]:
        folder, step, *arguments = sys.argv[2:]
        if step == "prepare":
            prepare(arguments[0], tuple(map(int, arguments[1:])), Path(folder))
        else:
            measure(Path(folder))
    else:
        main(*sys.argv[1:] or [Path(__file__).parents[1] / "examples" / "person.png"])
