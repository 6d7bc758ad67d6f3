"""Lights as those of a background or of another photograph, and the server's pictures of presets."""

import numpy as np
import pytest

import relight
from relight.app import matching, preset_pictures
from relight.errors import EmptyMatteError


def test_the_light_of_a_background_comes_from_its_bright_side(viewed):
    street = np.full((60, 90, 3), 0.02, np.float32)
    street[:30, :20] = (4, 3, 2)  # a warm window at image left
    lights = matching.of_background(viewed, street)
    assert 1 <= len(lights) <= matching.COUNT
    strongest = lights[0]
    assert strongest["name"] == "match1"
    assert strongest["azimuth"] < -10
    assert strongest["colour"][0] > strongest["colour"][2]


def test_the_light_of_another_photograph_is_found_again(viewed):
    key = relight.DirectionalLight(azimuth=60, elevation=25, intensity=1.5)
    reference = viewed.relit([key])
    lights = matching.of_photograph(viewed, reference)
    assert lights[0]["azimuth"] == pytest.approx(60, abs=30)


def test_a_photograph_without_a_person_is_refused(viewed, monkeypatch):
    nobody = lambda: lambda encoded: np.zeros(encoded.shape[:2], np.float32)  # noqa: E731
    monkeypatch.setattr(matching.finder, "FoundPerson", nobody)
    with pytest.raises(EmptyMatteError, match="No person was found in that photograph"):
        matching.of_photograph(viewed, np.full((40, 40, 3), 0.3, np.float32))


def test_presets_have_pictures_of_the_upper_part_of_the_person(viewed):
    photograph = np.full((*viewed.size, 3), 0.3, np.float32)
    small = preset_pictures.small_of(viewed, photograph)
    assert preset_pictures.small_of(viewed, photograph) is small
    left, right = (preset_pictures.picture(small, name, 1.0) for name in ("split", "rim"))
    assert left.shape == right.shape
    assert left.shape[0] <= round(preset_pictures.TALLEST * left.shape[1])
    assert np.abs(left - right).max() > 0.05
