"""A run that is killed, and resumed, ends as if nobody had killed it; benchmarks/kill.py kills more."""

import sys
from pathlib import Path

import pytest
from killing import differences, finished, kill
from standins import FlatSubject, somebody
from test_video import RISING

from relight import people, video

SLOWLY = """
import sys, time
import relight.people
from test_kill import make
from standins import FlatSubject
class Slow(FlatSubject):
    def relit(self, light):
        time.sleep(0.1)
        return super().relit(light)
relight.people.Subject = Slow
make(sys.argv[1])
"""


def make(output):
    """Ten frames in a rising light."""
    settings = {"background": (0.1, 0.1, 0.1), "frames": (1, 10), "resume": True}
    assert video.render_video(somebody(), RISING, output, **settings) == {}


@pytest.mark.parametrize(("name", "files"), [("r.%02d.exr", 2), ("r.mp4", 4)])
def test_killed_and_resumed(tmp_path, monkeypatch, name, files):
    monkeypatch.setattr(people, "Subject", FlatSubject)
    whole, folder = tmp_path / "whole", tmp_path / "killed"
    for path in (whole, folder):
        path.mkdir()
    make(whole / name)
    assert kill(
        [sys.executable, "-c", SLOWLY, str(folder / name)], folder, files, 0.02, cwd=Path(__file__).parent
    )
    assert files <= len(finished(folder)) < 10
    make(folder / name)
    assert differences(folder, whole) == []
