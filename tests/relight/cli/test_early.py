"""What can be refused at once is refused before torch is loaded, which takes seconds."""

import subprocess
import sys

import pytest
from helpers import ROOT

from relight.pipeline.early_checks import check_there

PERSON = str(ROOT / "examples" / "person.png")
RUN = """
import sys
from typer.testing import CliRunner
from relight.cli.commands import app
for line in sys.stdin:
    print(CliRunner().invoke(app, line.split()).output.strip())
print("torch" in sys.modules)
"""
MISTAKES = {
    "apply persn.png --preset rim -o a.png": "persn.png: no such file; did you mean person.png?",
    f"apply {PERSON} --preset rimm -o a.png": "did you mean rim?",
    f"apply {PERSON} --preset rim -o a.xyz": "a.xyz: expected a file name that ends in",
    f"apply {PERSON} --light azimut=3 -o a.png": "did you mean azimuth?",
    f"apply {PERSON} --light left -o a.png": "did you mean azimuth=left?",
    f"apply {PERSON} -o a.png": "lights: expected at least one",
    f"apply {PERSON} --preset rim --background blak -o a.png": "did you mean black?",
    f"apply {PERSON} --environment sky.exr -o a.png": "sky.exr: no such file",
    f"apply {PERSON} --preset rim --mask m.png -o a.png": "m.png: no such file",
    "view https://example.org/a.jpg -o a.html": "is an address; download the picture",
    "olat persn.png -o a.exr": "persn.png: no such file",
    "gui": "the application opens by: relight app",
}


def test_mistakes_are_told_without_torch(here):
    (here / "person.png").touch()
    command = [sys.executable, "-c", RUN]
    run = subprocess.run(
        command, input="\n".join(MISTAKES), capture_output=True, text=True, check=True, cwd=here
    )
    *lines, torch = run.stdout.splitlines()
    assert torch == "False"
    assert len(lines) == len(MISTAKES)
    for line, says in zip(lines, MISTAKES.values(), strict=True):
        assert line.startswith("relight: ")
        assert says in line


@pytest.mark.parametrize("name", ["p.exr:albedo", "p.%04d.png", "."])
def test_layers_frames_and_folders_are_looked_for_later(here, name):
    (here / "p.exr").touch()
    check_there(name)
