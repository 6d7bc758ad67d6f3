"""The frame whose place, size and light of the person count for a whole shot."""

import json

import numpy as np
import pytest
from helpers import shots
from helpers.rising import STILL
from helpers.standins import HEIGHT, WIDTH, somebody

import relight
from relight.pipeline import reference
from relight.pipeline.cache import frame_file
from relight.pipeline.shot import Shot


@pytest.fixture
def entering(tmp_path):
    """Frames 1 to 9: an arm at the border, then nobody, then somebody whole who comes nearer."""
    for number in range(1, 10):
        image = np.zeros((HEIGHT, WIDTH, 4), np.float32)
        if number == 1:
            image[2:10, :3] = 1  # as large, and cut
        elif number >= 5:
            image[2 : 2 + number, 4:8] = 1
        relight.write(tmp_path / f"p.{number}.exr", image)
    return tmp_path / "p.%d.exr"


def test_it_is_where_the_person_is_whole_and_largest(entering):
    assert Shot(entering).reference == 9
    assert reference.looked_at(range(7, 100)) == [7, 11, 15, 19, 23, 27]
    assert reference.looked_at(range(7, 100, 4)) == [7, 11, 15, 19, 23, 27]


def test_a_small_person_who_is_whole_does_not_count_beside_a_large_one():
    looks = [reference.Look(1, 0.1, 0), reference.Look(5, 0.3, 1), reference.Look(9, 0.25, 1)]
    assert reference.best_first(range(3), looks.__getitem__)[0] == [5, 9, 1]


def test_one_that_is_asked_for_counts_or_is_refused(entering, stub, tmp_path):
    assert Shot(relight.Source(entering, reference=6)).reference == 6
    with pytest.raises(ValueError, match="reference: expected a frame of the source, 1 to 9, got 10"):
        stub.render(entering, STILL, tmp_path / "r.%d.exr", reference=10)
    with pytest.raises(ValueError, match="reference: expected a frame of the source, a still has none"):
        stub.render(somebody(), STILL, tmp_path / "r.exr", reference=1)
    with pytest.raises(ValueError, match="reference: frame 2 shows no person; choose another"):
        _ = Shot(relight.Source(entering, reference=2)).reference
    assert stub.made == []


def test_a_frame_has_another_hash_with_another_reference(entering):
    sixth, seventh = (Shot(relight.Source(entering, reference=number), STILL) for number in (6, 7))
    assert sixth.content_hash(6) != seventh.content_hash(6)
    assert sixth.person_hash(6) != seventh.person_hash(6)


@pytest.mark.slow
def test_an_analysis_keeps_it(entering, tmp_path):
    shots.analyse(entering, tmp_path / "s.relight", frames="8-9", temporal_filter=False)
    assert Shot(tmp_path / "s.relight").reference == 9
    frame_file(tmp_path / "s.relight", 9).unlink()
    assert Shot(tmp_path / "s.relight").reference is None


def test_a_job_states_it(entering, tmp_path):
    relight.write_job(tmp_path / "job.json", entering, STILL, tmp_path / "r.%d.exr")
    template = json.loads((tmp_path / "job.json").read_text())
    (options,) = template["steps"][0]["script"]["embeddedFiles"]
    assert json.loads(options["data"])["source"]["reference"] == 9
