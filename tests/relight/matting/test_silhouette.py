"""A coarse mask says who and where, a network what belongs to them: hair, hands and what they hold."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.finders import discs
from helpers.onnx_models import channel

from relight import Source
from relight.matting import networks, outline, silhouette
from relight.matting.outline import Outline, Stroke
from relight.matting.people.choice import Choice
from relight.matting.people.region import ROOM, Circle, DetectedPerson
from relight.pipeline.shot import Shot

SIZE = (400, 300)
UP = np.array([0.0, -1.0])


def ellipse(centre, half, size=SIZE):
    """Where an ellipse of half-axes (x, y) around a place (x, y) is: (H, W) bool."""
    y, x = np.mgrid[: size[0], : size[1]] + 0.5
    return ((x - centre[0]) / half[0]) ** 2 + ((y - centre[1]) / half[1]) ** 2 < 1


def somebody(x, y, half, rivals=None, hand=None):
    """A person whose mask is an ellipse, in the square of 256 pixels around them, and whose hand is there."""
    radius = half[1] / 0.9
    step = 2 * ROOM * radius / 256

    def seen(centre):
        place = 128 + (np.array(centre) - (x, y)) / step
        return ellipse(place, np.array(half) / step, (256, 256)).astype(np.float32)

    beside = None if rivals is None else seen(rivals)
    landmarks = np.tile(np.array([x, y], float), (33, 1))
    landmarks[[15, 17, 19, 21]] = (x, y) if hand is None else hand
    return DetectedPerson(
        Circle(np.array([x, y], float), radius, UP), seen((x, y)), landmarks=landmarks, rivals=beside
    )


def chosen(*people, index=0):
    return Choice(people, index, SIZE)


def network_of(shown):
    """A network that shows what is red in a picture of `shown` (H, W), and counts its looks."""
    looks = []

    def network(crop, mask):
        looks.append(crop.shape)
        assert mask.shape == crop.shape[:2]
        return crop[..., 0]

    return np.repeat(shown[..., None], 3, axis=-1).astype(np.float32), network, looks


BODY = ellipse((150, 200), (40, 110))


def test_what_is_held_stays_and_what_does_not_touch_goes():
    cup, logo = ellipse((195, 200), (12, 12)), ellipse((230, 150), (8, 8))
    picture, network, looks = network_of(BODY | cup | logo)
    found = silhouette.person_matte(picture, chosen(somebody(150, 200, (36, 106), hand=(188, 200))), network)
    np.testing.assert_array_equal(found > 0.5, BODY | cup)
    assert len(looks) == 1


def test_a_mended_mask_is_the_mean_of_the_mask_and_of_what_the_network_sees():
    arm = ellipse((200, 180), (22, 9))
    picture, network, looks = network_of((BODY | arm) & ~ellipse((150, 240), (9, 9)))
    choice = chosen(somebody(150, 200, (40, 110)))
    mended = silhouette.mended_mask(picture, choice, network)
    np.testing.assert_allclose(mended, (choice.mask() + picture[..., 0]) / 2, atol=2e-3)
    assert len(looks) == 1
    np.testing.assert_array_equal(
        silhouette.mended_mask(picture, chosen(somebody(150, 200, (40, 110)), index=None), network),
        chosen(somebody(150, 200, (40, 110)), index=None).mask(),
    )


def test_a_mended_mask_takes_nothing_from_who_is_beside():
    other = ellipse((222, 200), (30, 100))
    picture, network, _ = network_of(BODY | other)
    choice = chosen(somebody(150, 200, (36, 106), rivals=(222, 200)))
    mended = silhouette.mended_mask(picture, choice, network)
    assert mended[other & ~ellipse((150, 200), (60, 130))].max() < 0.1
    assert mended[ellipse((150, 200), (25, 90))].min() > 0.95


@pytest.mark.parametrize("hand", [None, (188, 200)])
def test_what_touches_the_person_stays_in_their_hand_alone_and_not_if_it_is_large(hand):
    letter, wheel = ellipse((195, 120), (25, 12)), ellipse((222, 220), (40, 60))
    picture, network, _ = network_of(BODY | letter | wheel)
    found = silhouette.person_matte(picture, chosen(somebody(150, 200, (36, 106), hand=hand)), network)
    beside = np.arange(300) > 198
    assert found[(letter | wheel) & beside].max() == 0
    assert found[BODY].mean() > 0.95


def test_more_views_are_asked_for_where_the_networks_disagree():
    wheel = ellipse((222, 220), (40, 60))
    asked = []

    def with_more_views(choice):
        asked.append(choice)
        return chosen(somebody(150, 200, (39, 109)))

    picture, network, looks = network_of(BODY)
    choice = chosen(somebody(150, 200, (36, 106)))
    plain = silhouette.person_matte(picture, choice, network, with_more_views)
    assert not asked
    picture, network, looks = network_of(BODY | wheel)
    found = silhouette.person_matte(picture, choice, network, with_more_views)
    assert asked == [choice]
    assert len(looks) == 1
    assert np.abs(found - plain)[BODY].mean() < 0.03


def test_a_shirt_of_the_walls_colour_is_opaque_up_to_the_frame_that_cuts_it():
    shown = BODY & (np.arange(SIZE[0]) < 250)[:, None]
    picture, network, _ = network_of(shown)
    cut = replace(chosen(somebody(150, 200, (38, 108))), size=(300, 300))
    found = silhouette.person_matte(picture[:300], cut, network)
    assert found[250:][BODY[250:300]].mean() > 0.9
    assert found[~BODY[:300]].mean() < 0.01


def test_the_person_is_opaque_where_they_wear_the_colour_of_the_wall():
    shown = np.where(BODY, 0.4, 0.0)
    picture, network, _ = network_of(shown)
    found = silhouette.person_matte(picture, chosen(somebody(150, 200, (36, 106))), network)
    assert found[BODY & ellipse((150, 200), (24, 94))].min() > 0.99
    assert found[~BODY].max() == 0


def test_what_both_networks_show_is_opaque_inside():
    """A dark jacket before a dark wall, of which neither network is certain."""
    body = somebody(150, 200, (38, 108))
    unsure = np.where(np.arange(256) < 128, 0.7 * body.mask, body.mask).astype(np.float32)
    picture, network, _ = network_of(np.where(BODY & (np.arange(300) < 150), 0.75, BODY))
    found = silhouette.person_matte(picture, chosen(replace(body, mask=unsure)), network)
    assert found[BODY & ellipse((150, 200), (30, 98))].min() > 0.97
    assert found[~BODY].max() == 0


def test_the_mask_alone_counts_where_the_network_has_not_seen_the_person():
    """Small, blurred people, of whom a network shows a bright pair of shorts."""
    picture, network, _ = network_of(BODY & (abs(np.arange(SIZE[0]) - 230) < 25)[:, None])
    body = somebody(150, 200, (38, 108))
    found = silhouette.person_matte(picture, chosen(replace(body, mask=0.9 * body.mask)), network)
    assert (found[BODY] > 0.5).mean() > 0.9
    assert found[~BODY].mean() < 0.01


def test_a_white_shoe_before_a_white_wall_is_the_person():
    shoe = ellipse((150, 299), (22, 9))
    body = somebody(150, 200, (38, 108))
    landmarks = body.landmarks.copy()
    landmarks[[28, 30, 32]] = (150, 302)
    picture, network, _ = network_of(BODY & ~shoe)
    bare = silhouette.person_matte(picture, chosen(body), network)
    found = silhouette.person_matte(picture, chosen(replace(body, landmarks=landmarks)), network)
    inside = BODY & ellipse((150, 298), (8, 5))
    assert bare[inside].mean() < 0.1
    assert found[inside].mean() > 0.9


def test_a_gap_that_the_mask_closes_shows_the_background():
    gap = ellipse((128, 180), (5, 30))  # between arm and body, of which the mask is not certain
    picture, network, _ = network_of(BODY & ~gap)
    body = somebody(150, 200, (36, 106))
    mask = np.where(np.arange(256) < 120, np.minimum(body.mask, 0.8), body.mask).astype(np.float32)
    found = silhouette.person_matte(picture, chosen(replace(body, mask=mask)), network)
    assert found[gap].max() < 0.05


@pytest.mark.parametrize("way", ["found besides", "found with them"])
def test_a_neighbour_who_touches_is_divided_off(way):
    other = ellipse((220, 200), (35, 105))
    picture, network, _ = network_of(BODY | other)
    if way == "found besides":
        choice = chosen(somebody(150, 200, (36, 106)), somebody(222, 200, (33, 103)))
    else:
        choice = chosen(somebody(150, 200, (36, 106), rivals=(222, 200)))
    found = silhouette.person_matte(picture, choice, network)
    assert found[BODY & (np.arange(300) < 180)].mean() > 0.98
    assert found[other & (np.arange(300) > 192)].mean() < 0.02
    both = silhouette.person_matte(picture, chosen(*choice.people, index=None), network)
    assert both[BODY].mean() > 0.96


def test_the_crop_grows_until_nothing_reaches_its_border():
    pole = np.zeros(SIZE, bool)
    pole[198:203, 150:290] = True
    picture, network, looks = network_of(BODY | pole)
    found = silhouette.person_matte(picture, chosen(somebody(150, 200, (36, 106), hand=(188, 200))), network)
    np.testing.assert_array_equal(found > 0.5, BODY | pole)
    assert len(looks) > 1


def test_who_fills_most_of_a_picture_is_looked_for_in_all_of_it_at_once():
    size = (240, 220)
    body, pole = ellipse((110, 120), (40, 105), size), np.zeros(size, bool)
    pole[118:123, 110:215] = True
    picture, network, looks = network_of(body | pole)
    person = somebody(110, 120, (40, 105), hand=(148, 120))
    found = silhouette.person_matte(picture, Choice((person,), 0, size), network)
    np.testing.assert_array_equal(found > 0.5, body | pole)
    assert looks == [(*size, 3)]


def test_a_crop_that_would_have_to_grow_further_is_still_in_its_place():
    size = (60, 1200)
    body = ellipse((10, 30), (10, 22), size)
    pole = np.zeros(size, bool)
    pole[29:31, 10:1150] = True
    picture, network, looks = network_of(body | pole)
    person = somebody(10, 30, (10, 22), hand=(18, 30))
    found = silhouette.person_matte(picture, Choice((person,), 0, size), network)
    assert len(looks) == silhouette.CROPS
    reached = looks[-1][1]  # the crop begins at the left edge of the picture
    np.testing.assert_array_equal(found[:, :reached] > 0.5, (body | pole)[:, :reached])
    assert found[:, reached:].max() == 0


def test_haze_far_from_the_person_goes():
    haze = ellipse((220, 200), (40, 20))
    picture, network, _ = network_of(np.maximum(BODY, 0.3 * haze))
    found = silhouette.person_matte(picture, chosen(somebody(150, 200, (36, 106))), network)
    assert found[:, 215:].max() == 0


def test_a_large_picture_keeps_its_own_edges():
    """The network sees 1024 pixels, and the photograph has four times as many across each edge."""
    size = (3600, 2400)
    body = ellipse((1200, 1800), (400, 1100), size)
    picture = np.repeat(np.where(body, 0.9, 0.1)[..., None], 3, axis=-1).astype(np.float32)
    centre = np.array([1200.0, 1800.0])
    mask = somebody(150, 200, (36, 106)).mask
    choice = Choice((DetectedPerson(Circle(centre, 1180.0, UP), mask),), 0, size)
    found = silhouette.person_matte(picture, choice, lambda crop, _: (crop[..., 0] - 0.1) / 0.8)
    assert np.abs(found - body).mean() < 0.0005
    row = found[1800, 1560:1640]  # the edge at 1600
    assert (row[:38] > 0.9).all()
    assert (row[42:] < 0.1).all()


def test_nothing_is_beyond_what_was_drawn():
    picture, network, _ = network_of(BODY | ellipse((240, 200), (20, 60)))
    outer = ellipse((150, 200), (48, 120))
    found = silhouette.matte_within(picture, outer, network)
    np.testing.assert_array_equal(found > 0.5, BODY)
    assert silhouette.matte_within(picture, np.zeros(SIZE), network) is None
    empty, network, _ = network_of(np.zeros(SIZE))
    assert silhouette.matte_within(empty, outer, network) is None


def test_strokes_change_a_right_matte_only_where_they_are():
    rng = np.random.default_rng(0)
    soft = np.where(BODY, 1, 0.3 * ellipse((150, 200), (60, 130)) * rng.random(SIZE)).astype(np.float32)
    codes = np.round(255 * np.where(BODY, 0.8, 0.2)[..., None] * np.ones(3)).astype(np.uint8)
    stroke = Stroke(False, [[150, 300]], 10)
    found = outline.outlined(codes, Outline(None, [stroke], soft, tolerance=0))
    assert found[296:304, 146:154].max() < 0.01
    np.testing.assert_array_equal(found[:250], soft[:250])


def test_another_network_cuts_out_who_is_found(tmp_path, fetched):
    picture, (where,) = discs((160, 160), (90, 70, 14))
    file = channel(tmp_path / "red.onnx", 0)
    how = {"mean": (0, 0, 0), "std": (1, 1, 1), "size": 64}
    found = networks.load("auto", silhouette=str(file), **how)(picture)
    assert ((found > 0.5) & where).sum() > 0.9 * where.sum()
    assert found[~where].mean() > 0  # the grey wall beside the disc, which no rule of ours would keep
    with pytest.raises(ValueError, match="'auto' takes no options without silhouette"):
        networks.load("auto", **how)
    with pytest.raises(ValueError, match="silhouette: expected the model 'auto'"):
        networks.load(str(file), silhouette=str(file))
    options = f"auto,silhouette={file},mean=0/0/0,std=1/1/1,size=64"
    hashes = {Shot(Source(picture, matte=matte)).frames.options_hash for matte in ("auto", options)}
    assert len(hashes) == 2
