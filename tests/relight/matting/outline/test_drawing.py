"""What a person draws becomes a matte."""

import numpy as np
import pytest
from helpers import ROOT
from helpers.drawn import overlap, photographed, polygon
from scipy import ndimage

from relight.matting.outline.drawing import Outline, Stroke, outlined, refine, shift_edge, widened
from relight.matting.refine import BACKGROUND, PERSON, UNKNOWN, smooth_where_alike
from shadow.data.records import Records

SQUARE = [[30, 20], [90, 20], [90, 100], [30, 100]]


def scene(seed=0):
    """A red figure of 60 x 80 pixels before grey-green leaves: codes (120, 120, 3) and its matte."""
    random = np.random.default_rng(seed)
    codes = random.integers(70, 130, (120, 120, 1)) + np.array([0, 20, 0])
    matte = np.zeros((120, 120), np.float32)
    matte[20:100, 30:90] = 1
    codes = np.where(
        matte[..., None] > 0, random.integers(0, 30, (120, 120, 1)) + np.array([170, 40, 40]), codes
    )
    return codes.astype(np.uint8), matte


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_polygon_of_24_points_becomes_the_matte_of_a_body(number):
    pytest.importorskip("kornia")
    from skimage import data

    background = (data.chelsea, data.coffee, data.astronaut)[number]()
    image, truth = photographed(Records([ROOT / "tests" / "data"])[number], background, number)
    line = polygon(truth, number)
    assert 20 <= len(line) <= 25
    coarse = outlined(image, Outline(line))
    assert overlap(coarse, truth) >= 0.95
    assert overlap(refine(image, coarse), truth) >= 0.97


def test_a_part_that_a_line_cuts_off_is_found_by_its_colour():
    pytest.importorskip("kornia")
    from skimage import data

    image, truth = photographed(Records([ROOT / "tests" / "data"])[0], data.coffee(), 0)
    assert overlap(refine(image, outlined(image, Outline(polygon(truth, 0)))), truth) > 0.985


def test_fingers_and_gaps_of_two_pixels_are_found():
    random = np.random.default_rng(0)
    truth = np.zeros((700, 420), np.float32)
    truth[60:640, 120:300] = 1
    for row in range(320, 380, 4):
        truth[row : row + 2, 300:320] = 1
    wall, cloth = random.integers(110, 150, (2, *truth.shape, 1)) + np.array([[[[0, 0, 40]]], [[[40, 0, 0]]]])
    codes = np.where(truth[..., None] > 0, cloth, wall).astype(np.uint8)
    line = [[112, 52], [308, 52], [308, 648], [112, 648]]
    hand = np.s_[320:380, 302:318]
    assert overlap(outlined(codes, Outline(line))[hand], truth[hand]) > 0.95


def test_the_edge_of_a_sharp_mask_is_moved_to_that_of_the_photograph():
    pytest.importorskip("kornia")
    from skimage import data

    image, truth = photographed(Records([ROOT / "tests" / "data"])[0], data.chelsea(), 0)
    mask = np.float32(ndimage.binary_dilation(truth > 0.5, iterations=5))
    assert overlap(mask, truth) < 0.85
    assert overlap(outlined(image, Outline(matte=mask)), truth) > 0.98


def test_the_band_of_a_sharp_mask_goes_on_where_colours_contradict_its_rim():
    distance = np.broadcast_to(np.linspace(2.95, -2.95, 60)[:, None], (60, 40))
    distance = np.where(np.arange(40) >= 35, np.inf * np.sign(distance), distance)  # a stroke
    known = np.where(distance >= 1, PERSON, np.where(distance <= -1, BACKGROUND, UNKNOWN))
    votes = np.where((known == UNKNOWN) & (np.arange(40) < 20), -6, 6 * np.sign(distance))
    wider, near = widened(known, distance, votes)
    assert (wider[18:21, 5:15] == UNKNOWN).all()  # beyond the rim, into the person
    assert (near[18:21, 5:15] < 0.3).all()
    np.testing.assert_array_equal(wider[:15], known[:15])  # no farther than the tolerance
    np.testing.assert_array_equal(wider[:, 30:], known[:, 30:])
    np.testing.assert_array_equal(wider[40:], known[40:])


