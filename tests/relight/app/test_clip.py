"""A movie in the app: its first frame with a person is a photograph, and the movie is saved in its light."""

import numpy as np
import pytest
from helpers import browsing
from helpers.finders import discs

pytest.importorskip("starlette")
pytest.importorskip("openvino")

import relight
from relight.app import clip, tasks
from relight.app.session import Session
from relight.matting.people import files as person_files
from relight.media.movies import Movie, write_movie

LOOK = {"lights": ["key:azimuth=-40"], "background": "original"}
EMPTY = np.full((160, 160, 3), 0.1, np.float32)


@pytest.fixture
def folder(here, monkeypatch, fetched):
    """A movie, 24 frames a second, of which the frames from the third on show somebody at (60, 70)."""
    monkeypatch.setattr(person_files, "are_fetched", lambda: True)
    somebody = discs((160, 160), (60, 70, 14))[0] ** 2.2
    write_movie("walk.mp4", [EMPTY] * 2 + [somebody.astype(np.float32)] * 3, white=1)
    return here


def silent(what, share=None):
    """Take a report of progress."""


def test_the_first_frame_with_a_person_is_the_photograph(folder):
    found = tasks.read_clip("walk.mp4", silent)
    assert found == {"still": "walk-frame3.png", "frame": 3}
    still = relight.read(folder / found["still"])
    np.testing.assert_allclose(still, Movie("walk.mp4").read(found["frame"]), atol=0.01)
    assert clip.name() == "walk.mp4"


def test_without_networks_it_is_the_first_frame(folder, monkeypatch):
    monkeypatch.setattr(person_files, "are_fetched", lambda: False)
    assert tasks.read_clip("walk.mp4", silent)["frame"] == 1


def test_the_command_follows_whoever_was_outlined(folder):
    tasks.read_clip("walk.mp4", silent)
    matte = np.zeros((80, 80), np.float32)
    matte[20:50, 25:36] = 1  # of a reduced copy
    np.save(tasks.MATTE, matte)
    (folder / tasks.SIDE).write_text("160")
    command = tasks.command_of("walk-frame3.png", "walk-frame3-matte.png")
    assert command[:4] == ["relight", "apply", "walk.mp4", "--person"]
    x, y = map(int, command[4].split("/"))
    assert 55 <= x <= 67
    assert 45 <= y <= 95


def test_the_whole_movie_is_saved_and_tells_how_far_it_is(folder, monkeypatch):
    tasks.read_clip("walk.mp4", silent)
    np.save(tasks.MATTE, np.pad(np.ones((20, 20), np.float32), ((60, 80), (50, 90))))
    (folder / tasks.SIDE).write_text("160")
    asked, said = [], []

    def render_shot(source, lighting, output, progress):
        asked.append((source.plate, source.person, lighting.light, output.paths[0].name))
        progress(2, 10, "Relighting")
        return {}

    def report(what, share=None):
        said.append((what, share))

    monkeypatch.setattr("relight.pipeline.render.render_shot", render_shot)
    answer = tasks.save("walk-frame3.png", "m.png", LOOK, "walk-relit.mp4", [], report)
    assert answer == {"file": "walk-relit.mp4"}
    (plate, person, light, written), *others = asked
    assert not others
    assert (plate, light, written) == ("walk.mp4", ("key:azimuth=-40",), "walk-relit.mp4")
    assert np.hypot(person[0] - 60, person[1] - 70) < 5
    assert said == [("Relighting: 2 of 10", 0.2)]


def test_outputs_are_named_after_the_movie(tmp_path):
    session = Session()
    try:
        photograph = session.new_photograph("walk.mp4")
        photograph.movie, photograph.name = "walk.mp4", "walk-frame8.png"
        assert photograph.output(".mp4") == "walk-relit.mp4"
        assert photograph.output(".png") == "walk-frame8-relit.png"
        assert photograph.to_json()["movie"] == "walk.mp4"
    finally:
        session.close()


@pytest.mark.slow
@browsing.NEEDS_CHROMIUM
def test_a_movie_that_is_dropped_shows_a_frame(browser, folder):
    """Without the networks it is the first one, to outline by hand."""
    from helpers.serving import at_step, chosen, served, visited

    with served() as (address, _):
        page = visited(browser, address)
        chosen(page, folder / "walk.mp4")
        at_step(page, "outline")
        names = page.evaluate("[relightApp.chosen.name, relightApp.chosen.movie]")
        assert names == ["walk-frame1.png", "walk.mp4"]
        assert {".mp4", ".mov"} <= set(page.evaluate("relightApp.about.outputs"))
        assert page.complaints == []
