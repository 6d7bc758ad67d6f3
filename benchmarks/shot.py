"""Measure what a frame of a shot costs, by phases, and what a stored analysis saves.

    OMP_NUM_THREADS=1 ATEN_CPU_CAPABILITY=avx2 ONEDNN_MAX_CPU_ISA=AVX2 python benchmarks/shot.py
    OMP_NUM_THREADS=1 python benchmarks/shot.py 20 200

The first command has the networks run in float32, as processors without bfloat16 do. It prints a table of a
frame of HD and of 4K, from OpenEXR to OpenEXR; a second lighting from the analysis cache; storing an
analysis; the peak memory of a process that relights one frame; and what OpenEXR's lossless compressions cost
for the 12 channels of the 4K frame. The second command relights shots of as
many frames from their stored analysis and without it, and prints ratios, memory and disk space.

The bundled person drifts across the frame, photographed with noise, and is relit by a key light and a rim.
Times are user time of one thread, without imports: the quickest of REPEATS runs. Memory after the tenth frame
and after the last one shows whether it grows with the shot, which it should not. Figures to compare with are
in docs/video.md.
"""

import cProfile
import functools
import io
import pstats
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import OpenEXR
import torch
from flicker import moved
from timing import quickest

import relight
from relight.pipeline.shot import Shot
from relight.rendering import render_subject

PERSON = Path(__file__).parents[1] / "examples" / "person.png"
SIZE = 1080, 1920
SIZES = {"HD": SIZE, "4K": (2160, 3840)}
REPEATS = 5
PHASES = {  # what a phase is called: functions whose time it is, (end of the file's name, function)
    "reading": [("images/reading.py", "read"), ("images/maps.py", "read_mask")],
    "checking, cleaning the matte": [("analysis/infer.py", "check_inputs")],
    "filling the unknown": [("analysis/foreground.py", "own_colour")],
    "both networks": [("shading/analysis.py", "__init__")],
    "old light and its noise": [("analysis/denoising.py", "denoised"), ("analysis/old_light.py", "fit")],
    "upsampling": [("analysis/upsampling.py", "__init__"), ("analysis/upsampling.py", "__call__")],
    "scattering": [("analysis/foreground.py", "scatter")],
    "writing": [("images/writing.py", "write")],
    "storing": [("analysis/storage.py", "write_record")],
}
LIGHTS = [
    relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2, name="key"),
    relight.DirectionalLight(azimuth=150, elevation=20, name="rim"),
]


def photographed(number, x, y, scale, size=SIZE):
    """A plate with noise and its matte: the person `scale` times as large, at (x, y) from the middle."""
    picture = moved(relight.read(PERSON), x, y, scale, size).clip(0)
    picture[..., 3] = picture[..., 3].clip(0, 1)
    plate = relight.over(picture, (0.3, 0.3, 0.3))
    plate *= 1 + np.random.default_rng(number).normal(0, 0.02, plate.shape).astype(np.float32)
    return plate.clip(0), picture[..., 3]


def write_plates(folder, frames, size=SIZE):
    """Plates and mattes, numbered from 1."""
    for number in range(1, frames + 1):
        plate, matte = photographed(number, 3.7 * number % 400, 0, 1.06 * size[0] / SIZE[0], size)
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


