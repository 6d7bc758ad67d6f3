import dataclasses

import numpy as np
import pytest
import torch

pytest.importorskip("kornia")

from shadow.data.records import REGIONS
from shadow.data.skin import SCATTERING_RADII, scatter

ABOUT = {"camera": {"focal": 1750.0, "mean_depth": 1.0}, "view": {"distance": 1.75}}  # a millimetre a pixel


@pytest.fixture
def skin(ball):
    """The ball as a face, and light that falls on its left half alone (N, 3)."""
    columns = np.nonzero(ball.mask)[1]
    face = np.full(len(columns), REGIONS.index("face"), np.uint8)
    lit = torch.from_numpy((columns < ball.mask.shape[1] // 2).astype(np.float32))
    record = dataclasses.replace(ball, regions=face, about=ABOUT)
    return record, lit[:, None].repeat(1, 3), columns - ball.mask.shape[1] // 2


def test_a_shadow_on_skin_has_a_red_edge(skin):
    record, light, beyond = skin
    found = scatter(record, light)
    edge = found[(beyond >= 0) & (beyond < 3)].mean(dim=0)
    assert edge[0] > 1.3 * edge[1] > 1.5 * edge[2] > 0
    # As deep into the shadow as red light gets, a Gaussian's tail of it is left.
    deep = np.abs(beyond - 1e3 * SCATTERING_RADII[0]) < 1
    assert float(found[deep, 0].mean()) == pytest.approx(0.16, abs=0.05)
    assert float(found[:, 0].mean()) == pytest.approx(float(light[:, 0].mean()), rel=0.05)
    assert found[beyond > 15].abs().max() < 1e-3


def test_light_that_is_even_stays_and_so_does_what_is_no_skin(skin):
    record, light, _ = skin
    torch.testing.assert_close(scatter(record, torch.ones_like(light)), torch.ones_like(light))
    bare = dataclasses.replace(record, regions=np.zeros_like(record.regions))
    for other in (bare, dataclasses.replace(record, regions=None), dataclasses.replace(record, about={})):
        torch.testing.assert_close(scatter(other, light), light)


def test_skin_of_half_the_pixels_scatters_as_far(skin):
    record, _, beyond = skin
    small = record.cropped(32)
    assert small.about["camera"]["focal"] < ABOUT["camera"]["focal"]
    half = int(ABOUT["camera"]["focal"] / small.about["camera"]["focal"])
    columns = np.nonzero(small.mask)[1]
    light = torch.from_numpy((columns < small.mask.shape[1] // 2).astype(np.float32))[:, None].repeat(1, 3)
    found = scatter(small, light)[:, 0]
    edge = columns == small.mask.shape[1] // 2
    near = (beyond >= 0) & (beyond < half)
    assert float(found[edge].mean()) == pytest.approx(float(scatter(*skin[:2])[near, 0].mean()), abs=0.06)
