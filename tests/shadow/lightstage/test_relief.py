"""Painted folds raised from the surface: dark is deep, and the photograph keeps its contrast."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.sphere import sphere

pytest.importorskip("kornia")

from shadow.lightstage.relief import raise_folds

SIZE = 400  # pixels: the subject is 320 high, a fold a dozen wide


@pytest.fixture(scope="module")
def large():
    return sphere(SIZE)


def grey(record, values):
    """The record with an encoded grey (N,) for its albedo."""
    return replace(
        record, albedo_uint8=np.round(255 * np.repeat(values[:, None], 3, axis=1)).astype(np.uint8)
    )


def painted(record, depth):
    """The sphere in grey with a soft vertical stripe `depth` darker, and how far right of it pixels are."""
    x = np.broadcast_to(np.arange(SIZE) - (SIZE - 1) / 2, (SIZE, SIZE))[record.mask]
    return grey(record, 0.6 * (1 - depth * np.exp(-((x / 4) ** 2)))), x


def test_a_dark_stripe_becomes_a_groove(large):
    flat, x = painted(large, 0.1)
    groove = raise_folds(flat)
    tilt = (groove.normals - flat.normals)[:, 0]
    facing, bank = flat.normals[:, 2] > 0.5, (np.abs(x) > 2) & (np.abs(x) < 5)
    assert tilt[facing & bank & (x < 0)].mean() > 0.1  # its left bank looks right, toward its floor
    assert tilt[facing & bank & (x > 0)].mean() < -0.1
    assert np.abs(tilt[facing & (np.abs(x) > 30)]).max() < 0.01
    floor, around = np.abs(x) < 1, (np.abs(x) > 30) & (np.abs(x) < 60)
    depths = [np.ptp([each.albedo[floor].mean(), each.albedo[around].mean()]) for each in (groove, flat)]
    assert depths[0] < 0.7 * depths[1]  # paint is gone where the groove is
    assert groove.about["relief"] == 1


def test_twice_as_high_is_twice_as_steep(large):
    flat, x = painted(large, 0.1)
    bank = (flat.normals[:, 2] > 0.5) & (x > 2) & (x < 5)
    base, low, high = (
        -(each.normals[bank, 0] / each.normals[bank, 2]).mean()
        for each in (flat, raise_folds(flat, 0.5), raise_folds(flat, 1.0))
    )
    assert (high - base) / (low - base) == pytest.approx(2, rel=0.05)


def test_what_turns_away_is_dark_and_nothing_else_changes(large):
    flat, _ = painted(large, 0.1)
    groove = raise_folds(flat)
    cosines = groove.normals @ groove.directions.T
    # Normals are stored in steps of half a degree: a light that grazes may fall on either side.
    assert not groove.visibility[cosines < -0.02].any()
    np.testing.assert_array_equal(groove.visibility[cosines > 0.02], flat.visibility[cosines > 0.02])
    assert groove.visibility.sum() < flat.visibility.sum()


def test_even_paint_and_hard_edges_raise_nothing(large):
    even, x = painted(large, 0.0)
    for plain in (even, grey(large, np.where(x < 0, 0.3, 0.9))):
        raised = raise_folds(plain)
        cosines = (raised.normals * plain.normals).sum(axis=1)[np.abs(x) > 6]  # an edge is a line at most
        assert np.degrees(np.arccos(cosines.clip(-1, 1))).max() < 2
        assert np.abs(raised.albedo_uint8.astype(int) - plain.albedo_uint8).max() <= 6