def test_a_ragged_contour_is_smoothed_where_person_and_wall_have_one_colour_and_only_there():
    steps = np.where(np.arange(160) // 8 % 2, 3, -3)  # as JPEG's blocks
    alpha = np.float32(np.arange(120) < 60 + steps[:, None])
    wall, alike, other = (np.full((160, 120, 3), level, np.float32) for level in (0.8, 0.79, 0.5))
    person = alpha[..., None] > 0
    smooth = smooth_where_alike(np.where(person, alike, wall), alpha)
    assert np.std(alpha.sum(axis=1)) == 3
    assert np.std(smooth[20:-20].sum(axis=1)) < 1.2
    np.testing.assert_allclose(smooth_where_alike(np.where(person, other, wall), alpha), alpha, atol=1e-3)


def test_strokes_correct_what_the_line_found_and_the_later_one_counts():
    image, matte = scene()
    off = Outline(SQUARE, [Stroke(False, [[60, 60]], 10)])
    assert outlined(image, off)[60, 60] == 0
    back = Outline(SQUARE, [Stroke(False, [[60, 60]], 10), Stroke(True, [[60, 60]], 10)])
    assert overlap(outlined(image, back), matte) > 0.98


def test_strokes_alone_say_who_is_meant():
    image, _ = scene()
    strokes = [
        Stroke(True, [[60, 25], [60, 95]], 12),
        Stroke(False, [[8, 8], [112, 8], [112, 112], [8, 112], [8, 8]], 6),
    ]
    found = outlined(image, Outline(None, strokes))
    assert found[60, 60] == 1
    assert found[4, 60] == 0


def test_a_networks_matte_is_corrected():
    image, matte = scene()
    rough = matte.copy()
    rough[70:100, 30:50] = 0  # it missed a leg
    found = outlined(image, Outline(None, [Stroke(True, [[40, 75], [40, 95]], 9)], rough))
    assert overlap(found, matte) > overlap(rough, matte) + 0.05


def test_a_line_may_cross_itself_and_leave_the_picture():
    image, matte = scene()
    crossing = [[30, 20], [90, 20], [90, 100], [30, 100], [30, 20], [90, 21], [91, 100]]
    assert overlap(outlined(image, Outline(crossing)), matte) > 0.97
    beyond = [[-500, -40], [90, -40], [90, 900], [-500, 900]]
    assert outlined(image, Outline(beyond))[60, 10] > 0.5


@pytest.mark.parametrize(
    ("outline", "words"),
    [
        (Outline(), "nothing was drawn"),
        (Outline([[1, 1], [5, 5]]), "three points or more"),
        (Outline([[-90, -90], [-40, -90], [-40, -30]]), "beside the photograph"),
        (Outline([[1, 1], [np.nan, 4], [9, 9]]), "finite"),
        (Outline(SQUARE, [Stroke(False, [[0, 60], [120, 60]], 90)]), "nothing of the person"),
        (Outline([[-9, -9], [130, -9], [130, 130], [-9, 130]]), "something behind the person"),
        (Outline(matte=np.ones((3, 3))), "photograph's size"),
    ],
)
def test_an_outline_that_means_nobody_is_said(outline, words):
    with pytest.raises(ValueError, match=words):
        outlined(scene()[0], outline)


def test_refining_brings_a_matte_to_the_photographs_own_pixels():
    image, matte = scene()
    soft = np.clip(np.linspace(-0.5, 1.5, 120), 0, 1)[None] * matte
    with pytest.raises(ValueError, match="photograph's size"):
        refine(image, soft[:50])
    with pytest.raises(ValueError, match="shows no person"):
        refine(image, np.zeros_like(matte))
    large = image.repeat(12, 0).repeat(12, 1)
    found = refine(large, matte.repeat(12, 0).repeat(12, 1))
    assert found.shape == (1440, 1440)
    assert overlap(found, matte.repeat(12, 0).repeat(12, 1)) > 0.99


@pytest.mark.parametrize("empty", [0, 1, 3])
def test_a_matte_of_nearly_the_whole_picture_is_refined(empty):
    image, _ = scene()
    matte = np.ones((120, 120), np.float32)
    matte[:empty, :empty] = 0
    np.testing.assert_allclose(refine(image, matte).mean(), 1, atol=0.005)
    np.testing.assert_array_equal(refine(image, np.full((120, 120), 0.3, np.float32)), 0)


def test_a_second_line_takes_out_what_the_first_one_holds():
    codes, matte = scene()
    codes[45:75, 45:75] = codes[:30, :30]  # leaves, seen through the person
    hole = [[43, 43], [77, 43], [77, 77], [43, 77]]
    found = outlined(codes, Outline(SQUARE, holes=[hole]))
    assert found[50:70, 50:70].max() < 0.1
    matte[45:75, 45:75] = 0
    assert overlap(found, matte) > 0.95
    assert overlap(outlined(codes, Outline(matte=scene()[1], holes=[hole])), matte) > 0.95


@pytest.mark.parametrize("shift", [3.0, 1.5, -2.0])
def test_an_edge_moves_by_the_pixels_asked_for_and_stays_as_soft_as_it_was(shift):
    ramp = np.clip((np.hypot(*(np.mgrid[:120, :120] - 60)) - 40) / -8 + 0.5, 0, 1).astype(np.float32)
    moved = shift_edge(ramp, shift)
    assert np.interp(0.5, moved[60, :60], np.arange(60)) == pytest.approx(20 - shift, abs=0.15)
    soft = [((row > 0.05) & (row < 0.95)).sum() for row in (ramp[60], moved[60])]
    assert abs(soft[0] - soft[1]) <= 2  # of 16, over both edges
    np.testing.assert_array_equal(shift_edge(ramp), ramp)


def test_a_feathered_edge_is_softer_and_stays_in_place():
    _, matte = scene()
    soft = shift_edge(matte, feather=3)
    assert ((soft[60] > 0.05) & (soft[60] < 0.95)).sum() > 12
    assert np.interp(0.5, soft[60, :60], np.arange(60)) == pytest.approx(29.5, abs=0.1)
