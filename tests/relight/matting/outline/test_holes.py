"""Holes that show the background are opened, and nothing of the person is."""

import numpy as np
import pytest
from helpers import ROOT
from helpers.drawn import photographed
from scipy import ndimage

from relight.matting.outline import Outline, Stroke, outlined
from relight.matting.outline import drawing as outline
from relight.matting.outline.background_model import BackgroundModel
from shadow.data.records import Records

WALL, CLOTH = (150, 170, 190), (170, 40, 40)
GAP = np.s_[40:70, 34:44]


def scene(gap=WALL, grey=0.8, noise=2):
    """A red figure before a wall, with a gap: codes (120, 120, 3), and a mask, grey there and on cloth."""
    matte = np.zeros((120, 120), np.float32)
    matte[20:100, 30:90] = 1
    codes = np.where(matte[..., None] > 0, CLOTH, WALL)
    codes[GAP] = gap
    matte[44:66, 37:41], matte[80:96, 60:80] = grey, 0.8
    codes = codes + np.random.default_rng(0).integers(-noise, noise + 1, (120, 120, 1))
    return codes.clip(0, 255).astype(np.uint8), matte


def without_search(monkeypatch):
    monkeypatch.setattr(outline, "holes", lambda model, inside, mask: np.zeros(inside.shape, bool))


def test_a_gap_of_the_walls_colour_that_a_mask_closes_in_part_is_opened():
    codes, mask = scene()
    found = outlined(codes, Outline(matte=mask))
    assert found[44:66, 36:42].mean() < 0.1
    assert np.delete(found[20:100, 30:90], np.s_[18:52], axis=0).mean() > 0.98


@pytest.mark.parametrize(
    ("gap", "grey", "noise"),
    [
        (WALL, 1.0, 2),  # the mask is sure: a patch on the cloth
        ((150, 60, 60), 0.8, 2),  # another colour
        (WALL, 0.8, 120),  # before clutter
    ],
)
def test_what_may_be_the_persons_is_left_as_it_is(gap, grey, noise, monkeypatch):
    codes, mask = scene(gap, grey, noise)
    found = outlined(codes, Outline(matte=mask))
    without_search(monkeypatch)
    np.testing.assert_array_equal(found, outlined(codes, Outline(matte=mask)))


def test_nothing_is_opened_where_the_person_wears_nearly_the_walls_colour(monkeypatch):
    codes, mask = scene()
    codes[20:100, 30:90] = np.where(np.arange(60)[:, None] // 4 % 2, WALL, np.add(WALL, 12))
    found = outlined(codes, Outline(matte=mask))
    without_search(monkeypatch)
    np.testing.assert_array_equal(found, outlined(codes, Outline(matte=mask)))


def test_what_stands_before_the_wall_is_none_of_its_colours():
    codes = np.full((480, 480, 3), (180, 40, 45)) + np.random.default_rng(0).integers(-2, 3, (480, 480, 1))
    codes[:, 303:307] = 10  # an umbrella
    model = BackgroundModel.of(codes / np.float32(255), np.ones((480, 480), bool))
    assert model.uniform.all()
    assert (model.distance[:, 290] < 4).all()
    assert (model.distance[:, 304] > 20).all()


def test_a_stroke_keeps_a_gap_closed():
    codes, mask = scene()
    stroke = Stroke(True, [[39, 47], [39, 63]], 4)
    assert outlined(codes, Outline(None, [stroke], mask))[43:67, 36:42].mean() > 0.8


@pytest.mark.parametrize("number", [0, 1])
def test_gaps_of_bodies_before_a_wall_are_opened(number, monkeypatch):
    pytest.importorskip("kornia")
    record, random = Records([ROOT / "tests" / "data"])[number], np.random.default_rng(number)
    wall = np.array(WALL) + random.normal(0, 2, (*record.mask.shape, 1))
    codes, truth = photographed(record, wall.astype(np.uint8), number)
    closed = ndimage.binary_closing(np.pad(truth > 0.5, 40), iterations=14)[40:-40, 40:-40]
    mask = ndimage.gaussian_filter(np.maximum(truth, np.float32(0.8) * closed), 3)
    error = np.abs(outlined(codes, Outline(matte=mask)) - truth).sum()
    without_search(monkeypatch)
    assert error < 0.4 * np.abs(outlined(codes, Outline(matte=mask)) - truth).sum()
