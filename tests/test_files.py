import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import relight
from shadow import files
from shadow.files import replacing


def without_unnamed_files(monkeypatch):
    monkeypatch.setattr(files, "_unnamed", lambda folder: None)


@pytest.fixture(params=[True, False], ids=["unnamed", "named"])
def folder(request, tmp_path, monkeypatch):
    if not request.param:
        without_unnamed_files(monkeypatch)
    return tmp_path


def test_the_file_is_there_when_it_is_whole(folder):
    target = folder / "a.txt"
    target.write_text("old")
    with replacing(target) as path:
        path.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert os.listdir(folder) == ["a.txt"]
    assert target.stat().st_mode & 0o777 == 0o666 & ~umask()


def umask():
    current = os.umask(0)
    os.umask(current)
    return current


def test_an_error_leaves_what_was_there(folder):
    target = folder / "a.txt"
    target.write_text("old")

    def fail():
        with replacing(target) as path:
            path.write_text("half")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        fail()
    assert target.read_text() == "old"
    assert os.listdir(folder) == ["a.txt"]


def test_no_descriptor_is_left_open(folder):
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        with replacing(folder / "a.txt") as path:
            path.write_text("new")
    assert len(os.listdir("/proc/self/fd")) == before


def writes(process):
    """Whether a process has a file without a name open."""
    with contextlib.suppress(FileNotFoundError):  # closed while we look
        return any("(deleted)" in os.readlink(link) for link in Path(f"/proc/{process}/fd").iterdir())
    return False


WRITER = """
import sys, numpy as np, relight
from relight.media import images, movies
noise = np.random.default_rng(0).random((1500, 1500, 3), np.float32)
images.scene_linear("warm", noise[:2, :2])
print("writing", flush=True)
while True:
    if sys.argv[1].endswith(".mp4"):
        movies.write_movie(sys.argv[1], [noise] * 50)
    else:
        relight.write(sys.argv[1], noise)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="unnamed files are Linux's")
@pytest.mark.parametrize("name", ["a.exr", "a.mp4"])
def test_a_kill_in_the_middle_of_a_write_leaves_nothing_half_written(tmp_path, name):
    old = np.full((4, 6, 3), 0.5, np.float32)
    if name == "a.exr":
        relight.write(tmp_path / name, old)
    else:
        (tmp_path / name).write_text("old")
    before = (tmp_path / name).read_bytes()
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, tmp_path / name],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parent.parent)},
    )
    assert writer.stdout.readline() == b"writing\n"
    while not writes(writer.pid):
        time.sleep(0.001)
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    assert os.listdir(tmp_path) == [name]
    after = (tmp_path / name).read_bytes()
    assert after == before or relight.read(tmp_path / name).shape == (1500, 1500, 3)
