import math

import numpy as np
import pytest
import torch
from helpers.standins import ball, image_of
from scipy.ndimage import distance_transform_edt
from typer.testing import CliRunner

import relight
from relight.analysis.gloss import BEND, DEPTH, FORWARD, MIN_COSINE, reflectance
from relight.cli.commands import app

SKY = np.zeros((16, 32, 3), np.float32)
SKY[3:6, [2, 9, 29]] = (2, 3, 5), (9, 1, 1), (1, 1, 4)
LIGHTS = [
    relight.DirectionalLight(azimuth=150, elevation=20, intensity=3, colour=(1, 0.7, 0.4), name="rim"),
    relight.DirectionalLight(azimuth=-120, elevation=30, angle=20, name="soft"),
    relight.PointLight((1.8, 0.6, -0.8), intensity=4, radius=0.1, name="lamp"),
    relight.EnvironmentLight(SKY, name="sky"),
]
INNER_AND_OUTER = np.s_[45:60], np.s_[100:110]  # columns of the limb's outlines
BLACK = np.zeros((200, 160, 3), np.float32)


@pytest.fixture(scope="module")
def black():
    """A black ball, whose picture is the reflection alone."""
    coverage, normals = ball(200, 160)
    return relight.Subject(image_of(coverage), normals=normals, albedo=BLACK)


@pytest.fixture(scope="module")
def person():
    coverage, normals = ball(200, 160)
    return relight.Subject(image_of(coverage), normals=normals)


def expected(normal, light):
    """What the layer scatters from a surface, from the definition, vector by vector."""
    view = np.array([0.0, 0, 1])
    bent = normal - BEND * view
    lit, seen = bent @ light, max(bent @ view, MIN_COSINE)
    if lit <= 0:
        return 0
    phase = (1 - FORWARD**2) / (1 + FORWARD**2 - 2 * FORWARD * (-light @ view)) ** 1.5
    depths, times = np.linspace(0, 40, 40001)[1:], 1 / lit + 1 / seen
    scattered = np.trapezoid(np.exp(-depths) * (1 - np.exp(-DEPTH * depths * times)), depths)
    single = phase / (4 * math.pi) * scattered / (lit + seen)
    return math.pi * single * lit * (1 - seen) ** 5


def test_it_is_the_scattering_of_its_source():
    random = np.random.default_rng(0)
    values = []
    for _ in range(50):
        normal, light = (vector / np.linalg.norm(vector) for vector in random.normal(size=(2, 3)))
        normal[2] = abs(normal[2])
        cosines = [torch.tensor([value]) for value in (normal @ light, normal[2], light[2])]
        values.append(float(reflectance(*cosines)))
        assert values[-1] == pytest.approx(expected(normal, light), rel=2e-3, abs=1e-5)
    assert np.count_nonzero(values) > 15


def test_edges_and_lights_straight_behind_stay_finite():
    cosine = torch.linspace(-1, 1, 101, dtype=torch.float32)
    facing, seen, frontal = torch.meshgrid(cosine, cosine, cosine, indexing="ij")
    values = reflectance(facing, seen, frontal)
    assert torch.isfinite(values).all()
    assert values.min() == 0
    assert 0.6 < values.max() <= 0.7
    assert (values[facing <= BEND * frontal] == 0).all()


def test_light_from_behind_gives_a_rim_and_light_from_the_front_hardly_any(black):
    from_front = black.relit(relight.DirectionalLight(elevation=10), gloss=1)[..., :3]
    from_behind = black.relit(relight.DirectionalLight(azimuth=150), gloss=1)[..., :3]
    assert from_front.max() < 0.025
    assert from_behind.max() > 0.2
    seen = black.normals[..., 2][black.matte == 1]
    bright = from_behind[black.matte == 1][:, 0] > 0.05
    assert seen[bright].max() < 0.6
    assert from_behind[:, 80:].mean() > 10 * from_behind[:, :80].mean()  # on the light's side


def test_a_rim_is_narrow_however_large_the_picture_shows_a_head(black):
    """A quarter of the radius inside a ball, its normal still turns far enough for a rim."""
    reflection = black.reflection(relight.DirectionalLight(azimuth=150, elevation=10))[..., 0]
    inside = distance_transform_edt(black.matte > 0.5)
    assert reflection[(inside > 1) & (inside < 3)].max() > 0.1
    assert reflection[inside > 12].max() < 0.004


def test_the_frame_that_cuts_a_person_is_no_outline():
    coverage, normals = ball(200, 160, centre=(0.5, 0.3))
    cut = relight.Subject(image_of(coverage), normals=normals)
    reflection = cut.reflection(relight.DirectionalLight(azimuth=180, elevation=20))[..., 0]
    assert reflection[:3, 70:90].max() < 0.005
    assert reflection[cut.matte > 0.5].max() > 0.1


def test_light_straight_behind_outlines_the_whole_person(black):
    picture = black.relit(relight.DirectionalLight(azimuth=180), gloss=1)[..., 0]
    rows, columns = np.nonzero(picture > 0.02)
    angles = np.arctan2(rows - 99.5, columns - 79.5)
    assert set(np.floor(angles / (math.pi / 6))) == set(range(-6, 6))  # no hour of the dial lacks it
    assert picture[80:120, 60:100].max() == 0


@pytest.fixture(scope="module")
def limb():
    """A round black limb, upright, whose left half hides a flat body that goes on to the picture's edge."""
    coverage, across = np.zeros((200, 160), np.float32), np.zeros((200, 160), np.float32)
    coverage[20:180, 20:110] = 1
    across[:, 50:110] = np.linspace(-0.95, 0.95, 60)
    normals = np.stack([across, np.zeros_like(across), np.sqrt(1 - across**2)], axis=-1)
    return relight.Subject(image_of(coverage), normals=normals, albedo=BLACK)


