"""How much of the new light there is: amount, intensity, and presets that leave the face as it was."""

import numpy as np
import pytest
from helpers.standins import ball, image_of

import relight
from relight.lights import presets
from relight.media.colour import luminance

LIGHTS = [
    relight.DirectionalLight(azimuth=-50, elevation=30, intensity=2, colour=(1, 0.8, 0.6), name="key"),
    relight.DirectionalLight(azimuth=150, elevation=20, name="rim"),
]
BEHIND = np.full((200, 160, 3), 0.25, np.float32)


def photograph():
    coverage, normals = ball(200, 160)
    image = image_of(coverage)
    shade = np.float32(0.4) + np.float32(0.6) * normals[..., :1].clip(0, 1)
    image[..., :3] *= shade
    return image, normals


@pytest.fixture(scope="module")
def person():
    image, normals = photograph()
    return relight.Subject(image, normals=normals)


def test_amount_leads_from_the_photograph_to_the_lights(person):
    image, _ = photograph()
    inside = person.matte == 1
    none, half, all_of_it = (person.relit(LIGHTS, 0.5, amount) for amount in (0, 0.5, 1))
    np.testing.assert_allclose(none[inside], image[inside], atol=2e-3)
    np.testing.assert_array_equal(all_of_it, person.relit(LIGHTS, 0.5))
    np.testing.assert_allclose(half, (none + all_of_it) / 2, atol=1e-6)
    assert np.abs(none - all_of_it)[inside].max() > 0.1


def test_layers_and_light_groups_with_an_amount_sum_to_the_picture(person):
    layers = person.layers(LIGHTS, 0.5, 0.3)
    assert [*layers] == ["photograph", "key", "rim"]
    np.testing.assert_allclose(
        sum(layer[..., :3] for layer in layers.values()), person.relit(LIGHTS, 0.5, 0.3)[..., :3], atol=1e-6
    )
    picture, groups = relight.rendering.render_subject(
        person, LIGHTS, background=BEHIND, passes=["shading", "albedo", "gloss"], gloss=0.5, amount=0.3
    )
    total = groups["C_photograph"][..., :3] + groups["C_key"][..., :3] + groups["C_rim"][..., :3]
    np.testing.assert_array_equal(total + groups["C_background"], picture)
    diffuse = groups["albedo"] * groups["shading_key"] + 0.5 * groups["gloss_key"]
    np.testing.assert_allclose(groups["C_key"][..., :3], diffuse * person.matte[..., None], atol=2e-3)


def test_apply_takes_an_amount_and_its_shadow_on_the_floor_is_as_strong(person):
    floor = relight.Floor(height=1.5, horizon=0.3)
    none, half, whole = (
        relight.rendering.relit_over(person, LIGHTS, BEHIND, floor, 0, amount) for amount in (0, 0.5, 1)
    )
    np.testing.assert_allclose(half, (none + whole) / 2, atol=1e-6)
    outside = person.matte == 0
    np.testing.assert_allclose(none[outside], BEHIND[outside], atol=1e-6)
    image, normals = photograph()
    again = relight.apply(image, LIGHTS, normals=normals, background=BEHIND, floor=floor, amount=0.5)
    np.testing.assert_allclose(again, half, atol=1e-6)


@pytest.mark.parametrize("name", [*presets.document()])
def test_a_preset_leaves_the_person_as_bright_as_the_photograph(person, name):
    image, _ = photograph()
    inside = person.matte == 1
    before, after = (luminance(p[inside][:, :3]).mean() for p in (image, person.relit(name)))
    assert after == pytest.approx(before, rel=0.08)


def test_rembrandt_keeps_the_ratio_of_its_lights(person):
    key, fill = person.preset("rembrandt")
    own_key, own_fill = relight.presets()["rembrandt"]
    np.testing.assert_allclose(key.power / fill.power, own_key.power / own_fill.power)
    gain = person.preset_gain("rembrandt")
    np.testing.assert_allclose(person.relit("rembrandt"), person.relit([key, fill]))
    unscaled = person.relit(relight.presets()["rembrandt"])[..., :3]
    np.testing.assert_allclose(person.relit("rembrandt")[..., :3], gain * unscaled, rtol=1e-4, atol=1e-6)


def test_a_shot_is_lit_by_a_preset_as_a_subject_is_and_saves_the_lights_it_had(tmp_path):
    image, normals = photograph()
    subject = relight.Subject(image, normals=normals)
    source = relight.Source(image, normals=normals)
    lighting = relight.Lighting("window", amount=0.5, intensity=1.5)
    saved = tmp_path / "lights.yaml"
    relight.render_shot(
        source, lighting, relight.Output(tmp_path / "a.exr", exr_type="float", save_lights=saved)
    )
    relight.render_shot(
        source, relight.Lighting(saved, amount=0.5), relight.Output(tmp_path / "b.exr", exr_type="float")
    )
    first, again = (relight.read(tmp_path / name) for name in ("a.exr", "b.exr"))
    lights = [
        relight.DirectionalLight(**(light.settings() | {"intensity": 1.5 * light.intensity}))
        for light in subject.preset("window")
    ]
    np.testing.assert_allclose(first, subject.relit(lights, amount=0.5), atol=1e-5)
    np.testing.assert_allclose(first, again, atol=1e-5)


def test_intensity_is_that_of_all_lights_moving_ones_too(tmp_path):
    image, normals = photograph()
    moving = relight.MovingLight(azimuth=-30, intensity={0: 1, 10: 3}, name="moving")
    still = relight.DirectionalLight(azimuth=60, name="still")
    pictures = []
    for intensity in (1, 2):
        path = tmp_path / f"{intensity}.exr"
        lighting = relight.Lighting([moving, still], intensity=intensity)
        relight.render_shot(
            relight.Source(image, normals=normals), lighting, relight.Output(path, exr_type="float"),
            frames="5",
        )  # fmt: skip
        pictures.append(relight.read(path)[..., :3])
    np.testing.assert_allclose(pictures[1], 2 * pictures[0], rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("amount", [-0.1, 1.1, float("nan"), float("inf")])
def test_amounts_outside_are_refused_by_name(person, amount):
    for refused in (
        lambda: person.relit(LIGHTS, amount=amount),
        lambda: person.layers(LIGHTS, amount=amount),
        lambda: relight.Lighting(LIGHTS, amount=amount),
        lambda: relight.apply(photograph()[0], LIGHTS, amount=amount),
        lambda: relight.render(photograph()[0], LIGHTS, amount=amount),
    ):
        with pytest.raises(ValueError, match="amount"):
            refused()


def test_other_bad_values_are_refused_by_name(person):
    with pytest.raises(TypeError, match="amount"):
        person.relit(LIGHTS, amount="half")
    for intensity in (-1, float("nan")):
        with pytest.raises(ValueError, match="intensity"):
            relight.Lighting(LIGHTS, intensity=intensity)
    with pytest.raises(ValueError, match="'photograph' names the photograph's layer"):
        person.layers([relight.DirectionalLight(name="photograph")], amount=0.5)
    with pytest.raises(ValueError, match="no preset is called 'remmbrant'"):
        person.relit("remmbrant")
