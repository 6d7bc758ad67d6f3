"""Check that a run that is killed and resumed gives the same result as an uninterrupted one.

python benchmarks/kill.py [KILLS] [--seed SEED]

`relight video` lights a photograph by a turning light, and writes OpenEXR files, PNG files, MOV and MP4, in
turn. Each run is killed (SIGKILL) a few milliseconds after it has written a random number of frames, which
the seed determines, and is then resumed. The result must match that of an uninterrupted run: the same files,
with the same pictures, pixel by pixel. Prints the number of runs that differ.

A good result is 0 runs that differ.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from random import Random

import numpy as np
from checkout import ROOT
from helpers.killing import differences, finished, kill

import relight

OUTPUTS = ("relit.%03d.exr", "relit.%03d.png", "relit.mov", "relit.mp4")
FRAMES = 48
LATER = 0.1  # seconds at most from a frame to the kill


def write_plate(folder):
    """A photograph with alpha, of a figure that is two boxes. Returns its video's command line."""
    person = np.zeros((160, 120, 4), np.float32)
    person[16:150, 45:75] = person[48:64, 20:100] = 1
    person[..., :3] *= np.random.default_rng(0).uniform(0.05, 0.6, (160, 120, 3)).astype(np.float32)
    relight.write(folder / "person.exr", person)
    command = [sys.executable, "-m", "relight.cli", "video", str(folder / "person.exr"), "--resume"]
    command += ["--light", f"key:orbit={FRAMES},elevation=30", "--light", "fill:azimuth=60,intensity=0.3"]
    return [*command, "--background", "0.1/0.1/0.1", "--frames", f"1-{FRAMES}", "-o"]


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kills", type=int, nargs="?", default=20)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    random = Random(given.seed)
    settings = {
        "env": os.environ | {"PYTHONPATH": str(ROOT)},
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
    }
    equal = killed = 0
    with tempfile.TemporaryDirectory() as top:
        command = write_plate(Path(top))
        for number in range(given.kills):
            name = OUTPUTS[number % len(OUTPUTS)]
            whole, folder = Path(top, Path(name).suffix[1:]), Path(top, str(number))
            if not whole.exists():
                whole.mkdir()
                subprocess.run([*command, str(whole / name)], check=True, **settings)
            folder.mkdir()
            files, delay = random.randint(0, FRAMES), random.uniform(0, LATER)
            alive = kill([*command, str(folder / name)], folder, files, delay, **settings)
            there = len(finished(folder))
            subprocess.run([*command, str(folder / name)], check=True, **settings)
            wrong = differences(folder, whole)
            killed, equal = killed + alive, equal + (alive and not wrong)
            print(
                f"{name}: {'killed' if alive else 'had ended'} with {there} files;",
                *wrong or ["equal"],
                flush=True,
            )
    print(f"{killed} kills, {equal} runs equal to the uninterrupted one")


if __name__ == "__main__":
    main()