@pytest.mark.parametrize(("azimuth", "elevation"), [(180, 0), (160, 25), (135, 10), (110, 0)])
def test_light_from_behind_gives_no_rim_before_the_body(limb, azimuth, elevation):
    sides = [relight.DirectionalLight(azimuth=sign * azimuth, elevation=elevation) for sign in (-1, 1)]
    left, right = (limb.relit(side, gloss=1)[40:160, :, 0] for side in sides)
    before_the_body = left[:, INNER_AND_OUTER[0]].max(axis=1).mean()
    before_the_background = right[:, INNER_AND_OUTER[1]].max(axis=1).mean()
    assert before_the_background > 0.005
    assert before_the_body < 0.1 * before_the_background


def test_an_edge_before_the_body_keeps_its_diffuse_light(limb):
    field = limb.record.maps.field
    assert field.rim.min() < 0.1
    open_everywhere = field._replace(rim=torch.ones_like(field.rim))
    directions = torch.tensor([[-0.7, 0.3, -0.64], [0.0, 0.3, -0.95]])
    assert torch.equal(field.shading(directions), open_everywhere.shading(directions))


def test_the_top_of_a_shoe_shines_less_than_the_outline():
    """Of a light behind and above, whose mirror image the top of a shoe or a knee would show."""
    light = np.array(relight.DirectionalLight(azimuth=160, elevation=35).direction)
    mirror = (light + (0, 0, 1)) / np.linalg.norm(light + (0, 0, 1))
    outline = np.array([*light[:2], 0]) / np.linalg.norm(light[:2])
    top, edge = (
        float(reflectance(*(torch.tensor([value]) for value in (normal @ light, normal[2], light[2]))))
        for normal in (mirror, outline)
    )
    assert edge > 0.2
    assert top < edge


@pytest.mark.parametrize("light", LIGHTS, ids=lambda light: light.name)
def test_it_is_linear_for_every_kind_of_light(person, light):
    plain, half, full = (person.relit(light, gloss=gloss) for gloss in (0, 0.5, 1))
    np.testing.assert_allclose(half - plain, (full - plain) / 2, atol=1e-5)
    np.testing.assert_array_equal(full[..., 3], plain[..., 3])
    reflection = person.reflection(light)
    assert reflection.max() > 0.01
    rebuilt = plain[..., :3] + reflection * plain[..., 3:]
    np.testing.assert_allclose(full[..., :3], rebuilt, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(person.reflection([light, light]), 2 * reflection, rtol=1e-5, atol=1e-6)


def test_layers_sum_to_the_glossy_picture(person):
    layers, picture = person.layers(LIGHTS, gloss=0.7), person.relit(LIGHTS, gloss=0.7)
    total = sum(layer[..., :3] for layer in layers.values())
    np.testing.assert_allclose(total, picture[..., :3], rtol=1e-5, atol=1e-6)
    assert np.abs(picture - person.relit(LIGHTS)).max() > 0.1


def test_a_distant_lamp_reflects_as_a_directional_light_does(black):
    direction = np.array(LIGHTS[0].direction)
    lamp = relight.PointLight(tuple(1e4 * direction), intensity=1e8)
    far = black.relit(lamp, gloss=1)
    parallel = black.relit(relight.DirectionalLight(tuple(direction)), gloss=1)
    np.testing.assert_allclose(far, parallel, atol=2e-3)


def test_without_gloss_nothing_changes(person):
    for light in LIGHTS:
        np.testing.assert_array_equal(person.relit(light), person.relit(light, gloss=0))
    diffuse = person.albedo * person.lighting(LIGHTS[0]) * person.matte[..., None]
    np.testing.assert_allclose(person.relit(LIGHTS[0])[..., :3], diffuse, rtol=1e-5, atol=1e-7)


def test_a_filtered_person_has_it_too(person):
    filtered = person.temporally_filtered([person])
    np.testing.assert_allclose(
        filtered.relit(LIGHTS, gloss=1), person.relit(LIGHTS, gloss=1), rtol=1e-3, atol=1e-3
    )


@pytest.mark.parametrize("gloss", [-0.1, 1.5, math.nan, math.inf])
def test_other_strengths_are_refused(person, gloss):
    photo = np.full((40, 30, 3), 0.4, np.float32)
    for ask in (
        lambda: person.relit(LIGHTS, gloss),
        lambda: person.layers(LIGHTS, gloss),
        lambda: relight.apply(photo, LIGHTS, mask=photo[..., 0], gloss=gloss),
        lambda: relight.render(photo, LIGHTS, mask=photo[..., 0], gloss=gloss),
        lambda: relight.Lighting(LIGHTS[:1], gloss=gloss),
    ):
        with pytest.raises(ValueError, match="gloss: expected"):
            ask()
    with pytest.raises(TypeError, match="gloss: expected a number"):
        person.relit(LIGHTS, "much")


def test_a_shot_has_the_gloss_of_its_lighting(tmp_path, here):
    relight.write("plate.exr", image_of(ball(200, 160)[0]))
    words = ["plate.exr", "--light", "rim:azimuth=150,intensity=3", "--gloss", "0.8", "-o", "lit.exr"]
    run = CliRunner().invoke(app, ["apply", *words])
    assert run.exit_code == 0, run.output
    rim = relight.DirectionalLight(azimuth=150, intensity=3)
    subject = relight.Subject(relight.read("plate.exr"))
    np.testing.assert_allclose(relight.read("lit.exr"), subject.relit(rim, gloss=0.8), rtol=2e-3, atol=1e-3)
    assert np.abs(subject.relit(rim, gloss=0.8) - subject.relit(rim)).max() > 0.1
