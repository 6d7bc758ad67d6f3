"""A preview of a shot: every fourth frame, half the size, and nothing that takes long."""

import numpy as np
import pytest
from helpers.rising import STILL
from helpers.standins import HEIGHT, WIDTH, somebody

import relight
from relight.media.movies import Movie
from relight.pipeline.shot import Shot

FLOOR = relight.Floor(feet=(4, 10, 8, 10))


def test_every_fourth_frame_at_half_the_size_and_at_the_same_speed(stub, plates, tmp_path):
    stub.render(plates, STILL, tmp_path / "p.mp4", preview=True, rate=24, background=(0, 0, 0))
    movie = Movie(tmp_path / "p.mp4")
    assert len(movie.numbers) == 2  # frames 101 and 105
    assert movie.rate == 6
    assert movie.read(1).shape == (HEIGHT // 2, WIDTH // 2, 3)
    assert len(stub.made) == 2
    assert stub.filtered_by == []


def test_frames_are_those_of_the_whole_shot_wherever_it_begins(stub, plates, tmp_path):
    stub.render(plates, STILL, tmp_path / "p.mp4", preview=True, frames="102-105", background=(0, 0, 0))
    assert len(Movie(tmp_path / "p.mp4").numbers) == 1
    with pytest.raises(ValueError, match=r"frames: expected some of 101, 105, 109\.\.\.,.*got 102-104"):
        stub.render(plates, STILL, tmp_path / "q.mp4", preview=True, frames="102-104", background=(0, 0, 0))


def test_the_plate_behind_the_person_has_half_the_size_too(stub, tmp_path):
    for number in range(1, 6):
        relight.write(tmp_path / f"p.{number}.png", np.full((HEIGHT, WIDTH, 3), 51, np.uint8))
    matte = np.zeros((HEIGHT, WIDTH), np.float32)
    matte[2:10, 4:8] = 1
    stub.render(tmp_path / "p.%d.png", STILL, tmp_path / "p.mp4", preview=True, mask=matte)
    codes = Movie(tmp_path / "p.mp4").read(1)
    np.testing.assert_allclose(codes[:, -1], 0.0331, atol=0.003)  # sRGB's 51


def test_it_is_an_mp4_of_plates(stub, plates, tmp_path):
    with pytest.raises(ValueError, match=r"r\.mov: a preview is written as \.mp4"):
        stub.render(plates, STILL, tmp_path / "r.mov", preview=True)
    with pytest.raises(ValueError, match=r"preview: .*is analysed, and is relit fast without it"):
        stub.render(tmp_path / "shot.relight", STILL, tmp_path / "r.mp4", preview=True)
    assert stub.made == []


def test_pixels_of_options_are_those_of_the_plate():
    shot = Shot(relight.Source(somebody(), feather=4), relight.Lighting(STILL, floor=FLOOR), is_preview=True)
    assert shot.source.feather == 2
    assert shot.lighting.floor.feet == (2, 5, 4, 5)


def test_it_is_another_picture_for_resume(plates):
    whole, preview = (Shot(plates, STILL, is_preview=each) for each in (False, True))
    assert whole.content_hash(101) != preview.content_hash(101)
