import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relight import DirectionalLight


def test_azimuth_and_elevation_follow_the_camera_frame():
    assert DirectionalLight().direction == pytest.approx((0, 0, 1))
    assert DirectionalLight(azimuth=90).direction == pytest.approx((1, 0, 0), abs=1e-6)
    assert DirectionalLight(azimuth=-40).direction[0] < 0  # image left
    assert DirectionalLight(elevation=90).direction == pytest.approx((0, 1, 0), abs=1e-6)
    assert DirectionalLight(azimuth=180).direction == pytest.approx((0, 0, -1), abs=1e-6)


def test_direction_is_normalised_and_reads_back_as_angles():
    light = DirectionalLight((-3, 0, 3))
    assert light.direction == pytest.approx((-math.sqrt(0.5), 0, math.sqrt(0.5)))
    assert light.azimuth == pytest.approx(-45)
    assert light.elevation == pytest.approx(0)


def test_any_length_of_direction_but_zero():
    for length in (1.7e308, 1e-5):
        np.testing.assert_allclose(DirectionalLight((length,) * 3).direction, 3**-0.5)
        np.testing.assert_allclose(DirectionalLight((0, -length, 0)).direction, (0, -1, 0))


def test_a_hard_light_is_one_sample():
    directions, intensities = DirectionalLight(
        azimuth=30, intensity=3, colour=(1, 0.5, 0), exposure=-1
    ).samples()
    assert directions.shape == intensities.shape == (1, 3)
    assert directions.dtype == intensities.dtype == np.float32
    np.testing.assert_allclose(intensities, [[1.5, 0.75, 0]])


def test_temperature_tints_at_luminance_one():
    _, plain = DirectionalLight(intensity=2).samples()
    _, warm = DirectionalLight(intensity=2, temperature=2700).samples()
    luminance = np.array([0.2126, 0.7152, 0.0722])
    assert warm @ luminance == pytest.approx(plain @ luminance, rel=1e-3)
    assert warm[0, 0] > 2 > warm[0, 2]


@settings(max_examples=30, deadline=None)
@given(st.floats(-180, 180), st.floats(-90, 90), st.floats(0.1, 180))
def test_a_soft_light_stays_in_its_cone_and_keeps_its_irradiance(azimuth, elevation, angle):
    light = DirectionalLight(azimuth=azimuth, elevation=elevation, angle=angle, colour=(1, 0.5, 0.25))
    directions, intensities = light.samples()
    facing = directions @ np.array(light.direction)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-5)
    assert facing.min() >= math.cos(math.radians(angle / 2)) - 1e-5
    np.testing.assert_allclose(facing @ intensities, (1, 0.5, 0.25), rtol=1e-4)


def test_a_temperature_is_of_a_black_body_or_of_daylight():
    _, body = DirectionalLight(temperature=6504).samples()
    _, sky = DirectionalLight(temperature=6504, locus="daylight").samples()
    np.testing.assert_allclose(sky, 1, atol=2e-3)  # D65 is Rec.709's white
    assert sky[0, 1] > body[0, 1] + 0.01  # the daylight locus runs on the green side of the Planckian


def test_settings_make_the_light_again():
    for light in (
        DirectionalLight(azimuth=-40, elevation=30, intensity=2, colour=(1, 0.9, 0.8), name="key"),
        DirectionalLight(
            azimuth=179.9, elevation=-90, temperature=5600, locus="daylight", angle=3, exposure=-1
        ),
        DirectionalLight(),
    ):
        assert DirectionalLight(**light.settings()) == light
    assert DirectionalLight((0, 0, -2), angle=5).settings() == {"azimuth": 180, "elevation": 0, "angle": 5}


def test_a_soft_light_is_even_and_repeatable():
    light = DirectionalLight((0.2, 0.5, 1), angle=60)
    directions, _ = light.samples()
    np.testing.assert_array_equal(directions, light.samples()[0])
    mean = directions.mean(axis=0)
    assert mean / np.linalg.norm(mean) @ np.array(light.direction) > math.cos(math.radians(1.5))
    # Half of a cap's area lies within half of its height.
    height = 1 - math.cos(math.radians(30))
    assert ((directions @ np.array(light.direction)) > 1 - height / 2).mean() == pytest.approx(0.5)


