"""Machines that share a shot do not each look for the person."""

import json

import numpy as np
import pytest
from helpers.finders import discs

import relight
from relight.distributed.shared_source import FOLLOWING, shared_source
from relight.pipeline.shot import Shot


@pytest.fixture
def shot(tmp_path, fetched):
    for number, x in enumerate((50, 55, 60), start=1):
        codes = np.round(discs((160, 160), (x, 60, 14))[0] * 255).astype(np.uint8)
        relight.write(tmp_path / f"p.{number}.png", codes)
    return Shot(tmp_path / "p.%d.png")


def test_the_person_is_followed_once_for_all(shot, tmp_path):
    steps = []
    source = shared_source(shot, tmp_path / "r.track.json", lambda *step: steps.append(step))
    assert list(json.loads(source.track.read_text())["frames"]) == ["1", "2", "3"]
    assert source.reference == 1
    assert steps == [(number, 3, FOLLOWING) for number in (1, 2, 3)]


def test_a_run_that_continues_takes_the_file_that_is_there(shot, tmp_path):
    kept = tmp_path / "r.track.json"
    shared_source(shot, kept)
    text = kept.read_text().replace("60.0", "61.0")
    kept.write_text(text)
    assert shared_source(shot, kept, keep=True).track == kept
    assert kept.read_text() == text
    shared_source(shot, kept)
    assert kept.read_text() != text or "61.0" not in text


def test_a_given_matte_needs_no_file(plates, tmp_path):
    source = shared_source(Shot(plates), tmp_path / "r.track.json")
    assert source.track is None
    assert source.reference == 101
    assert not (tmp_path / "r.track.json").exists()
