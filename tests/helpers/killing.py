"""Runs that are killed at some moment: shared by test_kill.py and benchmarks/kill.py."""

import subprocess
import time
from pathlib import Path

import numpy as np

import relight
from relight.media.movies import Movie

PATIENCE = 300  # seconds for a run to get as far as it should


def kill(command: list[str], folder: Path, files: int, delay: float, **settings) -> bool:
    """Start a command, and SIGKILL it `delay` seconds after it has as many files in the folder.

    False if it had ended by then, as a whole run should; RuntimeError if it failed or takes too long.
    """
    with subprocess.Popen(command, **settings) as process:
        end = time.monotonic() + PATIENCE
        while process.poll() is None and len(finished(folder)) < files:
            if time.monotonic() > end:
                process.kill()
                raise RuntimeError(f"{files} files are not there after {PATIENCE} s")
            time.sleep(0.002)
        time.sleep(delay)
        alive = process.poll() is None
        process.kill()
    if not alive and process.returncode:
        raise RuntimeError(f"{' '.join(command)}: exit status {process.returncode}")
    return alive


def finished(folder: Path) -> list[Path]:
    """The files in a folder and the folders in it, but for those that are still being written."""
    return sorted(path for path in folder.rglob("[!.]*") if path.is_file())


def differences(folder: Path, whole: Path) -> list[str]:
    """What is different in a folder from that of an uninterrupted run: files there or not, and pictures."""
    found, expected = (sorted(path.relative_to(top) for path in top.rglob("*")) for top in (folder, whole))
    wrong = [f"{path}: is in one only" for path in sorted({*found} ^ {*expected})]
    for path in sorted({*found} & {*expected}):
        one, other = pictures(folder / path), pictures(whole / path)
        if len(one) != len(other) or not all(map(np.array_equal, one, other)):
            wrong.append(f"{path}: differs")
    return wrong


def pictures(path: Path) -> list[np.ndarray]:
    """All that a file shows: a movie's frames, a picture and its layers; of a script, its bytes."""
    if path.is_dir():
        return []
    if path.suffix in (".nk", ".safetensors"):
        return [np.frombuffer(path.read_bytes(), np.uint8)]
    if path.suffix in (".mov", ".mp4"):
        movie = Movie(path)
        return [movie.read(number) for number in movie.numbers]
    layers = relight.read_layers(path) if path.suffix == ".exr" else {}
    return [relight.read(path), *layers.values()]
