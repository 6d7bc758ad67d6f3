"""Albedo that no surface has is counted, and what paint can be is not."""

import numpy as np
import pytest

from shading import excess
from shadow.data import records


@pytest.fixture
def coat():
    """Truth (N, 3) of two materials, and the light on it: a half of each is in shadow."""
    truth = np.repeat(np.float32([[0.2, 0.21, 0.2], [0.5, 0.1, 0.1]]), 200, axis=0)
    light = np.tile(np.repeat(np.float32([1.0, 0.05]), 100), 2)
    return truth, light


def test_true_albedo_has_no_excess(coat):
    truth, light = coat
    bright, colourful, compared, total = excess.count(truth, truth, light)
    assert bright == colourful == 0
    assert (compared, total) == (200, 400)


def test_blue_that_the_sky_left_in_shadow_counts_and_paint_does_not(coat):
    truth, light = coat
    estimate = truth.copy()
    estimate[100:200] *= [0.6, 1, 1.4]  # the grey coat, in shadow only
    assert excess.count(estimate, truth, light)[1] == 100
    estimate[:100] *= [0.6, 1, 1.4]  # the same all over is another paint, not a shadow's colour
    assert excess.count(estimate, truth, light)[1] == 0


def test_what_glows_counts_once(coat):
    truth, light = coat
    estimate = truth.copy()
    estimate[150:160] = [0.95, 0.3, 0.1]
    assert excess.count(estimate, truth, light)[:2].tolist() == [10, 0]


def test_a_material_that_no_light_reaches_cannot_be_compared(coat):
    truth, light = coat
    assert excess.count(truth * [1, 0.5, 0.5], truth, np.where(truth[:, 0] > 0.4, light, 0.05))[2] == 100


def test_shipped_weights_are_measured(ball, tmp_path, monkeypatch):
    records.write(tmp_path / "a.npz", ball)
    found = excess.evaluate([tmp_path])
    assert set(found) == {"photograph", "albedo"}
    assert all(each.wrong == 0 and each.views == 1 for each in found.values())  # its paint is below 0.9
    assert "together" in excess.report(found)
    monkeypatch.setattr(excess, "BRIGHTEST_PAINT", -1.0)  # now every pixel of the subject is too bright
    assert all(each.bright == each.wrong == 1 for each in excess.evaluate([tmp_path]).values())
