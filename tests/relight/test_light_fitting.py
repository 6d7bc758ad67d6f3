import numpy as np
import pytest
from helpers import ROOT

import relight
from relight.media.colour import encode

PERSON = ROOT / "examples" / "person.png"


@pytest.fixture(scope="module")
def photograph():
    return np.ascontiguousarray(relight.read(PERSON)[::3, ::3])


@pytest.fixture(scope="module")
def subject(photograph):
    return relight.Subject(photograph)


def test_lights_that_were_set_are_found(subject):
    warm = relight.DirectionalLight(azimuth=-50, elevation=30, colour=(1, 0.8, 0.5))
    cold = relight.DirectionalLight(azimuth=120, elevation=10, colour=(0.2, 0.3, 0.5))
    picture = subject.relit([warm, cold])
    lights = relight.fit_lights(picture, subject)
    powers = np.array([light.power for light in lights])
    directions = np.array([light.direction for light in lights])
    assert powers.min() >= 0
    assert (np.diff(powers.sum(axis=1)) <= 1e-6).all()
    near = directions @ warm.direction > np.cos(np.radians(25))
    np.testing.assert_allclose(powers[near].sum(axis=0), warm.power, rtol=0.25)
    again = subject.relit(lights)
    inside = picture[..., 3] > 0.9
    error = np.sqrt(((again - picture)[inside] ** 2).mean()) / picture[inside][:, :3].std()
    assert error < 0.2


def test_a_photograph_is_explained_by_its_lights(photograph, subject):
    lights = relight.fit_lights(photograph)
    inside = photograph[..., 3] > 0.9
    again, seen = subject.relit(lights)[inside][:, :3], photograph[inside][:, :3]
    assert np.corrcoef(again.ravel(), seen.ravel())[0, 1] > 0.95
    np.testing.assert_allclose(again.mean(axis=0), seen.mean(axis=0), rtol=0.1)
    bright = relight.fit_lights(photograph * (2, 2, 2, 1))
    total = [sum(light.power for light in each) for each in (lights, bright)]
    np.testing.assert_allclose(total[1], 2 * total[0], rtol=0.02)


def test_relit_by_its_own_lights_a_photograph_comes_back(photograph, subject):
    again = subject.relit(relight.fit_lights(photograph, subject))
    inside = photograph[..., 3] > 0.98
    wrong = encode(again[inside, :3]) - encode(photograph[inside, :3])
    assert np.sqrt((wrong**2).mean()) < 0.036


def test_another_size_is_refused(photograph, subject):
    with pytest.raises(ValueError, match="image: expected the subject's size"):
        relight.fit_lights(photograph[:-1], subject)
