"""What a command refuses it refuses before any work: no network is asked, no file is touched."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import relight
from relight.cli.commands import app
from relight.errors import MissingNetworksError
from relight.pipeline import render

STILL = ["apply", "photo.png", "--mask", "mask.png", "-o", "a.exr"]
SHOT = ["video", "p.%04d.png", "-o", "a.%d.png"]
LAMP = ["--light", "azimuth=10"]
FRAMES = "expected a movie, or a frame number in the name, such as relit.%04d.exr, as the source has frames"


@pytest.fixture(autouse=True)
def folder(tmp_path, here):
    """A photograph, its matte, a sequence with alpha, a sky, lights and the frames kept of a movie."""
    person = np.zeros((24, 20, 4), np.float32)
    person[4:20, 4:16] = 0.5, 0.4, 0.3, 1
    relight.write("photo.png", person[..., :3])
    relight.write_mask("mask.png", person[..., 3])
    for number in (0, 1, 2):
        relight.write(f"p.{number:04d}.png", person)
    relight.write("sky.exr", np.full((16, 32, 3), 0.5, np.float32))
    relight.write_lights("lights.yaml", [relight.DirectionalLight(azimuth=10, name="sun")])
    Path("notes.txt").write_text("notes")
    Path("a.mov.frames").mkdir()
    relight.write("a.mov.frames/000001.tif", person)
    Path("q.2.png").symlink_to("p.0002.png")


def run(*arguments):
    return CliRunner().invoke(app, [*arguments])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([*STILL, "--environment", "sky.exr", "-o", "sky.exr"], "sky.exr: is read as well"),
        (
            [*STILL, "--lights", "lights.yaml", "--save-lights", "./lights.yaml"],
            "lights.yaml: is read as well",
        ),
        ([*STILL, *LAMP, "--save-lights", "gone/l.yaml"], "gone/l.yaml: the folder gone does not exist"),
        (
            ["apply", "photo.png", "-o", "a.png", "--save-lights", "l.yaml", *LAMP],
            "(--mask FILE), name a matting model (--matte MODEL), or key the person",
        ),
        (["apply", "p.%04d.png", "-o", "a.png", *LAMP], f"a.png: {FRAMES}; or choose one frame (--frames 0)"),
        (
            ["apply", "notes.txt", "-o", "a.png", *LAMP],
            "notes.txt: cannot be read as an image: its format is not known",
        ),
        ([*STILL, "--preset", "rembrant"], "preset: no preset is called 'rembrant'; did you mean rembrandt"),
        (["app", "--root", "gone"], "gone: expected a folder to choose pictures from"),
        ([*STILL, *LAMP, "--background", "p.####.png"], f"a.exr: {FRAMES}"),
        (
            [*STILL, *LAMP, "--save-matte", "m.%04d.png"],
            "m.%04d.png: expected a single file, as a.exr has it",
        ),
        ([*STILL, *LAMP, "--size", "65536x65536"], "size: expected up to 268435456 pixels in all"),
        ([*STILL, *LAMP, "--field-of-view", "0"], "field_of_view: expected"),
        ([*STILL, *LAMP, "--background", "#202020ff"], "expected linear red/green/blue"),
        (
            [*STILL, "--light", "background:azimuth=1", "--background", "0/0/0"],
            "names the background's layer",
        ),
        ([*SHOT, "--light", "background:azimuth=1", "--background", "0/0/0"], "names the background's layer"),
        (
            [*SHOT, *LAMP, "-o", "b.mov", "--rate", "0"],
            "rate: expected a number of frames a second",
        ),
        (
            [*SHOT, *LAMP, "-o", "b.mov", "--rate", "nan"],
            "rate: expected a finite number of frames",
        ),
        (
            [*SHOT, *LAMP, "-o", "a.mov", "--save-matte", "m.png"],
            "m.png: expected a frame number in the name",
        ),
        ([*SHOT, *LAMP, "-o", "a.mov", "--save-lights", "gone/l.yaml"], "the folder gone does not exist"),
        (["video", "a.mov.frames/%06d.tif", *LAMP, "-o", "a.mov"], "a.mov: is read as well"),
        (["video", "p.%04d.png", *LAMP, "-o", "q.%d.png"], "q.%d.png: is read as well"),
    ],
)
def test_a_refused_command_prints_one_line_and_changes_no_file(tmp_path, no_networks, arguments, message):
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    assert message in result.output
    line = result.output.strip()  # a progress bar ends with an empty line
    assert line.startswith("relight: ")
    assert "\n" not in line
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_too_little_memory_is_one_line(monkeypatch):
    def full(*arguments, **options):
        raise MemoryError("Unable to allocate 16.0 GiB")

    monkeypatch.setattr(render, "render_shot", full)
    result = run(*STILL, *LAMP)
    assert (result.exit_code, result.output) == (
        2,
        "relight: not enough memory: Unable to allocate 16.0 GiB\n",
    )


@pytest.mark.slow
def test_a_resumed_shot_makes_the_mattes_that_are_missing():
    command = (*SHOT, *LAMP, "--save-matte", "m.%d.png")
    assert run(*command).exit_code == 0
    Path("m.2.png").unlink()
    kept = {name: Path(name).read_bytes() for name in ("a.0.png", "a.2.png", "m.1.png")}
    result = run(*command, "--resume")
    assert result.exit_code == 0, result.output
    assert {name: Path(name).read_bytes() for name in kept} == kept
    np.testing.assert_allclose(relight.read_mask("m.2.png"), relight.read("p.0002.png")[..., 3], atol=1 / 255)


def test_errors_name_arguments_in_python_and_options_in_the_command(tmp_path):
    """What follows an argument's name in brackets is written as whoever reads it would type it."""
    photograph = tmp_path / "p.png"
    relight.write(photograph, np.full((32, 24, 3), 0.2, np.float32))
    with pytest.raises(
        MissingNetworksError, match=r"person's matte \(mask=FILE\), name a matting model \(matte=MODEL\)"
    ):
        relight.render_shot(photograph, relight.DirectionalLight(azimuth=-40), tmp_path / "o.png")
    refused = CliRunner().invoke(
        app, ["apply", str(photograph), "--preset", "rim", "-o", str(tmp_path / "o.png")]
    )
    assert "(--mask FILE), name a matting model (--matte MODEL)" in " ".join(refused.output.split())
