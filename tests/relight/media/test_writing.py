"""One function writes images and movies."""

import numpy as np
import pytest

import relight
from relight.media import movies


def test_frames_of_a_generator_become_a_movie(tmp_path):
    frames = (np.full((32, 48, 3), light, np.float32) for light in (0.1, 0.2, 0.4))
    relight.write(tmp_path / "x.mp4", frames, rate=25)
    movie = movies.Movie(tmp_path / "x.mp4")
    assert len(movie.numbers) == 3
    assert [movie.read(number).mean() for number in movie.numbers] == pytest.approx([0.1, 0.2, 0.4], rel=0.1)


def test_what_a_format_does_not_have_is_refused(tmp_path):
    frame = np.full((32, 48, 3), 0.2, np.float32)
    for path, image, options, message in (
        ("x.mp4", [frame], {"depth": "half"}, "a movie has no option depth"),
        ("x.mp4", frame, {}, "expected an iterable of frames"),
        ("x.png", frame, {"rate": 24}, "only a movie"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            relight.write(tmp_path / path, image, **options)
    assert not [*tmp_path.iterdir()]
