import dataclasses
import pickle

import numpy as np
import OpenImageIO as oiio
import pytest

import relight
from relight.errors import EmptyMatteError
from relight.rendering import metadata_of, render, render_layers, render_subject

HEIGHT, WIDTH = 120, 90
LIGHTS = [
    relight.DirectionalLight(azimuth=-50, elevation=30, intensity=3, colour=(1, 0.8, 0.6), name="key"),
    relight.DirectionalLight(azimuth=70, intensity=0.013, angle=40, name="fill"),
    relight.DirectionalLight(azimuth=160, elevation=30, intensity=70, name="rim"),
]


@pytest.fixture(scope="module")
def subject():
    """A ball with a soft edge in front of nothing."""
    y, x = (np.mgrid[:HEIGHT, :WIDTH] + 0.5 - [[[HEIGHT / 2]], [[WIDTH / 2]]]) / 36
    radius = np.hypot(x, y)
    alpha = np.clip((1 - radius) * 12 + 0.5, 0, 1)[..., None]
    normals = np.stack([x, -y, np.sqrt(np.clip(1 - radius**2, 0, None))], axis=-1) * (radius < 1)[..., None]
    image = np.concatenate([alpha * (0.5, 0.4, 0.3), alpha], axis=-1).astype(np.float32)
    return relight.Subject(image, normals=normals.astype(np.float32))


def half_steps(total, beauty):
    """How many half-float steps lie between float32 sums and half values."""
    step = np.spacing(np.abs(beauty).astype(np.float16)).astype(np.float32)
    return np.abs(total - beauty) / step


@pytest.mark.parametrize(("background", "gloss"), [(None, 1), ((0.18, 0.2, 0.3), 0)])
def test_light_groups_in_a_file_sum_to_its_beauty(subject, tmp_path, background, gloss):
    picture, layers = render_subject(subject, LIGHTS, background=background, gloss=gloss)
    relight.write(tmp_path / "a.exr", picture, layers=layers)
    beauty, back = relight.read(tmp_path / "a.exr"), relight.read_layers(tmp_path / "a.exr")
    assert set(back) == {"C_key", "C_fill", "C_rim"} | ({"C_background"} if background else set())
    total = sum(layer[..., :3] for layer in back.values())
    assert half_steps(total, beauty[..., :3]).max() <= 0.5
    assert beauty[..., :3].max() > 1
    if background is None:
        for layer in back.values():
            np.testing.assert_array_equal(layer[..., 3], beauty[..., 3])


def test_what_half_cannot_hold_is_not_rounded(subject):
    sun = relight.DirectionalLight(intensity=1e7, name="sun")
    picture, layers = render_subject(subject, sun)
    assert np.isfinite(picture).all()
    np.testing.assert_array_equal(layers["C_sun"][..., :3], subject.relit(sun)[..., :3])


def test_passes_rebuild_the_light_groups(subject, tmp_path):
    names = ("albedo", "N", "P", "visibility", "shading", "gloss")
    picture, layers = render_subject(subject, LIGHTS, passes=names, gloss=0.5)
    relight.write(tmp_path / "a.exr", picture, layers=layers)
    back, alpha = relight.read_layers(tmp_path / "a.exr"), relight.read(tmp_path / "a.exr")[..., 3:]
    lights = ["key", "fill", "rim"]
    assert set(back) == {"albedo", "N", "P"} | {
        f"{kind}_{name}" for name in lights for kind in ("C", "visibility", "shading", "gloss")
    }
    for name in lights:
        rebuilt = (back["albedo"] * back[f"shading_{name}"] + 0.5 * back[f"gloss_{name}"]) * alpha
        np.testing.assert_allclose(rebuilt, back[f"C_{name}"][..., :3], rtol=5e-3, atol=1e-6)
    channels = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec().channelnames
    assert {"N.X", "N.Y", "N.Z", "visibility_key.Y", "shading_rim.B", "gloss_rim.G"} <= set(channels)
    np.testing.assert_allclose(back["N"], subject.normals, atol=1e-3)
    np.testing.assert_allclose(back["P"], subject.position, atol=1e-3)


def test_the_visibility_of_a_hard_light_is_that_of_its_direction(subject):
    key, fill = LIGHTS[:2]
    expected = subject.visibility([key.direction])[0]
    np.testing.assert_allclose(subject.unshadowed(key), expected, atol=1e-5)
    soft = subject.unshadowed(fill)
    assert soft.shape == (HEIGHT, WIDTH)
    assert soft.min() >= 0
    assert soft.max() <= 1 + 1e-5
    np.testing.assert_allclose(soft, subject.visibility(fill.samples()[0]).mean(axis=0), atol=1e-5)
    for intensity in (0, 1e-12):  # a fade from darkness begins with the same visibility
        dim = dataclasses.replace(key, intensity=intensity)
        np.testing.assert_allclose(subject.unshadowed(dim), expected, atol=1e-5)
    sky = np.full((16, 32, 3), 0.2, np.float32)
    sky[4, 20] = 300
    lit, out = (relight.EnvironmentLight(sky, intensity=intensity) for intensity in (1, 0))
    np.testing.assert_allclose(subject.unshadowed(out), subject.unshadowed(lit), atol=1e-5)


