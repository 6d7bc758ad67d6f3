"""The order of a run, whatever its job: refusals first, then work, and what was opened is closed."""

import numpy as np
import pytest
from helpers import standins

import relight
from relight.media.sequences import FrameRange
from relight.pipeline.run import Job, run
from relight.pipeline.shot import Shot


class Recorded(Job):
    """Notes what is called; `fails`: the frames that cannot be made."""

    step = "Noting"

    def __init__(self, refusal=None, fails=(), collects_errors=False):
        super().__init__()
        self.refusal, self.fails, self.collects_errors, self.calls = refusal, fails, collects_errors, []

    def check(self, shot, frames):
        self.calls.append("check")
        if self.refusal:
            raise ValueError(self.refusal)
        return FrameRange.of(frames)

    def prepare(self, shot, numbers, report):
        self.calls.append("prepare")
        self.opened.callback(self.calls.append, "closed")

    def frame(self, shot, number):
        self.calls.append(number)
        if number in self.fails:
            raise ValueError(f"{number} cannot be made")

    def finish(self, shot, numbers, problems, report):
        self.calls.append("finish")
        return problems


class Lit(standins.FlatSubject):
    """Stands in for the subject of a reference, and notes that it was analysed."""

    made = 0

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        Lit.made += 1

    def fit_lighting(self, image):
        return np.float32([[0, 0, 1]]), np.ones((1, 3), np.float32)


@pytest.fixture
def shot():
    """A still whose lights are those of a reference, which `Shot.prepare` analyses."""
    Lit.made = 0
    return Shot(standins.somebody(), relight.Lighting(match=standins.somebody()), analyse=Lit)


def test_the_steps_have_one_order_and_progress_names_them(shot):
    job, told = Recorded(), []
    assert run(job, shot, "3-4", lambda *step: told.append(step)) == {}
    assert job.calls == ["check", "prepare", 3, 4, "finish", "closed"]
    assert told == [(0, 1, "Matching"), (1, 2, "Noting"), (2, 2, "Noting")]
    assert [light.name for light in shot.lights.stated()] == ["match1"]


def test_a_refusal_comes_before_all_work(shot):
    job = Recorded(refusal="no")
    with pytest.raises(ValueError, match="no"):
        run(job, shot, 1)
    assert job.calls == ["check"]
    assert Lit.made == 0


def test_a_frame_that_fails_keeps_the_others_or_ends_the_run(shot):
    job = Recorded(fails=[2], collects_errors=True)
    assert run(job, shot, (1, 3)) == {2: "2 cannot be made"}
    assert job.calls == ["check", "prepare", 1, 2, 3, "finish", "closed"]
    job = Recorded(fails=[2])
    with pytest.raises(ValueError, match="2 cannot be made"):
        run(job, shot, (1, 3))
    assert job.calls == ["check", "prepare", 1, 2, "closed"]
