"""Every command takes an analysis cache: of a still, and of a shot."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import relight
from relight.cli.commands import app

LIGHT = ["--light", "key:azimuth=-40,elevation=30"]


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A plate, two frames of a sequence, and what `relight analyse` kept of them."""
    folder = tmp_path_factory.mktemp("kept")
    y, x = np.mgrid[:60, :50]
    for number in (7, 8):
        alpha = (np.hypot((x - 25) / 12, (y - 30) / 26) < 1).astype(np.float32)[..., None]
        colour = 0.3 + 0.2 * np.sin(y / 4 + number)[..., None] * (1, 0.8, 0.6)
        relight.write(
            folder / f"p.{number}.exr", np.concatenate([colour * alpha, alpha], -1).astype(np.float32)
        )
    shutil.copy(folder / "p.7.exr", folder / "p.exr")
    for plate, shot in (("p.exr", "still.relight"), ("p.%d.exr", "shot.relight")):
        assert relight.analyse_shot(folder / plate, folder / shot) == {}
    return folder


@pytest.fixture(autouse=True)
def folder(kept, tmp_path, here):
    shutil.copytree(kept, tmp_path, dirs_exist_ok=True)


def run(*words):
    return CliRunner().invoke(app, [*words])


@pytest.mark.parametrize("command", ["apply", "video"])
def test_a_kept_still_is_relit_to_a_still(command):
    assert run(command, "still.relight", *LIGHT, "-o", "a.exr", "-o", "a.png", "-o", "a.nk").exit_code == 0
    assert run(command, "p.exr", *LIGHT, "-o", "b.exr").exit_code == 0
    np.testing.assert_allclose(relight.read("a.exr"), relight.read("b.exr"), atol=0.02)
    assert relight.read("a.png").shape == (60, 50, 4)
    assert "\n last " not in Path("a.nk").read_text()


def test_a_kept_shot_is_relit_to_frames_or_to_one():
    assert run("apply", "shot.relight", *LIGHT, "-o", "a.%d.exr").exit_code == 0
    assert run("apply", "shot.relight", *LIGHT, "-o", "b.exr", "--frames", "8").exit_code == 0
    np.testing.assert_array_equal(relight.read("a.8.exr"), relight.read("b.exr"))
    assert Path("a.7.exr").exists()
    refused = run("apply", "shot.relight", *LIGHT, "-o", "b.exr")
    assert refused.exit_code == 2
    assert "or choose one frame (--frames 7)" in refused.output


@pytest.mark.parametrize("shot", ["still.relight", "shot.relight"])
def test_a_kept_analysis_has_a_page(shot):
    result = run("view", shot, "-o", "page.html")
    assert result.exit_code == 0, result.output
    assert Path("page.html").stat().st_size > 10_000
    frames = run("view", shot, "-o", "page.html", "--frame", "9")
    assert frames.exit_code == 2
    assert (
        "frame: a still has none"
        if shot == "still.relight"
        else "frame: expected a frame of the source, 7 to 8"
    ) in (frames.output)


def test_a_kept_shot_is_written_light_by_light():
    result = run("olat", "shot.relight", "--frame", "8", "-o", "o.exr")
    assert result.exit_code == 0, result.output
    assert len(relight.read_layers("o.exr")) == 64


def test_a_kept_analysis_is_the_source_of_a_job():
    result = run("job", "shot.relight", *LIGHT, "-o", "a.%d.exr", "-o", "job.json")
    assert result.exit_code == 0, result.output
    assert '"Analyse"' not in Path("job.json").read_text()


@pytest.mark.parametrize(
    ("command", "outputs"),
    [("apply", ["-o", "a.png", *LIGHT]), ("view", ["-o", "a.html"]), ("olat", ["-o", "a.exr"])],
)
@pytest.mark.parametrize("option", ["--field-of-view=40", "--height=1.7", "--no-temporal-filter"])
def test_what_the_analysis_decided_is_refused(command, outputs, option):
    result = run(command, "still.relight", *outputs, option)
    name = option.removeprefix("--no-").removeprefix("--").partition("=")[0].replace("-", "_")
    assert (result.exit_code, result.output) == (
        2,
        f"relight: {name}: still.relight is analysed already; give it to `relight analyse`\n",
    )


@pytest.mark.slow
def test_the_background_is_seen_with_the_camera_that_was_analysed():
    sky = np.random.default_rng(0).uniform(0, 1, (32, 64, 3)).astype(np.float32)
    relight.write("sky.exr", sky)
    behind = ["--environment", "sky.exr", "--background", "environment"]
    assert run("analyse", "p.exr", "-o", "wide.relight", "--field-of-view", "80").exit_code == 0
    assert run("apply", "wide.relight", *behind, "-o", "a.exr").exit_code == 0
    assert run("apply", "p.exr", *behind, "--field-of-view", "80", "-o", "b.exr").exit_code == 0
    np.testing.assert_array_equal(relight.read("a.exr")[:3], relight.read("b.exr")[:3])
