"""What the virtual light stage costs on one core: seconds a view, and shadow rays against camera rays.

OMP_NUM_THREADS=1 python benchmarks/stage.py [mesh]
"""

import sys
import time

import numpy as np

from shadow import directions
from shadow.lightstage import bodies, scans, stage

SIZE = 512


def seconds(function, repeats=3):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = function()
        times.append(time.perf_counter() - start)
    return min(times), result


bodies.body(0, "training")  # loads the body model
if len(sys.argv) > 1:
    figure = scans.load(sys.argv[1])
    print(f"{figure.name}: {len(figure.vertices)} vertices")
else:
    making, figure = seconds(lambda: bodies.body(1, "training"))
    print(f"{figure.name}: {len(figure.vertices)} vertices, dressed in {making:.2f} s")
camera, _ = seconds(lambda: stage.render(figure, stage.View(), SIZE, np.float32([[0, 0, -1]])))
view, record = seconds(lambda: stage.render(figure, stage.View(), SIZE, directions.olat()))
print(f"{SIZE} x {SIZE}, {record.mask.sum()} pixels of the subject: camera rays and surface {camera:.2f} s,")
print(f"with 64 visibility maps {view:.2f} s, ratio {view / camera:.2f}")
