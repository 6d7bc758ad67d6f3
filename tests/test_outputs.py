"""Outputs are refused before any work where they would overwrite what is read or written as well."""

from pathlib import Path

import numpy as np
import pytest

import relight
from relight.outputs import check, held_frames, open_outputs


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
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
        ("a.mov", "a.mov.frames/%06d.exr"),
        ("a.mov", "a.mov.frames/000001.exr"),
    ],
)
def test_an_output_that_is_read_is_refused(output, source):
    with pytest.raises(ValueError, match=r"is read as well, and would be overwritten"):
        check([Path(output)], (source,))


@pytest.mark.parametrize("moving", [False, True])
def test_the_map_of_an_environment_is_read(moving):
    light = relight.EnvironmentLight("sky.exr")
    if moving:
        light = relight.MovingLight(relight.EnvironmentLight, orbit=9, image="sky.exr")
    with pytest.raises(ValueError, match=r"sky\.exr: is read as well"):
        check([Path("sub/../sky.exr")], (light,))


@pytest.mark.parametrize("output", ["photo2.png", "sub/photo.png", "p.%04d.exr", "pp.%04d.png", "b.mov"])
def test_other_names_are_free(output):
    check([Path(output)], ("photo.png", "p.%04d.png", "a.mov.frames/%06d.exr", np.zeros(3), None))


def test_the_matte_and_the_lights_file_are_written_too():
    with pytest.raises(ValueError, match=r"o\.png: is written twice"):
        check([Path("o.png")], (), mattes=Path("sub/../o.png"))
    with pytest.raises(ValueError, match=r"o\.%d\.png: is written twice"):
        check([Path("o.####.png")], (), mattes=Path("o.%d.png"))
    with pytest.raises(ValueError, match=r"l\.png: expected a file name that ends in \.yaml"):
        check([Path("o.png")], (), lights=Path("l.png"))
    with pytest.raises(FileNotFoundError, match=r"gone/l\.yaml: the folder gone does not exist"):
        check([Path("o.png")], (), lights=Path("gone/l.yaml"))


def test_a_refused_run_keeps_the_frames_of_the_one_before():
    kept = held_frames(Path("a.mov"))
    kept.folder.mkdir()
    relight.write(kept.path(1), np.zeros((4, 4, 4), np.float32))
    run = {
        "transparent": True,
        "part": "all",
        "display": {},
        "exr": {"depth": "half"},
        "rate": 24,
        "names": [],
    }
    with pytest.raises(ValueError, match=r"a\.nk: a Nuke script needs a sequence"):
        open_outputs([Path("a.mov"), Path("a.nk")], resume=False, **run)
    assert kept.numbers() == [1]
    open_outputs([Path("a.mov")], resume=True, **run)[0].begin({})
    assert kept.numbers() == [1]
    open_outputs([Path("a.mov")], resume=False, **run)[0].begin({})
    assert kept.numbers() == []
