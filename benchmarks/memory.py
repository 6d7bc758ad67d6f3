"""Measure whether the memory of a process grows with the frames of a shot.

    OMP_NUM_THREADS=1 python benchmarks/memory.py [FRAMES] [--found] [--rows 128]

The bundled person drifts over a grey wall in frames of 320 x 240, is filtered in time and relit by one
light, to PNG. Prints the resident memory of the process after frames 10, 50, 100, 200, 400... and after the
last one. `--rows`: of the networks' canvas, as what is kept of a frame does not depend on the time that they
take. `--found`: without a matte, so that the person is found, followed and cut out as well (the networks of
`relight fetch`). FRAMES: 300 unless given, a second each, or three.

A good result: the last figure is that of frame 50 but for some MiB.
"""

import argparse
import tempfile
from pathlib import Path

import checkout  # noqa: F401 (puts the helpers on the path)
import numpy as np
from helpers.damage import small_canvas

import relight
from shadow import analysis

PERSON = Path(__file__).parents[1] / "examples" / "person.png"
SIZE = (240, 320)
WALL = 0.2


def write_shot(folder, count):
    """Write plates p.%d.png and mattes m.%d.png of the person, who drifts by a pixel a frame and back."""
    person = relight.read(PERSON)
    height = round(SIZE[0] * 0.9)
    width = round(height * person.shape[1] / person.shape[0])
    small = relight.place(person, (height, width))
    for number in range(1, count + 1):
        left = 40 + abs(number % 120 - 60)
        frame = np.zeros((*SIZE, 4), np.float32)
        frame[SIZE[0] - height :, left : left + width] = small
        alpha = frame[..., 3:]
        relight.write(folder / f"p.{number}.png", frame[..., :3] + (1 - alpha) * WALL)
        relight.write(folder / f"m.{number}.png", np.repeat(alpha, 3, axis=-1))


def resident():
    """Return the resident memory of this process, in MiB."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("frames", type=int, nargs="?", default=300)
    parser.add_argument("--found", action="store_true")
    parser.add_argument("--rows", type=int, default=analysis.load().size, help="a multiple of 128")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as top, small_canvas(given.rows):
        folder = Path(top)
        write_shot(folder, given.frames)
        source = relight.Source(folder / "p.%d.png", mask=None if given.found else folder / "m.%d.png")
        shown = {10, *(50 * 2**power for power in range(10)), given.frames}

        def report(done, total, step):
            if step == "Relighting" and done in shown:
                print(f"frame {done:4d}: {resident():6.0f} MiB", flush=True)

        relight.render_shot(
            source, relight.DirectionalLight(azimuth=-60), folder / "r.%d.png", progress=report
        )


if __name__ == "__main__":
    main()
