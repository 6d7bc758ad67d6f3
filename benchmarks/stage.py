"""Measure the virtual light stage on one core. Prints the seconds for a view, the cost of shadow rays
relative to camera rays, the seconds for a training view with all fixed light directions and with fewer, and
the time of bounce light relative to a path tracer.

OMP_NUM_THREADS=1 python benchmarks/stage.py [mesh]

Figures to compare with are in docs/training.md and docs/history.md.
"""

import sys
import time

import checkout  # noqa: F401 (puts the helpers on the path)
import numpy as np
from helpers.pathtracer import path_trace

from shadow import directions
from shadow.data import records
from shadow.lightstage import scans, stage
from shadow.lightstage.people.generate import bodies

SIZE = 512


def seconds(function, repeats=3):
    times = []  # of the processor: other work on the machine does not count
    for _ in range(repeats):
        start = time.process_time()
        result = function()
        times.append(time.process_time() - start)
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
cameras = stage.views(4, figure, np.random.default_rng(0))
fixed, fewer = directions.olat(True), directions.stratified(44, np.random.default_rng(0), True)
for size, lights in ((448, fixed), (384, fixed), (384, fewer)):
    taken = [
        seconds(lambda: records.to_bytes(stage.render(figure, camera, size, lights)), 2)[0]  # noqa: B023
        for camera in cameras
    ]
    print(f"{size} x {size}, {len(lights)} directions, jittered, as a record: {np.mean(taken):.2f} s a view")
bounced, _ = seconds(lambda: stage.render(figure, stage.View(), SIZE, directions.olat(), bounced=True), 1)
traced, _ = seconds(lambda: path_trace(figure, stage.View(), SIZE, directions.olat()[20]), 1)
print(f"with bounce light too {bounced:.2f} s; Mitsuba's path tracer, 32 samples, one light: {traced:.2f} s,")
print(f"so {64 * traced / bounced:.0f} times as long for all 64")
