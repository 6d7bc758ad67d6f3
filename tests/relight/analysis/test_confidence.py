import numpy as np
import pytest
import torch
from helpers import shipped

import relight
from relight.analysis import confidence

KEY = relight.DirectionalLight(azimuth=-40, elevation=30, name="key")


def test_the_confidence_of_a_light_follows_from_its_visibility(viewed):
    inside = viewed.matte > 0.99
    sure, visible = viewed.confidence(KEY), viewed.unshadowed(KEY)
    assert sure[inside].min() > 0.5
    assert sure.max() <= 1
    assert sure[viewed.matte == 0].max() == 0
    certain = inside & (np.abs(visible - 0.5) > 0.49)
    unsure = inside & (np.abs(visible - 0.5) < 0.1)
    assert sure[certain].mean() > 0.98
    assert sure[unsure].mean() < 0.75
    canvas = viewed.record.maps
    light = torch.tensor([KEY.direction])
    wrong = torch.minimum(canvas.visibility(light), 1 - canvas.visibility(light))
    expected = 1 - confidence.CALIBRATION * wrong[0]
    torch.testing.assert_close(canvas.confidence(KEY)[0][canvas.known], expected[canvas.known])


def test_all_directions_together_are_their_mean(viewed):
    maps = viewed.record.maps
    doubt = confidence.Doubt(maps.visibility)(confidence.ANCHORS).mean(dim=0)
    torch.testing.assert_close(maps.confidence()[0][maps.known], 1 - doubt[maps.known])
    assert viewed.mean_confidence == pytest.approx(float(1 - doubt[maps.known].mean()), abs=1e-5)


@pytest.mark.parametrize(
    "light",
    [
        relight.DirectionalLight(azimuth=60, angle=40),
        relight.PointLight((-1, 0.5, 1.5), radius=0.2),
        relight.EnvironmentLight(np.ones((8, 16, 3), np.float32)),
    ],
)
def test_soft_lights_lamps_and_skies_have_one_too(viewed, light):
    inside = viewed.matte > 0.99
    assert viewed.confidence(light)[inside].min() > 0.5
    assert viewed.confidence(light)[inside].mean() < 1


def test_it_is_a_pass(viewed, tmp_path):
    picture, layers = relight.rendering.render_subject(viewed, [KEY], passes=["confidence"])
    relight.write(tmp_path / "sure.exr", picture, layers=layers)
    read = relight.read_layers(tmp_path / "sure.exr")
    np.testing.assert_allclose(read["confidence"].squeeze(), viewed.confidence(), atol=1e-3)
    np.testing.assert_allclose(read["confidence_key"].squeeze(), viewed.confidence(KEY), atol=1e-3)


def test_nobody_has_none():
    assert relight.Subject.nobody((32, 24)).confidence().max() == 0


@pytest.mark.usefixtures("full_canvas")
@pytest.mark.slow
@pytest.mark.parametrize("scene", shipped.scenes(), ids=lambda scene: scene.name)
def test_what_is_stated_is_measured_on_bodies_that_no_network_has_seen(scene):
    subject = relight.Subject(scene.photograph.numpy(), scene.mask.float().numpy())
    inside = (subject.matte > 0.99) & scene.mask.numpy()
    right, stated = [], []
    for direction in shipped.LIGHTS[::4]:
        light = relight.DirectionalLight(direction.tolist())
        lit = scene.visibility[::4][len(right)].numpy() > 0.5
        right.append(((subject.unshadowed(light) > 0.5) == lit)[inside])
        stated.append(subject.confidence(light)[inside])
    right, stated = np.concatenate(right), np.concatenate(stated)
    assert stated.mean() == pytest.approx(right.mean(), abs=0.02)
    place = np.digitize(stated, [0.6, 0.7, 0.8, 0.9, 0.98])
    error = sum((place == n).mean() * abs((stated - right)[place == n].mean()) for n in np.unique(place))
    assert error < 0.03
    assert np.corrcoef(1 - stated, 1 - right)[0, 1] > 0.3
