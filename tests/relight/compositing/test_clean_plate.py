"""The plate without its person: no line of the old picture beside the matte, and nothing blurred."""

import numpy as np
import pytest

import relight
from relight.compositing.clean_plate import checked_plate, clean_plate

SIZE = (400, 240)  # a person of 350 pixels, whose matte is grown by 2
PERSON = np.float32([0.9, 0.1, 0.1])
WALL = np.float32([0.3, 0.35, 0.3])


def matte(left=60, right=160):
    coverage = np.zeros(SIZE, np.float32)
    coverage[25:375, left:right] = 1
    return coverage


def photograph(coverage, wall=WALL):
    return np.float32(coverage[..., None] * PERSON + (1 - coverage[..., None]) * wall)


def cleaned(plate, coverage):
    return clean_plate(plate, coverage, np.broadcast_to(PERSON, plate.shape))


def textured():
    noise = np.random.default_rng(0).normal(0, 0.05, (*SIZE, 1))
    return np.float32(WALL + noise)


def test_a_line_of_the_old_person_beside_the_matte_goes():
    plate = photograph(matte(58, 162))  # the matte below is too tight by 2 pixels on both sides
    np.testing.assert_allclose(
        cleaned(plate, matte())[40:360], np.broadcast_to(WALL, (320, 240, 3)), atol=0.02
    )


def test_it_goes_before_texture_too():
    plate = photograph(matte(58, 162), textured())
    red = cleaned(plate, matte())[40:360, [58, 59, 160, 161], 0]
    assert abs(red.mean() - WALL[0]) < 0.03


def test_texture_beside_the_matte_stays_sharp():
    coverage, wall = matte(), textured()
    found = cleaned(photograph(coverage, wall), coverage)
    beside = np.zeros(SIZE, bool)
    beside[40:360, 58:60] = True
    assert np.std(found[beside] - wall[beside]) < 0.01  # a smooth filling is off by 0.05


def test_a_soft_edge_that_is_right_gets_no_dark_contour():
    """Dark hair before a bright wall: the wall goes on behind the edge, up to where nothing of it shows."""
    wall, hair = np.float32([0.8, 0.75, 0.7]), np.float32([0.03, 0.02, 0.02])
    coverage = matte()
    coverage[25:375, 156:164] = np.linspace(0.95, 0.05, 8)
    plate = coverage[..., None] * hair + (1 - coverage[..., None]) * wall
    found = clean_plate(plate, coverage, np.broadcast_to(hair, plate.shape))
    composite = coverage[..., None] * hair + (1 - coverage[..., None]) * found
    np.testing.assert_allclose(composite[40:360, 150:170], plate[40:360, 150:170], atol=0.02)


def test_a_matte_that_is_too_low_does_not_let_the_wall_through():
    """The edge is opaque in the photograph and not in the matte: what is behind is as dark as the person."""
    wall, coat = np.float32([0.8, 0.75, 0.7]), np.float32([0.03, 0.02, 0.02])
    true, low = matte(), matte()
    low[25:375, 152:160] = 0.7
    plate = true[..., None] * coat + (1 - true[..., None]) * wall
    found = clean_plate(plate, low, np.broadcast_to(coat, plate.shape))
    assert found[40:360, 152:160].max() < 0.2


def test_a_single_hair_across_the_edge_stays():
    coverage = matte()
    plate = photograph(coverage)
    plate[200, 40:60] = 0.02
    found = cleaned(plate, coverage)
    assert found[200, 58:60].max() < 0.1
    assert found[205, 58:60].min() > 0.28


def test_codes_beyond_the_grown_matte_are_unchanged():
    coverage, wall = matte(), textured()
    plate = photograph(matte(58, 162), wall)
    found = cleaned(plate, coverage)
    far = np.ones(SIZE, bool)
    far[22:378, 57:163] = False
    np.testing.assert_array_equal(found[far], plate[far])


def test_the_photograph_comes_back_where_the_light_does():
    coverage = matte()
    ramp = np.linspace(0, 1, 9)[1:-1].astype(np.float32)
    coverage[25:375, 60:67], coverage[25:375, 153:160] = ramp, ramp[::-1]
    wall = textured()
    plate = photograph(coverage, wall)
    picture = np.dstack([coverage[..., None] * PERSON, coverage])
    made = relight.over(picture, cleaned(plate, coverage))
    edge = (coverage > 0) & (coverage < 0.4)
    assert np.abs(made - plate)[edge].mean() < 0.015  # filled smoothly, 0.03


def test_noise_in_the_matte_does_not_hide_the_plate():
    coverage = np.maximum(matte(), 3 / 255).astype(np.float32)
    plate = photograph(matte(), textured())
    np.testing.assert_array_equal(cleaned(plate, coverage)[:20], plate[:20])


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_frame_without_a_person_or_without_surroundings_is_as_it_is(value):
    plate = textured()
    np.testing.assert_array_equal(cleaned(plate, np.full(SIZE, value, np.float32)), plate)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((10, 10, 3), r"^image: expected the subject's size \(400, 240\), got \(10, 10\)$"),
        ((*SIZE, 4), "^image: expected a photograph without transparency: nothing is behind this person$"),
    ],
)
def test_what_is_no_plate_is_refused(shape, message):
    image = np.full(shape, 0.5, np.float32)
    with pytest.raises(ValueError, match=message):
        checked_plate(image, SIZE)


def test_apply_fills_the_photograph_that_is_its_own_background():
    coverage = matte()[::4, ::4]
    plate = photograph(matte(58, 162))[::4, ::4]
    light = relight.DirectionalLight(azimuth=-40)
    named = relight.apply(plate, light, mask=coverage, background="plate")
    given = relight.apply(plate, light, mask=coverage, background=plate.copy())
    np.testing.assert_array_equal(named, given)
    subject = relight.Subject(plate, coverage)
    np.testing.assert_allclose(
        named, relight.over(subject.relit(light), subject.clean_plate(plate)), atol=1e-5
    )
    assert relight.apply(plate, light, mask=coverage, background="none").shape[-1] == 4


def test_over_a_background_a_soft_edge_is_a_mixture_of_what_is_shown():
    alpha = np.linspace(0, 1, 101, dtype=np.float32)
    picture = np.stack([5 * alpha, 0.5 * alpha, 0 * alpha, alpha], axis=-1)[None]
    wall = np.full((1, 101, 3), 0.79, np.float32)
    from relight.media.images.write_image import encoded

    shown = encoded(picture, wall)[0]
    alone, behind = encoded(picture[..., :3] / np.maximum(alpha, 1e-6)[None, :, None])[0], encoded(wall)[0]
    np.testing.assert_array_equal(shown[0], behind[0])
    np.testing.assert_allclose(shown[-1], alone[-1], atol=1e-6)
    steps = np.diff(shown, axis=0)
    assert np.abs(steps).max() < 0.12  # no jump, though the curve of black is steep at its end
    assert (np.sign(steps) == np.sign(shown[-1] - shown[0])).all()
