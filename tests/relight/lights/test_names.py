"""Names of lights, equality of environments, and the other spelling of colour."""

import copy
import pickle

import numpy as np
import pytest

import relight
from relight.lights.rig import by_name


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (["light2", None], ["light2", "light3"]),
        ([None, "light1"], ["light2", "light1"]),
        ([None, "light2", None, "light4"], ["light1", "light2", "light3", "light4"]),
        (["light1", "light2", None, None], ["light1", "light2", "light3", "light4"]),
        ([None, None], ["light1", "light2"]),
    ],
)
def test_automatic_names_avoid_those_that_were_given(given, expected):
    assert list(by_name([relight.DirectionalLight(name=name) for name in given])) == expected


def test_two_lights_of_one_given_name_are_refused():
    with pytest.raises(ValueError, match=r"lights: expected different names, got key, key"):
        by_name([relight.DirectionalLight(name="key"), relight.DirectionalLight(name="key")])


def test_environments_equal_their_copies(tmp_path):
    pixels = np.random.default_rng(0).uniform(0, 2, (8, 16, 3)).astype(np.float32)
    relight.write(tmp_path / "sky.exr", pixels)
    for image in (pixels, tmp_path / "sky.exr"):
        light = relight.EnvironmentLight(image, rotation=30)
        for other in (
            relight.EnvironmentLight(np.array(image) if image is pixels else image, rotation=30),
            copy.deepcopy(light), pickle.loads(pickle.dumps(light)),
        ):  # fmt: skip
            assert other == light
            assert hash(other) == hash(light)
        assert light != relight.EnvironmentLight(image, rotation=31)
    assert relight.EnvironmentLight(pixels) != relight.EnvironmentLight(pixels * 2)
    assert relight.EnvironmentLight(pixels) != relight.EnvironmentLight(tmp_path / "sky.exr")


@pytest.mark.parametrize("kind", [relight.DirectionalLight, relight.PointLight, relight.EnvironmentLight])
def test_color_is_told_how_it_is_spelled(kind):
    with pytest.raises(TypeError, match=rf"color: not known; did you mean colour. \({kind.__name__}\)"):
        kind(color=(1, 1, 1))
    with pytest.raises(ValueError, match=r"color: not known; did you mean colour"):
        relight.DirectionalLight.parse("color=1/1/1")
