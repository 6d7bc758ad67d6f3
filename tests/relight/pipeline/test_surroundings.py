"""What surrounds a run: locales, temporary folders, other processes, signals; and a still as a movie."""

import os
import signal
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from helpers import ROOT, shots
from helpers.clothed import clothed
from helpers.foreign_files import movie

import relight
from relight.media.movies import Movie

COMMAND = [sys.executable, "-m", "relight.cli", "apply"]
KEY = relight.DirectionalLight(azimuth=-40, elevation=30, name="key")


@pytest.fixture(scope="module")
def codes():
    """Somebody of 8 bits, with alpha, opaque outside for movies without."""
    plate, matte = clothed(seed=2)
    rgb = np.round(255 * np.clip(plate[..., :3], 0, 1) ** (1 / 2.2)).astype(np.uint8)
    return np.dstack([rgb, np.round(255 * matte).astype(np.uint8)])


@pytest.mark.parametrize(("name", "codec"), [("a.mov", "qtrle"), ("a.mkv", "ffv1")])
def test_a_still_as_a_movie_is_relit_as_the_still(tmp_path, codes, name, codec):
    layout = {"qtrle": "argb", "ffv1": "bgra"}[codec]
    movie(tmp_path / name, [codes] * 3, codec=codec, layout=layout)
    relight.write(tmp_path / "a.png", codes)
    kept = {"colour_space": "sRGB"}  # a movie that says nothing is BT.709
    shots.render(tmp_path / "a.png", KEY, tmp_path / "still.exr", **kept)
    shots.render(tmp_path / name, KEY, tmp_path / "frame.%04d.exr", **kept)
    still = relight.read(tmp_path / "still.exr")
    frames = sorted(tmp_path.glob("frame.*.exr"))
    assert len(frames) == 3
    for frame in frames:
        np.testing.assert_allclose(relight.read(frame), still, atol=2e-3)


@pytest.fixture
def figure(tmp_path, codes):
    relight.write(tmp_path / "figure.png", codes)
    return tmp_path


def run(folder, *words, **environment):
    done = subprocess.run(
        [*COMMAND, *words], cwd=folder, capture_output=True, text=True, encoding="utf-8", timeout=300,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    )  # fmt: skip
    assert "Traceback" not in done.stderr, done.stderr
    return done


@pytest.mark.slow
@pytest.mark.parametrize("locale", ["C", "tr_TR.UTF-8"])
def test_names_and_numbers_are_those_of_every_locale_and_standard_output_has_the_name(figure, locale):
    """Brackets are no markup, a name is a line however long it is, and no temporary folder is needed."""
    (figure / "figure.png").rename(figure / "Işıl.png")
    name = f"ışık [bold]{'x' * 120}.exr"
    done = run(
        figure, "Işıl.png", "--light", "İpek:azimuth=-40.5,intensity=1.5", "-o", name,
        LC_ALL=locale, TMPDIR="/nonexistent",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{name}\n"
    assert list(relight.read_layers(figure / name)) == ["C_İpek"]


@pytest.mark.slow
@pytest.mark.parametrize("output", ["out.mov", "out.%d.exr", "out.png"])
def test_two_processes_with_one_output_leave_one_whole_file(figure, output):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    jobs = [
        subprocess.Popen(
            [*COMMAND, "figure.png", "--light", f"azimuth={azimuth}", "-o", output, *frames(output)],
            cwd=figure, env=environment, stderr=subprocess.PIPE, text=True,
        )
        for azimuth in (-60, 60)
    ]  # fmt: skip
    said = [job.communicate(timeout=300)[1] for job in jobs]
    assert not any("Traceback" in words for words in said), said
    if output.endswith(".mov"):  # the frames of both lie in one folder: one of them may say that it is gone
        assert 0 in [job.returncode for job in jobs], said
        assert len(Movie(figure / output).numbers) == 2
        return
    assert [job.returncode for job in jobs] == [0, 0], said
    names = [output % number for number in (1, 2)] if "%" in output else [output]
    assert sorted(path.name for path in figure.iterdir()) == ["figure.png", *names]
    for name in names:
        relight.read(figure / name)


def frames(output):
    return [] if output.endswith(".png") else ["--frames", "1-2"]


@pytest.mark.skipif(sys.platform == "win32", reason="has no SIGINT for other processes")
@pytest.mark.parametrize("loaded", ["typer.core", "numpy"])
def test_an_interruption_while_modules_load_is_one_line_and_leaves_nothing(figure, loaded):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-X", "importtime", *COMMAND[1:]]  # names each module that it has loaded
    words = [*command, "figure.png", "--light", "azimuth=-40", "-o", "out.exr"]
    # A shell's background jobs ignore the signal, and their children inherit that.
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    quiet = {"stderr": subprocess.PIPE, "text": True, "preexec_fn": heed}
    with subprocess.Popen(words, cwd=figure, env=environment, **quiet) as job:
        while not (line := job.stderr.readline()).endswith(f" {loaded}\n"):
            assert line, job.wait()
        job.send_signal(signal.SIGINT)
        said = job.communicate(timeout=120)[1]
    assert job.returncode in (130, -signal.SIGINT)  # both are 130 in a shell
    assert "Traceback" not in said
    assert [line for line in said.splitlines() if "import time" not in line] == ["relight: interrupted"]
    assert [path.name for path in figure.iterdir()] == ["figure.png"]