def test_lights_are_values():
    light = DirectionalLight(azimuth=20, name="key")
    assert light == DirectionalLight(azimuth=20, name="key")
    brighter = dataclasses.replace(light, intensity=4.0)
    assert (brighter.intensity, brighter.name) == (4.0, "key")
    assert brighter.direction == pytest.approx(light.direction)
    with pytest.raises(dataclasses.FrozenInstanceError):
        light.intensity = 2


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"direction": (0, 0, 0)}, ValueError, "direction: has zero length"),
        ({"direction": (0, 1)}, ValueError, "direction: expected 3 numbers"),
        ({"direction": (0, math.nan, 1)}, ValueError, "direction: expected 3 finite numbers"),
        ({"direction": "up"}, TypeError, "direction: expected 3 numbers"),
        ({"direction": (0, 0, 1), "azimuth": 0}, ValueError, "either a direction or an azimuth"),
        ({"direction": (0, 0, 1), "elevation": 5}, ValueError, "either a direction or an azimuth"),
        ({"azimuth": math.inf}, ValueError, "azimuth: expected a finite number"),
        ({"elevation": 91}, ValueError, "elevation: expected a number of degrees from -90 to 90, got 91"),
        ({"intensity": -1}, ValueError, "intensity: expected a number of at least 0, got -1"),
        ({"intensity": None}, TypeError, "intensity: expected a number"),
        ({"colour": (1, -1, 1)}, ValueError, "colour: expected 3 numbers of at least 0"),
        ({"colour": 1}, TypeError, "colour: expected 3 numbers"),
        ({"exposure": math.nan}, ValueError, "exposure: expected a finite number"),
        (
            {"temperature": 100},
            ValueError,
            "temperature: expected a number of kelvin from 1000 to 40000, got 100",
        ),
        (
            {"temperature": 3000, "locus": "daylight"},
            ValueError,
            "temperature: expected a number of kelvin from 4000 to 25000",
        ),
        ({"locus": "tungsten"}, ValueError, "locus: expected one of planckian, daylight, got 'tungsten'"),
        ({"intensity": "2"}, TypeError, "intensity: expected a number.*, got '2'"),
        ({"intensity": True}, TypeError, "intensity: expected a number.*, got True"),
        ({"intensity": 10**400}, TypeError, "intensity: expected a number"),
        ({"direction": "123"}, TypeError, "direction: expected 3 numbers, got '123'"),
        ({"angle": 181}, ValueError, "angle: expected a number of degrees from 0 to 180, got 181"),
        ({"name": ""}, ValueError, "name: expected a non-empty text"),
        ({"name": 3}, TypeError, "name: expected a text, got 3"),
        ({"name": "a\0b"}, ValueError, "name: expected no control characters"),
        ({"name": "a\nb"}, ValueError, "name: expected no control characters"),
        ({"name": "\ud800"}, ValueError, "name: expected no control characters"),
        ({"name": 81 * "光"}, ValueError, "name: expected at most 240 bytes of UTF-8, got 243"),
    ],
)
def test_a_directional_light_refuses_invalid_settings(arguments, error, message):
    with pytest.raises(error, match=message):
        DirectionalLight(**arguments)


def test_text_gives_a_directional_light_with_all_its_settings():
    text = "key:azimuth=-40, elevation=30,intensity=2,colour=1/0.9/0.8,exposure=1,temperature=5600,angle=5"
    assert DirectionalLight.parse(text) == DirectionalLight(
        azimuth=-40,
        elevation=30,
        intensity=2,
        colour=(1, 0.9, 0.8),
        exposure=1,
        temperature=5600,
        angle=5,
        name="key",
    )
    assert DirectionalLight.parse("direction=1/2/3") == DirectionalLight((1, 2, 3))
    assert DirectionalLight.parse("temperature=5000,locus=daylight").locus == "daylight"
    assert DirectionalLight.parse("front:") == DirectionalLight(name="front")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("key:azimut=3", "azimut: not known; did you mean azimuth?"),
        ("key:azimuth", "'azimuth' is not understood"),
        ("key:azimuth=1,azimuth=2", "'azimuth=2' is twice"),
        ("key:azimuth=leftt", "front-right, got 'leftt'; did you mean left?"),
        ("key:azimuth=1/2", "azimuth: expected a number of degrees or front"),
        ("key:colour=1/2", "colour: expected linear red/green/blue"),
        ("key:name=2", "name='2' is twice"),
        (":azimuth=2", "name: expected a non-empty text"),
        ("key:intensity=-2", "intensity: expected a number of at least 0"),
    ],
)
def test_parse_says_what_it_does_not_understand(text, message):
    with pytest.raises(ValueError, match=message) as caught:
        DirectionalLight.parse(text)
    assert repr(text) in str(caught.value)


def test_a_colon_for_a_comma_is_refused():
    with pytest.raises(ValueError, match="'azimuth=-40' is no name; settings are separated by commas"):
        DirectionalLight.parse("azimuth=-40:elevation=30")
    assert DirectionalLight.parse("a=b:azimuth=-40").name == "a=b"
