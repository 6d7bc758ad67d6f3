"""Many pictures in one command: each gets its own file, and one that fails stops no other."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import relight
from relight.cli.commands import app

LAMP = ("--light", "azimuth=10")


@pytest.fixture(autouse=True)
def folder(here):
    """A folder `in` of two people, one file that is no picture, and notes."""
    person = np.zeros((64, 48, 4), np.float32)
    person[8:56, 12:36] = 0.3, 0.3, 0.3, 1
    Path("in").mkdir()
    for name in ("a.png", "b.tif"):
        relight.write(f"in/{name}", person)
    Path("in/broken.jpg").write_text("no picture")
    Path("in/notes.txt").write_text("notes")


def run(*arguments):
    result = CliRunner().invoke(app, ["apply", *arguments, *LAMP])
    return result.exit_code, result.output


def test_a_folder_goes_to_a_folder_and_a_failure_stops_no_other():
    code, said = run("in", "-o", "out")
    assert code == 1
    assert sorted(path.name for path in Path("out").iterdir()) == ["a.png", "b.tif"]
    assert "2 of 3 pictures made; not made:\nin/broken.jpg: cannot be read" in said
    assert "notes" not in said


def test_names_of_outputs_are_filled_and_resume_keeps_what_there_is():
    given = ("in/a.png", "in/b.tif", "-o", "out/{name}.exr", "--save-matte", "mattes/{name}.png")
    assert run(*given)[0] == 0
    before = {path: path.stat().st_mtime_ns for path in Path("out").iterdir()}
    assert sorted(path.name for path in before) == ["a.exr", "b.exr"]
    assert sorted(path.name for path in Path("mattes").iterdir()) == ["a.png", "b.png"]
    assert run(*given, "--resume")[0] == 0
    assert {path: path.stat().st_mtime_ns for path in Path("out").iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            ("in", "-o", "a.png"),
            "a.png: expected {name} in the name, such as out/{name}.png, or a folder",
        ),
        (("in/a.png", "in/../in/a.png", "-o", "out"), "out/a.png: is that of two pictures"),
        (("in", "-o", "out/{name}.xyz"), "out/a.xyz: expected a file name that ends in"),
        (("in", "-o", "out", "--workers", "2"), "SOURCE: expected one"),
    ],
)
def test_what_cannot_be_meant_is_refused_before_any_picture(arguments, says):
    code, said = run(*arguments)
    assert (code, len(said.splitlines())) == (2, 1)
    assert says in said
