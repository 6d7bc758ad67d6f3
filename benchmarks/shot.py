"""Measure what a stored analysis saves: relight a shot from it, and relight the same plates without it. Times
are processor time of one thread, without imports. Prints ratios from one run, which are comparable between
machines.

python benchmarks/shot.py [frames...]          20 and 200 unless given

The bundled person drifts across 1920 x 1080, photographed with noise, and is relit by a key light and a rim.
Memory is that of the process after the tenth frame and after the last one, which shows whether it grows with
the shot. The last figure is the disk space of a close-up, where the person covers four fifths of the frame.

Memory should not grow with the number of frames. Figures to compare with are in docs/video.md.
"""

import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from flicker import moved

import relight
from relight.pipeline.shot import Shot
from relight.rendering import render_subject

PERSON = Path(__file__).parents[1] / "examples" / "person.png"
SIZE = 1080, 1920
LIGHTS = [
    relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2, name="key"),
    relight.DirectionalLight(azimuth=150, elevation=20, name="rim"),
]


def photographed(number, x, y, size):
    """A plate with noise and its matte: the person `size` times as large, at (x, y) from the middle."""
    picture = moved(relight.read(PERSON), x, y, size, SIZE).clip(0)
    picture[..., 3] = picture[..., 3].clip(0, 1)
    plate = relight.over(picture, (0.3, 0.3, 0.3))
    plate *= 1 + np.random.default_rng(number).normal(0, 0.02, plate.shape).astype(np.float32)
    return plate.clip(0), picture[..., 3]


def write_plates(folder, frames):
    """Plates and mattes, numbered from 1."""
    for number in range(1, frames + 1):
        plate, matte = photographed(number, 3.7 * number % 400, 0, 1.06)
        relight.write(folder / f"plate.{number:04d}.exr", plate)
        relight.write_mask(folder / f"matte.{number:04d}.png", matte)


def pixels(source, frames, **settings):
    """Seconds a frame from a source to relit pixels in memory, and a picture of each."""
    shot, pictures, seconds = Shot(relight.Source(source, **settings)), [], 0.0
    for number in range(1, frames + 1):
        start = time.process_time()
        subject = shot.person(number)
        picture, _ = render_subject(subject, LIGHTS)
        seconds += time.process_time() - start
        pictures.append(picture[::7, ::7])
    return seconds / frames, np.stack(pictures)


def timed(function, *arguments, **settings):
    """Processor seconds, and MiB that the process holds after each frame."""
    held = []

    def progress(done, total, what):
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        held.append(pages * resource.getpagesize() / 2**20)

    start = time.process_time()
    assert function(*arguments, progress=progress, **settings) == {}
    return time.process_time() - start, held


def measure(folder, frames):
    write_plates(folder, frames)
    plates, shot = folder / "plate.%04d.exr", folder / "shot.relight"
    mask = folder / "matte.%04d.png"
    source = relight.Source(plates, mask=mask)
    analysis, analysing = timed(relight.analyse_shot, source, shot)
    sizes = [path.stat().st_size for path in shot.iterdir()]
    count = min(frames, 20)  # of pictures in memory
    (direct, made), (kept, found) = pixels(plates, count, mask=mask), pixels(shot, count)
    inside = made[..., 3] > 0
    error = np.sqrt(((found - made)[inside][:, :3] ** 2).mean())
    relit = folder / "relit.%04d.exr"
    from_shot, relighting = timed(relight.render_shot, shot, LIGHTS, relit)
    cropped, _ = timed(relight.render_shot, shot, LIGHTS, relight.Output(relit, autocrop=True))
    from_plates, _ = timed(relight.render_shot, source, LIGHTS, relit)
    print(f"| {frames} frames | from the plates | from the analysis | ratio |\n|---|---|---|---|")
    print(f"| to relit pixels | {direct:.2f} s | {kept:.3f} s | {direct / kept:.1f} |")
    print(
        f"| to .exr files | {from_plates / frames:.2f} s | {from_shot / frames:.3f} s "
        f"| {from_plates / from_shot:.1f} |"
    )
    print(f"to .exr files, autocropped, from the analysis {cropped / frames:.3f} s; the analysis itself")
    print(f"{analysis / frames:.2f} s a frame, {max(sizes) / 1e6:.2f} MB at most; relit RMS {error:.5f}")
    for name, held in (("analysing", analysing), ("relighting", relighting)):
        print(f"memory, {name}: {held[9]:.0f} MiB after 10 frames, {held[-1]:.0f} MiB after {frames}")
    print(flush=True)


def measure_close_up(folder):
    plate, matte = photographed(0, 0, 1700, 7)
    subject, path = relight.Subject(plate, matte, height=0.6), folder / "kept.safetensors"
    subject.save(path)
    error = (relight.Subject.load(path).relit(LIGHTS) - subject.relit(LIGHTS))[matte > 0][:, :3]
    share, size = (matte > 0).mean(), path.stat().st_size / 1e6
    print(f"close-up, {share:.0%} of the frame: {size:.2f} MB, relit RMS {np.sqrt((error**2).mean()):.5f}")


if __name__ == "__main__":
    torch.set_num_threads(1)
    small = np.zeros((64, 48, 4), np.float32)
    small[8:60, 12:36] = (0.4, 0.3, 0.2, 1)
    relight.Subject(small).relit(LIGHTS)  # the networks' weights are loaded, and the first steps made
    for frames in map(int, sys.argv[1:] or (20, 200)):
        with tempfile.TemporaryDirectory() as folder:
            measure(Path(folder), frames)
    with tempfile.TemporaryDirectory() as folder:
        measure_close_up(Path(folder))
