"""Parts of a person that a soft mask loses before a wall are found, and nothing of the wall is."""

import numpy as np
import pytest
from helpers import ROOT
from helpers.drawn import photographed
from scipy import ndimage

from relight.matting.outline import Outline, Stroke, outlined
from relight.matting.outline import drawing as outline
from shadow.data.records import Records

WALL, CLOTH, SHADOW = (200, 205, 210), (170, 60, 60), (120, 123, 126)
LOST = np.s_[60:118, 56:84]


def scene(part=CLOTH, grey=0.2, noise=2):
    """A skirt between two legs: codes (140, 140, 3), the truth, and a mask without the skirt."""
    truth = np.zeros((140, 140), np.float32)
    truth[20:120, 30:110] = 1
    codes = np.where(truth[..., None] > 0, CLOTH, WALL)
    codes[LOST] = part
    mask = truth.copy()
    mask[LOST] = np.where(np.arange(58)[:, None] < 40, grey, 0)
    mask[118:120, 56:84], mask[24:40, 40:100] = 0, 0.8  # a soft mask
    codes = codes + np.random.default_rng(0).integers(-noise, noise + 1, (140, 140, 1))
    return codes.clip(0, 255).astype(np.uint8), truth, mask


def without_search(monkeypatch, codes, drawn):
    monkeypatch.setattr(outline, "lost_parts", lambda seen, mask, least: np.zeros(mask.shape, bool))
    return outlined(codes, drawn)


def test_a_part_that_is_clearly_not_the_wall_is_the_persons():
    codes, truth, mask = scene()
    assert np.abs(outlined(codes, Outline(matte=mask)) - truth).mean() < 0.005


@pytest.mark.parametrize(
    ("part", "grey", "noise"),
    [
        (WALL, 0.2, 2),  # the wall between the legs
        (SHADOW, 0.0, 2),  # the mask is sure: a shadow, or somebody else
        (CLOTH, 0.2, 120),  # before clutter
    ],
)
def test_what_may_not_be_the_persons_is_left_as_it_is(part, grey, noise, monkeypatch):
    codes, _, mask = scene(part, grey, noise)
    drawn = Outline(matte=mask)
    np.testing.assert_array_equal(outlined(codes, drawn), without_search(monkeypatch, codes, drawn))


def test_what_the_mask_surrounds_is_no_part(monkeypatch):
    codes, _, mask = scene(np.subtract(WALL, 30))
    codes[110:120], mask[110:120, 30:110] = CLOTH, 1
    drawn = Outline(matte=mask)
    np.testing.assert_array_equal(outlined(codes, drawn), without_search(monkeypatch, codes, drawn))


def test_a_stroke_and_a_line_keep_a_part_out():
    codes, _, mask = scene()
    stroke = Stroke(False, [[70, 70], [70, 110]], 4)
    hole = [[54, 58], [86, 58], [86, 122], [54, 122]]
    for drawn in (Outline(None, [stroke], mask), Outline(None, [], mask, [hole])):
        assert outlined(codes, drawn)[66:114, 66:74].mean() < 0.2


@pytest.mark.parametrize("number", [0, 1])
def test_a_body_whose_mask_ends_at_the_waist_is_completed(number, monkeypatch):
    pytest.importorskip("kornia")
    record, random = Records([ROOT / "tests" / "data"])[number], np.random.default_rng(number)
    wall = np.array(WALL) + random.normal(0, 2, (*record.mask.shape, 1))
    codes, truth = photographed(record, wall.astype(np.uint8), number)
    rows = np.nonzero(truth.max(axis=1) > 0.5)[0]
    share = np.linspace(0, 1, len(rows))[:, None]
    certainty = np.ones(truth.shape, np.float32)
    certainty[rows] = np.where((share > 0.5) & (share < 0.7), 0.2, 1)
    mask = ndimage.gaussian_filter(truth * certainty, 3)
    error = np.abs(outlined(codes, Outline(matte=mask)) - truth).sum()
    assert error < 0.4 * np.abs(without_search(monkeypatch, codes, Outline(matte=mask)) - truth).sum()
