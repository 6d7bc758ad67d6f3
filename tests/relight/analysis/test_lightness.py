"""How light the albedo is: what a photograph's exposure says, within what surfaces and skin can be."""

import math

import numpy as np
import pytest
import torch

from relight.analysis.lightness import SKIN, exposure_of, factor

KNOWN = torch.ones(20, 20, dtype=torch.bool)
FACE = torch.zeros(20, 20, dtype=torch.bool)
FACE[:5] = True


def maps(albedo, light):
    return torch.full((3, 20, 20), light), torch.full((3, 20, 20), albedo)


def test_light_above_white_makes_the_albedo_lighter_and_no_lighter_than_any_surface():
    assert factor(*maps(0.3, 1.6), KNOWN, 1.0, 0.9) == pytest.approx(1.6**0.7)
    assert factor(*maps(0.6, 3.0), KNOWN, 1.0, 0.9) == pytest.approx(1.5)
    assert factor(*maps(0.95, 1.6), KNOWN, 1.0, 0.9) == 1


def test_dim_light_makes_it_darker_only_where_the_photograph_shows_white():
    assert factor(*maps(0.3, 0.6), KNOWN, 1.0, 0.9) == pytest.approx(0.6**0.7)
    assert factor(*maps(0.3, 0.6), KNOWN, 1.0, 0.4) == 1


@pytest.mark.parametrize(
    ("skin", "light", "expected"), [(0.3, 3.0, SKIN[1] / 0.3), (0.06, 0.5, SKIN[0] / 0.06)]
)
def test_a_face_stays_in_the_range_of_human_skin(skin, light, expected):
    lights, albedo = maps(skin, light)
    assert factor(lights, albedo, KNOWN, 1.0, 0.9, FACE) == pytest.approx(expected, rel=1e-3)


def test_somebody_in_white_is_no_lighter_than_surfaces_are_whatever_their_face():
    """A face in deep shadow, or one that is hair, would make white cloth brighter than any."""
    lights, albedo = maps(0.6, 0.9)
    albedo[:, FACE] = 0.01
    assert factor(lights, albedo, KNOWN, 1.0, 0.9, FACE) == pytest.approx(1.5)


def test_dark_skin_stays_dark_and_fair_skin_fair():
    """Two people in the light that a camera exposes for keep what is between them."""
    found = [factor(*maps(skin, 1.0), KNOWN, 1.0, 0.9, FACE) * skin for skin in (0.05, 0.4)]
    assert found == pytest.approx([0.05, 0.4])


def test_scene_light_and_what_is_cut_out_have_an_exposure_of_their_own():
    photo = np.full((30, 40, 3), 0.5, np.float32)
    assert exposure_of(photo)[0] == pytest.approx(0.5)
    cut = np.dstack([photo, np.ones((30, 40), np.float32)])
    assert exposure_of(cut)[0] == pytest.approx(0.5)
    cut[:5, :, 3] = 0
    assert exposure_of(cut) == (math.inf, 0)
    for brightest in (3.0, math.inf):
        assert factor(*maps(0.3, 1.6), KNOWN, brightest, 0.9) == 1
