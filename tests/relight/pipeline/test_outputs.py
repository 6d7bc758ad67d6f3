"""Outputs are refused before any work where they would overwrite what is read or written as well."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import relight
from relight import Output
from relight.media.movies import Form
from relight.pipeline.outputs import check_alpha, check_outputs, has_frames, held_frames
from relight.pipeline.sinks import open_sinks

DELIVERY = SimpleNamespace(rate=24, form=Form())  # what a movie asks of it before its frames are made


@pytest.fixture(autouse=True)
def folder(tmp_path, here):
    (tmp_path / "sub").mkdir()
    for name in ("photo.png", "p.0001.png", "p.0002.png"):
        relight.write(name, np.full((4, 4, 3), 0.5, np.float32))
    relight.write("sky.exr", np.full((16, 32, 3), 0.5, np.float32))
    Path("q.2.png").symlink_to("p.0002.png")
    Path("other").symlink_to(".")


@pytest.mark.parametrize(
    ("output", "source"),
    [
        ("photo.png", "photo.png"),
        ("sub/../photo.png", "photo.png"),
        ("other/photo.png", "photo.png"),
        ("p.%04d.png", "p.####.png"),
        ("p.%d.png", "sub/../p.%04d.png"),
        ("p.%04d.png", "p.0001.png"),
        ("p.0002.png", "p.%04d.png"),
        ("q.%d.png", "p.%04d.png"),
        ("a.mov", "a.mov.frames/%06d.tif"),
        ("a.mov", "a.mov.frames/000001.tif"),
    ],
)
def test_an_output_that_is_read_is_refused(output, source):
    with pytest.raises(ValueError, match=r"is read as well, and would be overwritten"):
        check_outputs(Output(output), (source,))


@pytest.mark.parametrize("moving", [False, True])
def test_the_map_of_an_environment_is_read(moving):
    light = relight.EnvironmentLight("sky.exr")
    if moving:
        light = relight.MovingLight(relight.EnvironmentLight, orbit=9, image="sky.exr")
    with pytest.raises(ValueError, match=r"sky\.exr: is read as well"):
        check_outputs(Output("sub/../sky.exr"), (light,))


@pytest.mark.parametrize("output", ["photo2.png", "sub/photo.png", "p.%04d.exr", "pp.%04d.png", "b.mov"])
def test_outputs_that_are_no_inputs_are_accepted(output):
    check_outputs(Output(output), ("photo.png", "p.%04d.png", "a.mov.frames/%06d.tif", np.zeros(3), None))


def test_the_matte_and_the_lights_file_are_written_too():
    with pytest.raises(ValueError, match=r"o\.png: is written twice"):
        check_outputs(Output("o.png", save_matte="sub/../o.png"), ())
    with pytest.raises(ValueError, match=r"o\.%d\.png: is written twice"):
        check_outputs(Output("o.####.png", save_matte="o.%d.png"), ())
    with pytest.raises(ValueError, match=r"l\.png: expected a file name that ends in \.yaml"):
        check_outputs(Output("o.png", save_lights="l.png"), ())
    with pytest.raises(FileNotFoundError, match=r"gone/l\.yaml: the folder gone does not exist"):
        check_outputs(Output("o.png", save_lights="gone/l.yaml"), ())


@pytest.mark.parametrize("name", ["a.jpg", "a.JPEG", "a.hdr", "a.mp4"])
def test_a_picture_with_alpha_is_refused_before_it_is_made(name):
    with pytest.raises(ValueError, match="holds no alpha; give a background"):
        check_alpha(Output(name), transparent=True)
    check_alpha(Output(name), transparent=False)
    if not name.endswith("mp4"):
        with pytest.raises(ValueError, match=r"expected \.png, \.tif or \.exr for a matte"):
            check_outputs(Output("o.png", save_matte=name), ())


def test_a_refused_run_keeps_the_frames_of_the_one_before():
    kept = held_frames(Path("a.mov"))
    kept.folder.mkdir()
    relight.write(kept.path(1), np.zeros((4, 4, 4), np.float32))
    run = {"display": {}, "moving": True, "phase": "all", "groups": ["a b", "a_b"], "delivery": DELIVERY}
    with pytest.raises(ValueError, match=r"layers: 'C_a b' and 'C_a_b' are one to Nuke"):
        open_sinks(Output(["a.mov", "a.%d.exr", "a.nk"]), resume=False, **run)
    assert kept.numbers() == [1]
    open_sinks(Output("a.mov"), resume=True, **run).begin({})
    assert kept.numbers() == [1]
    open_sinks(Output("a.mov"), resume=False, **run).begin({})
    assert kept.numbers() == []


@pytest.mark.parametrize(
    ("output", "message"),
    [
        (Output(["a.mov", "a.exr"]), r"a\.exr: expected a movie, or a frame number in the name"),
        (Output("a.exr", save_matte="m.%d.png"), r"m\.%d\.png: expected a single file, as a\.exr has it"),
        (Output("a.%d.exr", save_matte="m.png"), r"m\.png: expected a frame number in the name"),
    ],
)
def test_a_still_and_frames_are_not_written_together(output, message):
    with pytest.raises(ValueError, match=message):
        has_frames(output)


@pytest.mark.parametrize("source", ["sky.exr:albedo", Path("sky.exr:albedo")])
def test_the_file_of_a_layer_is_read(source):
    with pytest.raises(ValueError, match=r"sky\.exr: is read as well"):
        check_outputs(Output("sky.exr"), (source,))
