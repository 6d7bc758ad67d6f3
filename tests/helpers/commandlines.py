"""Command lines of `relight apply` that nobody meant well."""

import contextlib
import os
import shutil
from pathlib import Path
from random import Random

import numpy as np
from typer.testing import CliRunner

import relight
from helpers import hostile
from helpers.damage import small_canvas
from helpers.invariants import require, require_finite, require_usable
from relight.cli.commands import app
from relight.media.movies import Movie, is_movie

ODD = [word for word in hostile.WORDS if "\x00" not in word and "\ud800" not in word]
ODD += [
    "missing.png",
    "folder",
    "broken.png",
    "lights.yaml",
    "-1",
    "0",
    "1e400",
    "\udcff.png",
    "--",
    "-o",
    "@a",
]
LIGHTS = [
    "key:azimuth=-40,elevation=30,intensity=2,colour=1/0.9/0.8",
    "azimuth=60,angle=10",
    "lamp:position=-0.6/0.4/0.8,radius=0.1",
    "softbox:position=1/1/1,toward=0/0/0,width=0.5,height=0.5",
    "turning:orbit=4,elevation=30",
    "direction=0/1/-1,temperature=3200,exposure=-1",
]
FITTING = {  # values of each option that a picture of 24 rows and 20 columns takes
    "--light": LIGHTS,
    "--environment": ["sky.exr", "sky.exr,rotation=90,intensity=2"],
    "--lights": ["lights.yaml"],
    "--save-lights": ["out/lights.yaml", "out/lights.json"],
    "--mask": ["mask.png", "person.exr"],
    "--key": ["green", "blue"],
    "--matte": ["missing.onnx", "missing.onnx,mean=0/0/0,std=1/1/1,size=320"],
    "--refine-matte": ["2"],
    "--person": ["1", "2", "5/5"],
    "--background": ["0.1/0.2/0.3", "sky.exr", "environment", "photo.png"],
    "--field-of-view": ["40", "10.5"],
    "--match-plate": [None],
    "--match": ["person.exr"],
    "--match-mask": ["mask.png"],
    "--size": ["32x24", "background", "20x24"],
    "--placement": ["fit", "fill", "centre"],
    "--scale": ["0.5", "2"],
    "--offset": ["1/-2", "0/0"],
    "--colour-space": ["sRGB", "lin_rec709", "ACEScg"],
    "--normals": ["normals.png"],
    "--axes": ["+x-y-z", "+x+y+z"],
    "--depth": ["depth.exr"],
    "--height": ["1.2"],
    "--passes": ["albedo,N,Z,visibility,shading,gloss", "N"],
    "--exr-type": ["half", "float"],
    "--gloss": ["0.5", "1"],
    "--floor": ["height=1.5,horizon=0.45", "feet=4/22/12/22"],
    "--view": ["aces"],
    "--exposure": ["-1", "2.5"],
    "--save-matte": ["out/matte.png", "out/matte.exr"],
    "--device": ["cpu"],
    "--precision": ["float32"],  # it is the process's: another would slow what comes after
    "--frames": ["1-2", "2", "1-10x3"],
    "--rate": ["24", "23.976"],
    "--resume": [None],
    "--threads": ["1"],
}
OF_VIDEO = ("--precision", "--frames", "--rate", "--resume", "--threads")
STILLS = ["out/a.exr", "out/a.png", "out/a.tif", "out/a.jpg"]
SHOTS = ["out/a.%04d.exr", "out/a.####.png", "out/a.mov", "out/a.mp4"]


def command_line(random: Random, folder: Path) -> None:
    """It ends with exit code 0 and readable files, or with 2 and an error in one line."""
    _write_inputs(folder)
    words = _words(random)
    with contextlib.chdir(folder), small_canvas():
        shutil.rmtree("out", ignore_errors=True)
        Path("out").mkdir()
        result = CliRunner().invoke(app, words)
        if not isinstance(result.exception, SystemExit | None):
            raise RuntimeError(f"{words}") from result.exception
        require(result.exit_code in (0, 2), f"{words}: exit code {result.exit_code}")
        left = [path.name for path in Path("out").rglob(".*")]
        require(not left, f"{words}: leaves {left}")
        for path in Path("out").rglob("*.*"):
            _check_written(path)
    if result.exit_code == 2:
        ours = [line for line in result.stderr.splitlines() if line.startswith("relight: ")]
        require(len(ours) == 1 or "─ Error ─" in result.stderr, f"{words}: {result.stderr!r}")
        require_usable(ours[0] if ours else "usage")
        raise ValueError(ours[0] if ours else "usage")


def _write_inputs(folder: Path) -> None:
    if (folder / "folder").exists():
        return
    rng = np.random.default_rng(1)
    person = np.zeros((24, 20, 4), np.float32)
    person[4:22, 6:14, :3], person[4:22, 6:14, 3] = rng.uniform(0, 1, (18, 8, 3)), 1
    relight.write(folder / "photo.png", person[..., :3])
    relight.write(folder / "person.exr", person)
    relight.write_mask(folder / "mask.png", person[..., 3])
    for number in (1, 2):
        relight.write(folder / f"p.{number:04d}.exr", person)
    relight.write(folder / "sky.exr", rng.uniform(0, 1, (8, 16, 3)).astype(np.float32))
    relight.write(folder / "normals.png", np.full((24, 20, 3), (128, 128, 255), np.uint8))
    relight.write(folder / "depth.exr", np.zeros((24, 20, 3), np.float32))
    relight.write_lights(folder / "lights.yaml", [relight.DirectionalLight(azimuth=10, name="sun")])
    (folder / "broken.png").write_bytes((folder / "photo.png").read_bytes()[:99])
    (folder / "folder").mkdir()


def _words(random: Random) -> list[str]:
    video = random.random() < 0.2
    if video:
        words = ["video", random.choice(["p.%04d.exr", "p.####.exr", "person.exr"])]
    else:
        words = ["apply", *random.choice([["person.exr"], ["photo.png", "--mask", "mask.png"]])]
    words += ["-o", random.choice(SHOTS if video else STILLS)]
    names = [name for name in FITTING if video or name not in OF_VIDEO]
    for name in ["--light", *random.sample(names, random.randrange(4))]:
        value = random.choice(FITTING[name])
        draw = random.random()
        if value is not None and draw < 0.25:
            value = random.choice(ODD) if draw < 0.1 else _argument(hostile.edited(random, value))
        words += [name] if value is None else [name, value]
    if random.random() < 0.2:
        here = random.randrange(len(words))
        words[here : here + 1] = random.choice([[], [random.choice(ODD)], [words[here]] * 2])
    return words


def _argument(text: str) -> str:
    """What a system hands a program of the text: no NUL, and bytes that are no UTF-8 as Python has them."""
    return os.fsdecode(text.replace("\x00", "").encode("utf-8", "surrogatepass"))


def _check_written(path: Path) -> None:
    if is_movie(path):
        movie = Movie(path)
        for number in movie.numbers:
            require_finite(str(path), movie.read(number))
    elif path.suffix in (".exr", ".png", ".tif", ".jpg"):
        require_finite(str(path), relight.read(path))
