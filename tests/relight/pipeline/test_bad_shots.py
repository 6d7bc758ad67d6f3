"""What a shot answers to footage that is not as it should be; containers are tested with the media."""

import json
import warnings

import numpy as np
import pytest
from helpers.finders import discs
from helpers.rising import STILL
from helpers.standins import HEIGHT, WIDTH, somebody

import relight
from relight.media.movies import Movie, write_movie
from relight.pipeline.shot import Shot


def write_frames(folder, pictures):
    """Frames p.1.png... of pictures in [0, 1], encoded."""
    for number, picture in enumerate(pictures, start=1):
        relight.write(folder / f"p.{number}.png", np.round(picture * 255).astype(np.uint8))
    return folder / "p.%d.png"


def matte_of(shot, number):
    """The matte of a frame, without the warning of how coarse it is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return shot.frame(number).matte


def test_a_movie_of_one_frame_is_a_movie_of_one_frame(stub, tmp_path):
    write_movie(tmp_path / "p.mov", [somebody()])
    assert stub.render(tmp_path / "p.mov", STILL, tmp_path / "r.mov") == {}
    assert list(Movie(tmp_path / "r.mov").numbers) == [1]
    assert stub.filtered_by == []  # there is nobody to average with


def test_black_first_frames_are_empty_and_somebody_else_is_the_reference(fetched, stub, tmp_path):
    black = np.zeros((160, 160, 3), np.float32)
    picture, _ = discs((160, 160), (60, 60, 14))
    shot = Shot(write_frames(tmp_path, [black, black, picture, picture]))
    assert [bool(matte_of(shot, number).max() > 0.5) for number in (1, 2, 3)] == [False, False, True]
    assert shot.reference == 3


def test_a_shot_of_nobody_at_all_is_a_shot_of_empty_frames(fetched, stub, tmp_path):
    grey = np.full((160, 160, 3), 0.3, np.float32)
    source = write_frames(tmp_path, [grey, grey])
    assert stub.render(source, STILL, tmp_path / "r.%d.exr") == {}
    assert relight.read(tmp_path / "r.1.exr")[..., 3].max() == 0
    assert stub.made == []


def test_a_person_of_twenty_pixels_is_found(fetched, tmp_path):
    picture, (where,) = discs((120, 160), (70, 60, 10))
    matte = matte_of(Shot(write_frames(tmp_path, [picture, picture])), 1)
    assert ((matte > 0.5) & where).sum() / ((matte > 0.5) | where).sum() > 0.6


def test_nothing_is_averaged_across_a_cut(fetched, tmp_path):
    """The same person at the same place before another wall: the matte is that of the frame alone."""
    first, _ = discs((160, 160), (60, 60, 14))
    other, _ = discs((160, 160), (60, 60, 14))
    other[(other == 0.3).all(axis=-1)] = 0.95
    other[60:, 80:] = (0.1, 0.6, 0.95)
    (tmp_path / "alone").mkdir()
    shot = Shot(write_frames(tmp_path, [first, first, other]))
    alone = Shot(write_frames(tmp_path / "alone", [other]))
    cut = matte_of(shot, 3)
    np.testing.assert_array_equal(cut, matte_of(alone, 1))


def test_maps_are_not_averaged_across_a_cut(stub, tmp_path):
    for number in range(1, 7):
        image = somebody()
        image[..., :3] += 0.02 if number < 4 else 0.9
        image[..., 3] = 1
        relight.write(tmp_path / f"p.{number}.exr", image)
    matte = somebody()[..., 3]
    stub.render(tmp_path / "p.%d.exr", STILL, tmp_path / "r.%d.exr", mask=matte, report=tmp_path / "r.json")
    frames = json.loads((tmp_path / "r.json").read_text())["frames"]
    found = [frames[str(number)]["neighbours"] for number in range(1, 7)]
    assert found == [[2, 3], [1, 3], [1, 2], [5, 6], [4, 6], [4, 5]]


def test_a_frame_of_another_size_is_made_alone(stub, tmp_path):
    for number in (1, 2, 3):
        image = somebody() if number != 2 else np.zeros((HEIGHT * 2, WIDTH * 2, 4), np.float32)
        if number == 2:
            image[4:20, 8:16] = 1
        relight.write(tmp_path / f"p.{number}.exr", image)
    assert stub.render(tmp_path / "p.%d.exr", STILL, tmp_path / "r.%d.exr") == {}
    assert relight.read(tmp_path / "r.2.exr").shape[:2] == (HEIGHT * 2, WIDTH * 2)


def test_a_file_that_is_no_track_is_refused_before_a_frame_is_read(stub, tmp_path):
    source = write_frames(tmp_path, [np.zeros((16, 16, 3), np.float32)])
    (tmp_path / "t.json").write_text("{}")
    with pytest.raises(ValueError, match=r"t\.json: expected a track, as `relight track` writes it"):
        stub.render(source, STILL, tmp_path / "r.%d.exr", track=tmp_path / "t.json")
    assert not list(tmp_path.glob("r.*"))
