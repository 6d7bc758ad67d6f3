"""A run that is killed, and resumed, ends as if nobody had killed it; benchmarks/kill.py kills more."""

import os
import sys

import pytest
from helpers import ROOT
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


@pytest.mark.parametrize(("name", "files"), [("r.%02d.exr", 2), ("r.mp4", 4)])
def test_killed_and_resumed(tmp_path, name, files):
    whole, folder = tmp_path / "whole", tmp_path / "killed"
    for path in (whole, folder):
        path.mkdir()
    make(whole / name, FlatSubject)
    program = [sys.executable, "-c", SLOWLY, str(folder / name)]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "tests")}
    assert kill(program, folder, files, 0.02, cwd=ROOT, env=environment)
    assert files <= len(finished(folder)) < 10
    make(folder / name, FlatSubject)
    assert differences(folder, whole) == []