def test_lighting_times_albedo_is_the_picture(subject):
    picture = subject.relit(LIGHTS)
    rebuilt = subject.albedo * subject.lighting(LIGHTS) * picture[..., 3:]
    np.testing.assert_allclose(rebuilt, picture[..., :3], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"lights": []}, "lights: expected at least one"),
        (
            {"passes": ["depth"]},
            "passes: expected any of albedo, N, Z, P, visibility, shading, gloss, confidence, got 'depth'",
        ),
        ({"lights": LIGHTS[:1] * 2}, "lights: expected different names, got key, key"),
    ],
)
def test_unknown_passes_and_missing_or_repeated_lights_are_refused(subject, arguments, message):
    with pytest.raises(ValueError, match=message):
        render_subject(subject, **({"lights": LIGHTS} | arguments))


def test_render_takes_an_image():
    image = np.full((40, 30, 3), 0.4, np.float32)
    mask = np.zeros((40, 30), np.float32)
    mask[5:35, 5:25] = 1
    picture, layers = render(image, LIGHTS, mask=mask, passes=("albedo",))
    assert picture.shape == (40, 30, 4)
    assert set(layers) == {"C_key", "C_fill", "C_rim", "albedo"}


def test_a_light_so_dim_that_half_floats_lose_it_is_warned_of(subject):
    dim = relight.DirectionalLight(intensity=1e-6, name="dim")
    with pytest.warns(UserWarning, match=r"C_dim: is so dim that half floats lose \d+ % of its light"):
        render_subject(subject, [dim, *LIGHTS])


def test_a_picture_is_the_same_without_its_layers(subject):
    whole, alone = (render_layers(subject, LIGHTS, layered=layered) for layered in (True, False))
    assert alone.layers == {}
    np.testing.assert_array_equal(alone.cut_out, whole.cut_out)


def test_a_frame_without_a_person_has_every_pass():
    nobody = relight.Subject.nobody((4, 6))
    assert metadata_of(nobody, ["Z", "P"]) == {}
    layers = render_subject(nobody, LIGHTS, passes=["Z", "P", "visibility", "gloss"], gloss=1)[1]
    assert {"Z", "P", "visibility_key", "gloss_key"} <= set(layers)
    assert all((layer == 0).all() for layer in layers.values())


def test_nobody_is_kept_pickled_and_shown_nowhere(tmp_path):
    nobody, lamp = relight.Subject.nobody((4, 6)), relight.PointLight((0, 0.5, 1), name="lamp")
    nobody.save(tmp_path / "kept.safetensors")
    with pytest.raises(EmptyMatteError, match=r"kept\.safetensors: the frame shows no person"):
        relight.Subject.load(tmp_path / "kept.safetensors")
    kept = relight.Subject.load(tmp_path / "kept.safetensors", may_be_empty=True)
    for subject in (nobody, kept, pickle.loads(pickle.dumps(nobody)), nobody.temporally_filtered([nobody])):
        assert subject.is_empty
        assert subject.size == (4, 6)
        assert not subject.relit([lamp, *LIGHTS], gloss=1, amount=0.5).any()
        per_light, shadow = subject.shadows([lamp, *LIGHTS], relight.Floor(height=1.5, horizon=0.4))
        assert {"lamp", "key"} < set(per_light)
        assert (shadow == 1).all()
    for picture in (nobody.albedo, nobody.normals, nobody.depth, nobody.position, nobody.matte):
        assert not picture.any()
    assert nobody.preset_gain("rim") == 1
    for show, given in (
        (nobody.view, tmp_path / "person.html"),
        (nobody.export, tmp_path / "person.nk"),
        (nobody.fit_lighting, np.zeros((4, 6, 4))),
    ):
        with pytest.raises(EmptyMatteError, match="shows no person"):
            show(given)


def test_a_background_is_a_text_as_the_command_takes_it(tmp_path):
    """A colour, a file, or the environments among the lights; anything else is refused before analysis."""
    rng = np.random.default_rng(0)
    photo = np.zeros((48, 40, 4), np.float32)
    photo[8:44, 10:30] = 0.3, 0.3, 0.3, 1
    sky = relight.EnvironmentLight(rng.random((16, 32, 3)).astype(np.float32), name="sky")
    street = rng.random((24, 20, 3)).astype(np.float32)
    relight.write(tmp_path / "street.exr", street, depth="float")
    means = {"0.03/0.03/0.04": (0.03, 0.03, 0.04), str(tmp_path / "street.exr"): street, "environment": sky}
    for text, meant in means.items():
        for function in (relight.apply, lambda *given, **options: render(*given, **options)[0]):
            np.testing.assert_array_equal(
                function(photo, [sky], background=text), function(photo, [sky], background=meant)
            )
    key = relight.DirectionalLight(azimuth=-40)
    for text, says in (("#30303", "linear red"), ("environment", "environment among the lights")):
        with pytest.raises(ValueError, match=says):
            relight.apply(photo, key, background=text)
    with pytest.raises(FileNotFoundError):
        relight.apply(photo, key, background="nowhere.jpg")