def user_time():
    """Seconds of processor time outside the kernel, which does not count what other processes do."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime


def profiled(function, *arguments):
    """User and system seconds of the quickest of several calls, and the seconds of each phase."""
    best = None
    for _ in range(REPEATS):
        profile, before = cProfile.Profile(user_time), resource.getrusage(resource.RUSAGE_SELF)
        profile.runcall(function, *arguments)
        after = resource.getrusage(resource.RUSAGE_SELF)
        user, system = after.ru_utime - before.ru_utime, after.ru_stime - before.ru_stime
        if best is None or user < best[0]:
            calls = pstats.Stats(profile, stream=io.StringIO()).stats.items()
            best = user, system, {phase: seconds_in(calls, called) for phase, called in PHASES.items()}
    return best


def seconds_in(calls, functions):
    """Seconds in all calls of some functions, of the statistics of a profile."""
    return sum(
        spent[3]
        for (file, _, name), spent in calls
        if any(file.endswith(end) and name == called for end, called in functions)
    )


def one_frame(folder):
    """The source of the first frame alone, as a still."""
    return relight.Source(folder / "plate.0001.exr", mask=folder / "matte.0001.png")


def analysed_again(source, folder):
    """Analyse a still and store its analysis, even if it is stored already."""
    (folder / "still.safetensors").unlink(missing_ok=True)
    relight.analyse_shot(source, folder)


def measure_phases(folder):
    """Print the phases of one frame at each size: from the plate, from the analysis cache, and storing it."""
    columns = {}
    for name, size in SIZES.items():
        place = folder / name
        place.mkdir()
        write_plates(place, 1, size)
        source, kept, relit = one_frame(place), place / "kept.relight", place / "relit.exr"
        columns[f"{name}, analysed and stored"] = profiled(analysed_again, source, kept)
        columns[f"{name}, from the plate"] = profiled(relight.render_shot, source, LIGHTS, relit)
        columns[f"{name}, from the cache"] = profiled(relight.render_shot, kept, LIGHTS, relit)
    print(f"| seconds | {' | '.join(columns)} |\n|---|{'---|' * len(columns)}")
    for phase in PHASES:
        print(f"| {phase} | {' | '.join(f'{phases[phase]:.2f}' for _, _, phases in columns.values())} |")
    print(f"| user time | {' | '.join(f'{user:.2f}' for user, _, _ in columns.values())} |")
    print(f"| and system time | {' | '.join(f'{system:.2f}' for _, system, _ in columns.values())} |")
    for name in SIZES:
        output = subprocess.run(
            [sys.executable, __file__, "--peak", str(folder / name)],
            check=True,
            capture_output=True,
            text=True,
        )
        print(f"peak memory of one frame, {name}: {output.stdout.strip()}")
    print_compressions(folder / "4K" / "relit.exr")


def print_compressions(relit):
    """Print seconds and size of a relit frame in each lossless compression of OpenEXR."""
    with OpenEXR.File(str(relit), separate_channels=True) as file:
        header = file.header()
        planes = {name: channel.pixels.copy() for name, channel in file.channels().items()}
    for name in ("NO", "RLE", "ZIPS", "ZIP", "PIZ"):
        header["compression"] = getattr(OpenEXR, f"{name}_COMPRESSION")
        write = functools.partial(OpenEXR.File(header, planes).write, str(relit))
        seconds = quickest(write, REPEATS, user_time)
        print(f"{name}: {seconds:.2f} s, {relit.stat().st_size / 1e6:.1f} MB")


def print_peak(folder):
    """Relight one frame, and print the most memory that this process has held."""
    relight.render_shot(one_frame(folder), LIGHTS, folder / "peak.exr")
    status = Path("/proc/self/status").read_text()  # resource's figure would begin with that of the parent
    print(f"{int(status.split('VmHWM:')[1].split()[0]) / 1024:.0f} MiB")


if __name__ == "__main__":
    torch.set_num_threads(1)
    if sys.argv[1:2] == ["--peak"]:
        sys.exit(print_peak(Path(sys.argv[2])))
    small = np.zeros((64, 48, 4), np.float32)
    small[8:60, 12:36] = (0.4, 0.3, 0.2, 1)
    relight.Subject(small).relit(LIGHTS)  # the networks' weights are loaded, and the first steps made
    for frames in map(int, sys.argv[1:]):
        with tempfile.TemporaryDirectory() as folder:
            measure(Path(folder), frames)
    with tempfile.TemporaryDirectory() as folder:
        if sys.argv[1:]:
            measure_close_up(Path(folder))
        else:
            measure_phases(Path(folder))
