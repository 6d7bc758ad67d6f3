"""What the virtual light stage costs on one core: seconds a view, shadow rays against camera rays, and bounce
light against a path tracer.

OMP_NUM_THREADS=1 python benchmarks/stage.py [mesh]
"""

import sys
import time

import numpy as np

from shadow import directions
from shadow.lightstage import scans, stage
from shadow.lightstage.pathtracer import path_trace
from shadow.lightstage.people import bodies

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
bounced, _ = seconds(lambda: stage.render(figure, stage.View(), SIZE, directions.olat(), bounced=True), 1)
traced, _ = seconds(lambda: path_trace(figure, stage.View(), SIZE, directions.olat()[20]), 1)
print(f"with bounce light too {bounced:.2f} s; Mitsuba's path tracer, 32 samples, one light: {traced:.2f} s,")
print(f"so {64 * traced / bounced:.0f} times as long for all 64")
