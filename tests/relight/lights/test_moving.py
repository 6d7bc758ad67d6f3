import numpy as np
import pytest

import relight
from relight.lights.moving import lights_at, parse


def test_numbers_and_colours_change_linearly_and_rest_outside():
    light = relight.MovingLight(
        azimuth={10: -90, 20: 90, 30: 0},
        intensity={10: 1, 20: 3},
        colour={10: (1, 0, 0), 20: (0, 0, 1)},
        name="key",
    )
    assert light.name == "key"
    assert light.span == (10, 30)
    middle = light.at(15)
    assert middle.azimuth == pytest.approx(0)
    assert middle.intensity == pytest.approx(2)
    assert middle.colour == pytest.approx((0.5, 0, 0.5))
    assert light.at(1) == light.at(10)
    assert light.at(99) == light.at(30)
    assert light.at(25).azimuth == pytest.approx(45)
    assert light.at(12.5).azimuth == pytest.approx(-45)


def test_directions_follow_the_great_circle_at_even_speed():
    light = relight.MovingLight(direction={0: (2, 0, 0), 8: (0, 0, 1), 16: (0, 3, 0)})
    steps = np.array([light.at(frame).direction for frame in range(17)])
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1), 1)
    turns = (steps[1:] * steps[:-1]).sum(axis=1)
    np.testing.assert_allclose(turns, np.cos(np.radians(90 / 8)), atol=1e-9)
    np.testing.assert_allclose(steps[4], (2**-0.5, 0, 2**-0.5), atol=1e-9)
    np.testing.assert_allclose(steps[12], (0, 2**-0.5, 2**-0.5), atol=1e-9)


@pytest.mark.parametrize(("orbit", "quarter"), [(40, 130), (-40, -50)])
def test_an_orbit_turns_the_azimuth(orbit, quarter):
    light = relight.MovingLight(azimuth=40, elevation=20, orbit=orbit)
    assert light.at(1).azimuth == pytest.approx(40)
    assert light.at(11).azimuth == pytest.approx(quarter)
    np.testing.assert_allclose(light.at(41).direction, light.at(1).direction, atol=1e-9)
    assert light.at(7).elevation == pytest.approx(20)
    assert light.span is None


def test_an_environment_turns(tmp_path):
    sky = np.zeros((8, 16, 3), np.float32)
    sky[2:4, 8:10] = 1
    relight.write(tmp_path / "sky.exr", sky)
    for image in (sky, tmp_path / "sky.exr"):
        light = relight.MovingLight(relight.EnvironmentLight, image=image, rotation=30, orbit=90)
        still = relight.EnvironmentLight(sky, rotation=30 + 40)
        np.testing.assert_allclose(light.at(11).samples()[0], still.samples()[0], atol=1e-6)
        assert light.at(3).image is light.at(4).image


def test_moving_lights_are_placed_at_a_frame_and_still_ones_kept():
    moving, still = relight.MovingLight(azimuth={1: 0, 3: 20}), relight.DirectionalLight(name="fill")
    first, second = lights_at([moving, still], 2)
    assert first == relight.DirectionalLight(azimuth=10)
    assert second is still


def test_text_with_an_orbit():
    light = parse("key:azimuth=-40, orbit=200,elevation=20")
    assert light.name == "key"
    assert light.at(51).azimuth == pytest.approx(50)
    assert parse("key:azimuth=-40") == relight.DirectionalLight(azimuth=-40, name="key")
    with pytest.raises(ValueError, match="light 'key:orbit=fast'"):
        parse("key:orbit=fast")
    with pytest.raises(ValueError, match="azimut: not known; did you mean azimuth"):
        parse("key:azimut=3,orbit=5")


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"azimuth": {}}, ValueError, "azimuth: expected keyframes, got none"),
        ({"azimuth": {"soon": 3}}, ValueError, "azimuth: expected the number of a frame, got 'soon'"),
        ({"azimuth": {1: "left"}}, TypeError, "azimuth: expected numbers at frame 1, got 'left'"),
        ({"azimuth": {1: (1, 2, 3)}}, TypeError, "azimuth: expected a number"),
        ({"colour": {1: 1.0}}, TypeError, "colour: expected 3 numbers"),
        ({"colour": {1: (1, 1, 1), 2: 1.0}}, ValueError, "colour: expected numbers or vectors"),
        ({"intensity": {1: 1, 9: -1}}, ValueError, "intensity: expected a number of at least 0, got -1"),
        (
            {"elevation": {1: 0, 9: 91}},
            ValueError,
            "elevation: expected a number of degrees from -90 to 90, got 91",
        ),
        ({"direction": {1: (0, 0, 0)}}, ValueError, "direction: has zero length"),
        ({"direction": {1: (1, 0, 0), 9: (-2, 0, 0)}}, ValueError, "direction: opposite in successive"),
        ({"name": {1: "key"}}, TypeError, "name: expected numbers at frame 1"),
        ({"orbit": 0}, ValueError, "orbit: expected the frames of a turn"),
        ({"orbit": True}, ValueError, "orbit: expected the frames of a turn"),
        ({"orbit": 9, "direction": (0, 0, 1)}, ValueError, "orbit: needs a light given by azimuth"),
    ],
)
def test_bad_motion_is_named(arguments, error, message):
    with pytest.raises(error, match=message):
        relight.MovingLight(**arguments)


def test_a_moving_light_does_not_light_a_still():
    image = np.full((20, 20, 4), 0.5, np.float32)
    image[0] = 0
    image[1:, :, 3] = 1
    with pytest.raises(TypeError, match=r"lights: key moves; give the light of one frame, light.at\(frame\)"):
        relight.apply(image, relight.MovingLight(orbit=9, name="key"))


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_the_lights_file_holds_motion(tmp_path, suffix):
    lights = [
        relight.MovingLight(azimuth={1: -90, 12.5: 60}, elevation=15, intensity={1: 0.5, 100: 2}, name="sun"),
        relight.MovingLight(direction={1: (1, 0, 0), 50: (0, 1, 0)}, temperature=4000),
        relight.MovingLight(azimuth=30, orbit=-120, name="rim"),
        relight.DirectionalLight(azimuth=10, name="still"),
    ]
    relight.write_lights(tmp_path / f"a{suffix}", lights)
    back = relight.read_lights(tmp_path / f"a{suffix}")
    for light, same in zip(lights, back, strict=True):
        assert type(same) is type(light)
    for frame in (1, 7, 40.5, 300):
        for light, same in zip(lights_at(lights, frame), lights_at(back, frame), strict=True):
            assert same.name == light.name
            np.testing.assert_allclose(same.samples()[0], light.samples()[0], atol=1e-5)
            np.testing.assert_allclose(same.samples()[1], light.samples()[1], rtol=1e-5)


def test_a_person_writes_it(tmp_path):
    (tmp_path / "a.yaml").write_text("lights:\n  - {name: sun, azimuth: {1: -90, 101: 90}, orbit: 400}\n")
    (light,) = relight.read_lights(tmp_path / "a.yaml")
    assert light.at(101).azimuth == pytest.approx(180)
    (tmp_path / "b.yaml").write_text("lights:\n  - {name: sun, intensity: {1: 2, 5: bright}}\n")
    with pytest.raises(ValueError, match=r"b\.yaml: light 1 \(sun\): intensity: expected numbers at frame 5"):
        relight.read_lights(tmp_path / "b.yaml")
