"""The sound that a cache names is that of a movie it was made from, and of no other file of the machine."""

import warnings
from fractions import Fraction

import av
import numpy as np
import pytest

import relight
from relight.media.content_hash import FileRecord
from relight.pipeline.cache import AnalysisCache


@pytest.fixture
def movie(tmp_path):
    """A movie with sound, anywhere on this machine."""
    path = tmp_path / "private.mov"
    with av.open(str(path), "w") as file:
        picture, sound = file.add_stream("mpeg4", 24), file.add_stream("pcm_s16le", 48000, layout="mono")
        picture.width = picture.height = 64
        file.mux(picture.encode(av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8))))
        frame = av.AudioFrame.from_ndarray(np.full((1, 2000), 1000, np.int16), "s16", "mono")
        frame.sample_rate = 48000
        file.mux(sound.encode(frame))
        file.mux(picture.encode(None))
        file.mux(sound.encode(None))
    return path


def cache(folder, sound, sources):
    """A cache of a frame that names a movie with sound."""
    folder.mkdir()
    about = {
        "version": 1,
        "header": {},
        "timecode": None,
        "tags": {},
        "sound": str(sound),
        "shown": ["0", "1/24"],
    }
    relight.Subject.nobody((64, 64)).save(folder / "000001.safetensors", provenance={
        "content_hash": "x", "options": "x", "precision": "float32", "threads": 1,
        "rate": "24", "sources": sources, "plate_metadata": about,
    })  # fmt: skip
    return AnalysisCache(folder).plate_metadata(1)


def source(file, **others):
    return FileRecord.of(file)._replace(path=str(file))._asdict() | others


def test_the_sound_of_the_analysed_movie_stays(tmp_path, movie):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = cache(tmp_path / "a.relight", movie, [source(movie)])
    assert found.sound == movie
    assert found.end == Fraction(1, 24)


@pytest.mark.parametrize(
    "others", [None, {"sha256": "0" * 64}, {"path": "elsewhere.mov"}, {"sha256": "0" * 64, "size": 1}]
)
@pytest.mark.states("Analysis caches", "the sound of a movie that is no source: it is left out", "warned of")
def test_the_sound_of_any_other_file_is_left_out(tmp_path, movie, others):
    sources = [] if others is None else [source(movie, **others)]
    with pytest.warns(
        UserWarning, match=r"private\.mov is not the movie that was analysed; its sound is left"
    ):
        assert cache(tmp_path / "a.relight", movie, sources).sound is None


@pytest.mark.parametrize("sources", [3, ["x"], [{"path": "private.mov"}]])
def test_sources_that_are_none_are_damage(tmp_path, movie, sources):
    with pytest.raises(ValueError, match=r"is damaged: its sources are none"):
        cache(tmp_path / "a.relight", movie, sources if sources == 3 else [*sources, {"path": str(movie)}])
