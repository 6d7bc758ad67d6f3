"""What is written takes the place of a file, and of nothing else."""

import os
import stat

import numpy as np
import pytest

import relight
from shadow.files import check_writable, replacing


def write(path):
    with replacing(path) as beside:
        beside.write_text("new")


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_a_replaced_file_keeps_its_mode(tmp_path, mode):
    path = tmp_path / "a.txt"
    path.write_text("old")
    path.chmod(mode)
    write(path)
    assert path.read_text() == "new"
    assert stat.S_IMODE(path.stat().st_mode) == mode


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.jpg", "a.tif", "a.mov", "a.yaml", "a.usda", "a.gltf"])
def test_a_private_file_of_any_format_stays_private(tmp_path, name):
    path, pixels = tmp_path / name, np.full((16, 16, 3), 0.5, np.float32)
    for _ in range(2):
        if path.suffix in (".yaml", ".usda", ".gltf"):
            pytest.importorskip("pxr")
            relight.write_lights(path, [relight.DirectionalLight(name="key")])
        else:
            relight.write(path, [pixels] if name == "a.mov" else pixels)
        path.chmod(0o600)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    before = path.read_bytes()
    if path.suffix in (".yaml", ".usda", ".gltf"):
        relight.write_lights(path, [relight.DirectionalLight(name="other")])
    else:
        relight.write(path, [pixels / 2] if name == "a.mov" else pixels / 2)
    assert path.read_bytes() != before
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a_pipe_stays_a_pipe(tmp_path):
    path = tmp_path / "a.txt"
    os.mkfifo(path)
    with pytest.raises(OSError, match=r"a\.txt: is no regular file"):
        write(path)
    with pytest.raises(OSError, match=r"a\.txt: is no regular file"):
        check_writable(path, (".txt",))
    assert stat.S_ISFIFO(path.stat().st_mode)


def test_the_longest_legal_names_can_be_written(tmp_path):
    path = tmp_path / f"{'a' * 249}.txt"
    write(path)
    write(path)
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
