"""A run that is killed, and resumed, ends as if nobody had killed it; benchmarks/kill.py kills more."""

import os
import signal
import sys

import pytest
from helpers import ROOT
from helpers.forked import started
from helpers.killing import differences, finished, kill
from helpers.rising import make
from helpers.standins import FlatSubject

SLOWLY = """
import sys, time
from helpers.rising import make
from helpers.standins import FlatSubject
class Slow(FlatSubject):
    def relit(self, light):
        time.sleep(0.1)
        return super().relit(light)
make(sys.argv[1], Slow)
"""

# What is written last goes to the file and takes its time there, until somebody ends the process.
CLOSING = """
import sys, time
from pathlib import Path
from contextlib import contextmanager
from shadow import files
whole = files.replacing
@contextmanager
def slowly(path):
    with whole(path) as beside:
        yield beside
        if Path(path).name == sys.argv[2]:
            print("written", flush=True)
            time.sleep(300)
files.replacing = slowly
"""
MAKE = """
from helpers.rising import make
from helpers.standins import FlatSubject
make(sys.argv[1], FlatSubject)
"""
ANALYSE = """
import relight.analysis.storage as storage
storage.replacing = slowly
from helpers import shots
from helpers.clothed import clothed
from helpers.damage import small_canvas
plate, matte = clothed(seed=1)
with small_canvas():
    shots.analyse(plate, sys.argv[1], mask=matte)
"""
EXPORT = """
import relight.scene.gltf.write as gltf
gltf.replacing = slowly
import relight
from helpers.clothed import clothed
from helpers.damage import small_canvas
plate, matte = clothed(seed=1)
with small_canvas():
    relight.Subject(plate, matte).export(sys.argv[1])
"""
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT / "tests")}


@pytest.mark.parametrize(
    ("name", "files"), [("r.%02d.exr", 2), pytest.param("r.mp4", 4, marks=pytest.mark.slow)]
)
def test_killed_and_resumed(tmp_path, name, files):
    whole, folder = tmp_path / "whole", tmp_path / "killed"
    for path in (whole, folder):
        path.mkdir()
    make(whole / name, FlatSubject)
    program = [sys.executable, "-c", SLOWLY, str(folder / name)]
    assert kill(program, folder, files, 0.02, cwd=ROOT, env=ENVIRONMENT)
    assert files <= len(finished(folder)) < 10
    make(folder / name, FlatSubject)
    assert differences(folder, whole) == []


def end_at_the_close(program, output, last, ended_by):
    """Start a program, and end it by a signal once the content of the file `last` is written, unnamed."""
    with started(CLOSING + program, output, last) as (process, printed):
        try:
            assert "written\n" in printed
        finally:
            os.kill(process.pid, getattr(signal, ended_by))
    assert process.exitcode == -getattr(signal, ended_by)


@pytest.mark.skipif(sys.platform != "linux", reason="has no files without a name")
@pytest.mark.parametrize(
    ("name", "last", "kept", "ended_by"),
    [
        pytest.param("r.%02d.exr", "r.10.exr", 9, "SIGKILL", marks=pytest.mark.slow),
        ("r.mp4", "r.mp4", 10, "SIGTERM"),
    ],
)
def test_ended_as_the_last_file_closes_and_resumed(tmp_path, name, last, kept, ended_by):
    whole, folder = tmp_path / "whole", tmp_path / "ended"
    for path in (whole, folder):
        path.mkdir()
    make(whole / name, FlatSubject)
    end_at_the_close(MAKE, folder / name, last, ended_by)
    assert not (folder / last).exists()
    assert len([path for path in folder.rglob("*") if path.is_file()]) == kept
    make(folder / name, FlatSubject)
    assert differences(folder, whole) == []


@pytest.mark.skipif(sys.platform != "linux", reason="has no files without a name")
@pytest.mark.parametrize(
    ("program", "name", "last", "ended_by"),
    [
        pytest.param(
            ANALYSE, "s.relight", "still.safetensors", "SIGTERM", id="analyse", marks=pytest.mark.slow
        ),
        pytest.param(EXPORT, "person.glb", "person.glb", "SIGKILL", id="export"),
    ],
)
def test_ended_as_an_analysis_or_a_mesh_closes(tmp_path, program, name, last, ended_by):
    before = b"of an earlier run"
    if name == last:
        (tmp_path / name).write_bytes(before)
    end_at_the_close(program, tmp_path / name, last, ended_by)
    left = {path.name: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert left == ({name: before} if name == last else {})
