"""The report of a shot, which says where to look."""

import json

import numpy as np
import pytest
from helpers.rising import STILL
from helpers.standins import HEIGHT, WIDTH, FlatShots

import relight
from relight.pipeline.shot_report import ShotReport

RED, BLUE = (0.5, 0.05, 0.05), (0.05, 0.05, 0.5)


def write_plate(path, columns, colour):
    image = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    image[2:10, 4 : 4 + columns] = (*colour, 1)
    relight.write(path, image)


@pytest.fixture
def shot(tmp_path):
    """Frames 1 to 6: somebody in red, twice as wide in 3, nobody in 4, then somebody in blue."""
    for number, (columns, colour) in enumerate(
        [(3, RED), (3, RED), (6, RED), (0, RED), (6, BLUE), (6, BLUE)], start=1
    ):
        write_plate(tmp_path / f"p.{number}.exr", columns, colour)
    return tmp_path / "p.%d.exr"


def report_of(stub, shot, folder, **settings):
    stub.render(shot, STILL, folder / "r.%d.exr", report=folder / "shot.json", **settings)
    return json.loads((folder / "shot.json").read_text())["frames"]


def test_it_says_of_each_frame_what_is_unusual(stub, shot, tmp_path):
    frames = report_of(stub, shot, tmp_path)
    assert list(frames) == list("123456")
    assert frames["1"]["area"] == pytest.approx(24 / (HEIGHT * WIDTH), abs=1e-5)
    assert [frames[n]["area_jump"] for n in "123456"] == [None, 0, 1, None, 0, 0]
    assert [frames[n]["likely_other_person"] for n in "123456"] == [False, False, False, False, True, False]
    assert frames["3"]["neighbours"] == [1, 2, 5]
    assert frames["1"]["certainty"] is None  # the matte was given
    assert (frames["1"]["confidence"], frames["1"]["unsure"]) == (0.8, True)
    assert frames["4"]["area"] == 0


def test_frames_that_cannot_be_made_say_why(stub, shot, tmp_path):
    (tmp_path / "p.3.exr").write_bytes(b"damaged")
    frames = report_of(stub, shot, tmp_path)
    assert "p.3.exr" in frames["3"]["error"]
    assert "area" in frames["2"]


def test_a_resumed_run_ends_with_the_same_report(stub, shot, tmp_path):
    whole = report_of(stub, shot, tmp_path)
    other = FlatShots()
    # An interruption between a frame and its entry, and one before a frame.
    content = json.loads((tmp_path / "shot.json").read_text())
    del content["frames"]["2"], content["frames"]["5"]
    (tmp_path / "shot.json").write_text(json.dumps(content))
    (tmp_path / "r.5.exr").unlink()
    assert report_of(other, shot, tmp_path, resume=True) == whole
    assert report_of(other, shot, tmp_path, resume=True) == whole


def test_it_is_there_after_each_frame(stub, shot, tmp_path):
    found = []

    def progress(done, total, step):
        found.append(list(json.loads((tmp_path / "shot.json").read_text())["frames"]))

    report_of(stub, shot, tmp_path, frames="1-3", progress=progress)
    assert found == [["1"], ["1", "2"], ["1", "2", "3"]]


def test_a_chunk_has_none_and_the_last_step_writes_it(stub, shot, tmp_path):
    with pytest.raises(ValueError, match="report: is of all frames; give it to the last phase"):
        report_of(stub, shot, tmp_path, phase="frames")
    stub.render(shot, STILL, tmp_path / "r.%d.exr", phase="frames")
    assert report_of(stub, shot, tmp_path, phase="finalize")["3"]["area_jump"] == 1
    with pytest.raises(ValueError, match=r"report\.txt: expected .*\.json"):
        stub.render(shot, STILL, tmp_path / "r.%d.exr", report=tmp_path / "report.txt")


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"report": 1, "frames": [1]}', '{"report": 1, "frames": {"x": 1}}']
)
def test_another_file_is_written_again(tmp_path, text):
    (tmp_path / "r.json").write_text(text)
    assert not ShotReport(tmp_path / "r.json", resume=True).has(1, "hash")
