"""Measure the product on this machine: analysis of a photograph, lights, frames of a shot without files.

python benchmarks/gpu/measure.py [--tiny]

Prints a line for each figure as soon as it is known: seconds of the fastest of several repetitions.
"""

import argparse
import time

import numpy as np
import torch

import relight


def person(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """A noisy figure, linear (H, W, 3), and its matte: times depend on the size, not on what is seen."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float32) / height
    mask = (((x - width / height / 2) / 0.18) ** 2 + ((y - 0.5) / 0.46) ** 2 < 1).astype(np.float32)
    rgb = np.random.default_rng(0).uniform(0.2, 0.5, (height, width, 3)).astype(np.float32)
    return rgb * mask[..., None], mask


def fastest(repetitions: int, work) -> float:
    """Seconds of the fastest repetition, after one that is not counted."""
    times = []
    for _ in range(repetitions + 1):
        began = time.perf_counter()
        work()
        if torch.cuda.is_available():
            torch.cuda.synchronize()
        times.append(time.perf_counter() - began)
    return min(times[1:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tiny", action="store_true")
    given = parser.parse_args()
    device = "cuda" if torch.cuda.is_available() else "cpu"
    sizes = {"512 x 512": (512, 512), "1080 x 1920": (1080, 1920), "2160 x 3840": (2160, 3840)}
    repetitions = 5
    if given.tiny:
        sizes, repetitions = {"64 x 48": (64, 48)}, 1
    name = torch.cuda.get_device_name() if device == "cuda" else "CPU"
    print(f"{name}, torch {torch.__version__}", flush=True)
    lights = [relight.DirectionalLight(azimuth=-170 + 5.3 * number) for number in range(64)]
    for label, size in sizes.items():
        plate, mask = person(*size)
        analyse = lambda plate=plate, mask=mask: relight.Subject(plate, mask, device=device)  # noqa: E731
        print(f"{label}: analysis {fastest(repetitions, analyse):.4f} s", flush=True)
        subject = analyse()
        for count in (1, 64):
            seconds = fastest(repetitions, lambda subject=subject, count=count: subject.relit(lights[:count]))
            print(f"{label}: {count} lights {seconds:.4f} s", flush=True)
        frame = lambda analyse=analyse: analyse().relit(lights[:3])  # noqa: E731
        print(f"{label}: {1 / fastest(repetitions, frame):.2f} frames a second with 3 lights", flush=True)


if __name__ == "__main__":
    main()
