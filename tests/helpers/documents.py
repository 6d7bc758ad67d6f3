"""The commands and snippets of README.md and docs, taken out of their text, and the desk they are tried at.

A fenced block may have a comment before it:

    <!-- smaller: --steps 2 --size 128 --> it is run with these values in place of its own
    <!-- also: --batch 2 -->               it is run with these words after its own
    <!-- needs: your own checkpoint -->    it is not run: nobody can ship what it needs
"""

import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

import relight
from helpers import ROOT, lamps
from relight.cli.commands import app
from relight.media.movies import write_movie

DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"((?:^<!-- [^\n]* -->\n)*)^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# What whoever runs these tests has done already; continuous integration does it as README.md says.
DONE = ("python3 -m venv .venv", ".venv/bin/pip install ", ".venv/bin/pytest")


@dataclass(frozen=True)
class Block:
    document: Path
    line: int  # of the text's first line
    language: str
    text: str
    comments: tuple[str, ...]

    def __str__(self):
        return f"{self.document.name}:{self.line}"

    def comment(self, kind):
        """What a comment says after `kind:`, or "" if it says no more; None without one."""
        found = [text.removeprefix(kind).lstrip(": ") for text in self.comments if text.startswith(kind)]
        return found[0] if found else None

    @property
    def needs(self):
        return self.comment("needs")

    def commands(self):
        """The words of each command, with the values of a `smaller` and the words of an `also` comment."""
        smaller, also = (shlex.split(self.comment(kind) or "") for kind in ("smaller", "also"))
        values = dict(zip(smaller[::2], smaller[1::2], strict=True))
        for line in self.text.replace("\\\n", " ").splitlines():
            for command in line.split(" && "):
                if command.strip().startswith(DONE):
                    continue
                words = shlex.split(command, comments=True)
                own = [values.get(before, word) for before, word in zip(["", *words], words, strict=False)]
                yield own + also


def blocks(document):
    text = document.read_text()
    for match in FENCE.finditer(text):
        comments = tuple(line[5:-4] for line in match[1].splitlines())
        line = text[: match.start(3)].count("\n") + 1
        yield Block(document, line, match[2], match[3], comments)


def run(words, folder, apart=False):
    """A command of the documents, in a process of its own if `apart`; AssertionError if it fails."""
    program, *arguments = words
    programs = {
        "relight": ["-m", "relight.cli"],
        ".venv/bin/relight": ["-m", "relight.cli"],
        "python": [],
        ".venv/bin/python": [],
        "torchrun": ["-m", "torch.distributed.run"],
    }
    assert program in programs, f"{program} is no command that these tests know"
    if apart or programs[program] != ["-m", "relight.cli"]:
        done = subprocess.run(
            [sys.executable, *programs[program], *arguments], cwd=folder, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "leaked" not in done.stderr
    else:
        done = CliRunner().invoke(app, arguments)
        assert done.exit_code == 0, done.output or done.exception


def lay_out(folder):
    """The files that the documents name, small."""
    for name in ("benchmarks", "docs"):
        (folder / name).symlink_to(ROOT / name)
    (folder / "examples").mkdir()
    for path in (ROOT / "examples").iterdir():
        (folder / "examples" / path.name).symlink_to(path)
    person = np.ascontiguousarray(relight.read(ROOT / "examples" / "person.png")[::6, ::6])
    (folder / "examples" / "person.png").unlink()
    relight.write(folder / "examples" / "person.png", person)
    rows, columns = person.shape[:2]
    matte = person[..., 3]
    shades = np.linspace(0.05, 0.5, 96 * 160 * 3, dtype=np.float32).reshape(96, 160, 3)
    photograph = relight.over(person, shades)
    screen = relight.over(person, (0.05, 0.5, 0.08))
    for path in ("photo.png", "photo.jpg", "reference.png"):
        relight.write(folder / path, photograph)
    relight.write_mask(folder / "matte.png", matte)
    relight.write(folder / "reference_cut.png", person)
    relight.write(folder / "studio.png", screen)
    (folder / "lamp.ies").write_text(lamps.ies([[900, 700, 100]], [0, 45, 90], [0]))
    strokes = np.zeros((rows, columns, 4), np.uint8)
    strokes[:, : columns // 2] = (255, 0, 0, 255)
    relight.write(folder / "strokes.png", strokes)
    for path in ("street.jpg", "street.exr"):
        relight.write(folder / path, shades)
    sky = np.full((32, 64, 3), 0.3, np.float32)
    sky[8, 20] = 60
    relight.write(folder / "sky.exr", sky)
    lights = [
        relight.DirectionalLight(azimuth=-40, name="key"),
        relight.DirectionalLight(azimuth=140, name="rim"),
    ]
    relight.write_lights(folder / "lights.yaml", lights)
    turned = np.zeros((rows, columns, 3), np.float32)
    turned[matte > 0] = (0, 0, -1)  # toward the camera, in OpenCV's axes
    relight.write(folder / "normals.exr", turned)
    for number in range(1, 5):
        moved = np.roll(person, number, axis=1)
        relight.write(folder / f"plate.{number:04d}.exr", relight.over(moved, shades))
        relight.write_mask(folder / f"matte.{number:04d}.png", moved[..., 3])
    write_movie(folder / "studio.mov", [screen] * 3)
    write_movie(folder / "street.mov", [shades] * 3)
    meshes(folder)


def meshes(folder):
    """A scan, and a list of such."""
    import trimesh

    post = trimesh.creation.capsule(height=1.4, radius=0.2, count=(12, 12))
    post.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    post.visual.vertex_colors = (150, 110, 90, 255)
    post.export(folder / "someone.glb")
    (folder / "scans.txt").write_text("someone.glb\n")
