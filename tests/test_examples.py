"""What the examples promise, run as a reader would run them."""

import contextlib
import io
import os
import re
import runpy
import subprocess
import sys
from unittest import mock

import numpy as np
import pytest
from helpers import ROOT

import relight
from relight.media.movies import Movie


def apart(*command):
    """Run an example as a reader does, in a process of its own, with the networks as they are."""
    done = subprocess.run(
        [sys.executable, *command],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "leaked" not in done.stderr


def run(example, *arguments):
    """Run an example in this process, with the networks on a small canvas; return what it prints."""
    words = [str(example), *map(str, arguments)]
    with mock.patch.object(sys, "argv", words), contextlib.redirect_stdout(io.StringIO()) as said:
        runpy.run_path(words[0], run_name="__main__")
    return said.getvalue()


@pytest.mark.parametrize(
    ("example", "how"), [pytest.param("simple.py", apart, marks=pytest.mark.slow), ("layers.py", run)]
)
def test_examples_run(example, how, tmp_path):
    person = relight.read(ROOT / "examples" / "person.png")
    relight.write(tmp_path / "small.png", np.ascontiguousarray(person[::3, ::3]))
    how(ROOT / "examples" / example, tmp_path / "small.png", tmp_path / "out")
    names = {path.suffix for path in (tmp_path / "out").iterdir()}
    assert names == {".exr", ".png"}


@pytest.mark.slow
def test_the_environment_example_turns_its_sky(tmp_path):
    person = relight.read(ROOT / "examples" / "person.png")
    relight.write(tmp_path / "small.png", np.ascontiguousarray(person[::4, ::4]))
    run(ROOT / "examples" / "environment.py", tmp_path / "small.png", tmp_path / "out")
    (sky,) = relight.read_lights(tmp_path / "out" / "sky.yaml")
    picture = relight.read(tmp_path / "out" / "environment.exr")
    small = relight.read(tmp_path / "small.png")
    np.testing.assert_allclose(
        picture, relight.apply(small, sky, background=sky.view(small.shape[:2], 35)), rtol=2e-3, atol=2e-3
    )
    triptych = relight.read(tmp_path / "out" / "environment.png")
    assert triptych.shape == (small.shape[0], 3 * small.shape[1], 3)


@pytest.mark.slow
def test_spherical_harmonics_lose_less_with_each_order(tmp_path):
    person = relight.read(ROOT / "examples" / "person.png")
    relight.write(tmp_path / "small.png", np.ascontiguousarray(person[::4, ::4]))
    printed = run(ROOT / "examples" / "spherical_harmonics.py", tmp_path / "small.png", tmp_path)
    rows = re.findall(r"\| order (\d) \| (\d+) \| (\d+)° \| ([\d.]+) \| \d+° \|", printed)
    assert [(int(order), int(count)) for order, count, _, _ in rows] == [
        (n, (n + 1) ** 2) for n in range(2, 9)
    ]
    widths, errors = ([float(row[column]) for row in rows] for column in (2, 3))
    # The kernel is that of the addition theorem, sum of (2n + 1) / 4π P_n: its width follows from the order.
    np.testing.assert_allclose(widths, [90, 66, 52, 44, 38, 32, 30], atol=2)
    assert errors[0] > 0.02
    assert errors[-1] < errors[0] / 3
    assert relight.read(tmp_path / "spherical_harmonics.png").max() > 0.5


@pytest.mark.slow
def test_a_light_goes_around_in_a_movie(tmp_path):
    person = relight.read(ROOT / "examples" / "person.png")
    relight.write(tmp_path / "small.png", np.ascontiguousarray(person[::4, ::4]))
    run(ROOT / "examples" / "video.py", tmp_path / "small.png", tmp_path / "m.mp4", "4")
    movie = Movie(tmp_path / "m.mp4")
    assert len(movie.numbers) == 4
    first, second = (movie.read(number) for number in (1, 2))
    assert np.abs(first - second).max() > 0.05  # it moves


@pytest.mark.slow
def test_light_groups_add_up_in_the_file(tmp_path):
    person = relight.read(ROOT / "examples" / "person.png")
    relight.write(tmp_path / "small.png", np.ascontiguousarray(person[::3, ::3]))
    printed = run(ROOT / "examples" / "light_groups.py", tmp_path / "small.png", tmp_path / "out")
    assert float(printed.split()[-1]) < 2e-3
    layers = relight.read_layers(tmp_path / "out" / "groups.exr")
    assert {"C_key", "C_rim", "C_fill", "albedo", "N"} <= set(layers)
    assert (tmp_path / "out" / "groups.nk").read_text().count("Multiply {") == 3


@pytest.mark.slow
def test_the_moving_light_runs(tmp_path):
    printed = run(ROOT / "examples" / "moving_light.py", tmp_path / "m.mp4", "--size", "64", "--step", "90")
    assert "change a degree" in printed
    movie = Movie(tmp_path / "m.mp4")
    assert len(movie.numbers) == 9  # three elevations, from right over the camera to left
    frames = [movie.read(number) for number in movie.numbers]
    assert {frame.shape for frame in frames} == {(64, 256, 3)}
    truth = [frame[:, :64].mean(axis=(0, 2)) for frame in frames]
    assert truth[0][32:].sum() > truth[0][:32].sum()  # lit from the right
    assert truth[2][:32].sum() > truth[2][32:].sum()  # then from the left
