"""The background fills the shadows of other lights: linear, a light group of its own, refused without one."""

import numpy as np
import pytest

import relight

LIGHT = relight.DirectionalLight(azimuth=-80, name="key")
BEHIND = np.random.default_rng(0).uniform(0.2, 0.6, (50, 70, 3)).astype(np.float32)


def rendered(tmp_path, person, name="a.exr", **lighting):
    rgb, mask = person
    path = tmp_path / name
    options = {"background": BEHIND, "fill": "background"} | lighting
    source, output = relight.Source(rgb, mask=mask), relight.Output(path, exr_type="float")
    relight.render_shot(source, relight.Lighting(LIGHT, **options), output)
    return relight.read(path)[..., :3], path


def test_fill_is_linear_in_its_amount_and_lights_the_shadows(tmp_path, person):
    none, some, more = (rendered(tmp_path, person, fill_amount=amount)[0] for amount in (0, 0.3, 0.6))
    np.testing.assert_allclose(some - none, (more - none) / 2, atol=1e-5)
    inside = person[1] > 0
    assert (some - none)[inside].mean() > 0.01
    np.testing.assert_allclose(none, rendered(tmp_path, person, fill=None)[0], atol=1e-6)


def test_fill_is_a_light_group_and_as_strong_as_amount_and_intensity_say(tmp_path, person):
    layers = relight.read_layers(rendered(tmp_path, person, fill_amount=0.4)[1])
    assert "C_background_fill" in layers
    again = relight.read_layers(
        rendered(tmp_path, person, "b.exr", fill_amount=0.4, amount=0.5, intensity=2)[1]
    )
    np.testing.assert_allclose(
        again["C_background_fill"][..., :3], layers["C_background_fill"][..., :3], atol=1e-5
    )


def test_the_photograph_itself_fills_where_it_is_the_background(tmp_path, person):
    rgb, mask = person
    path = tmp_path / "own.png"
    source = relight.Source(rgb.clip(0, 1), mask=mask)
    relight.render_shot(source, relight.Lighting(LIGHT, fill="background"), relight.Output(path))
    without = tmp_path / "without.png"
    relight.render_shot(source, relight.Lighting(LIGHT), relight.Output(without))
    inside = mask > 0
    assert relight.read(path)[inside].mean() > relight.read(without)[inside].mean() + 0.005


def test_it_is_refused_by_name(tmp_path, person):
    rgb, mask = person
    cut = np.dstack([rgb * mask[..., None], mask])
    with pytest.raises(ValueError, match="fill: expected a background"):
        relight.render_shot(cut, relight.Lighting(LIGHT, fill="background"), tmp_path / "a.exr")
    with pytest.raises(ValueError, match="fill: expected a background that is an image"):
        rendered(tmp_path, person, background=(0.2, 0.2, 0.2))
    with pytest.raises(ValueError, match="fill: expected none beside match_plate"):
        rendered(tmp_path, person, match_plate=True)
    with pytest.raises(ValueError, match="fill: expected one of background"):
        relight.Lighting(LIGHT, fill="sky")
    for amount in (-0.1, 1.2, float("nan")):
        with pytest.raises(ValueError, match="fill_amount"):
            relight.Lighting(LIGHT, fill="background", fill_amount=amount)
