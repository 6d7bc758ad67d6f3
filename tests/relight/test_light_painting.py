import warnings

import numpy as np
import pytest
from helpers import ROOT, shipped
from helpers.damage import small_canvas
from typer.testing import CliRunner

import relight
from relight.analysis import light_grid
from relight.cli.commands import app
from relight.light_painting import LightPainter, read_strokes
from relight.media.colour import luminance

PERSON = ROOT / "examples" / "person.png"
KEY = relight.DirectionalLight(azimuth=0, elevation=10, intensity=0.8, name="key")
SCENES = (
    [relight.DirectionalLight(azimuth=-60, elevation=25, intensity=1.2, colour=(1, 0.8, 0.6))],
    [
        relight.DirectionalLight(azimuth=-70, elevation=30, colour=(0.8, 0.9, 1)),
        relight.DirectionalLight(azimuth=30, elevation=45, intensity=1.5, angle=20),
    ],
)


def side(size, left=True):
    """A mask of one third of a picture."""
    mask = np.zeros(size, np.float32)
    third = size[1] // 3
    mask[:, :third] = left
    mask[:, -third:] = not left
    return mask


def under(picture, mask):
    return float((luminance(picture[..., :3]) * mask).sum())


def apart(one, other):
    return np.degrees(np.arccos(np.clip(np.dot(one.direction, other.direction), -1, 1)))


def check_found(lights, true, degrees=10, share=0.1):
    """Each true light is among the found ones, and there are no others."""
    assert len(lights) == len(true)
    for light in true:
        nearest = min(lights, key=lambda each: apart(each, light))
        assert apart(nearest, light) < degrees
        np.testing.assert_allclose(nearest.power, light.power, rtol=share)


@pytest.mark.parametrize("true", SCENES)
def test_lights_of_a_rendered_picture_are_found_again(viewed, true):
    check_found(relight.paint_lights(viewed, viewed.relit(true), KEY), true)
    check_found(relight.fit_lights(viewed.relit(true), viewed, count=4), true)


@pytest.mark.usefixtures("full_canvas")
@pytest.mark.slow
@pytest.mark.parametrize("scene", shipped.scenes(), ids=lambda scene: scene.name)
def test_lights_painted_on_rendered_bodies_are_found_again(scene):
    subject = relight.Subject(scene.photograph.numpy(), scene.mask.float().numpy())
    for true in SCENES:
        check_found(relight.paint_lights(subject, subject.relit(true), KEY), true)


def test_strokes_brighten_and_darken_what_they_cover(viewed):
    before = viewed.relit(KEY)
    left, right = side(viewed.size), side(viewed.size, left=False)
    lights = relight.paint_lights(viewed, [(left, 1.5), (right, 0.75)], KEY, count=4)
    after = viewed.relit(lights)
    assert 1 <= len(lights) <= 4
    assert all(light.intensity > 0 and min(light.colour) >= 0 for light in lights)
    assert under(after, left) / under(before, left) == pytest.approx(1.5, rel=0.2)
    assert under(after, right) / under(before, right) == pytest.approx(0.75, rel=0.2)
    layers = viewed.layers(lights)
    np.testing.assert_allclose(sum(layer[..., :3] for layer in layers.values()), after[..., :3], atol=1e-5)


def test_strokes_may_be_drawn_on_smaller_masks(viewed, monkeypatch):
    monkeypatch.setattr(light_grid, "CELL_PIXELS", 4)
    whole, small = LightPainter(viewed, KEY), LightPainter(viewed, KEY, reduced=True)
    assert small.size[0] < 0.6 * whole.size[0]
    first, second = (
        painter.solve([(side(painter.size), 1.5), (side(painter.size, left=False), 0.75)]).strokes
        for painter in (whole, small)
    )
    np.testing.assert_allclose(second, first, rtol=0.02)
    with pytest.raises(ValueError, match="expected the subject's size"):
        whole.solve([(side(small.size), 2)])


def test_what_is_to_stay_as_it_is_keeps_the_lights(viewed):
    lamp = relight.PointLight((-1.2, 0.6, 1.5), intensity=2, name="lamp")
    lights = relight.paint_lights(viewed, [(side(viewed.size), 1)], [KEY, lamp])
    assert [light.name for light in lights] == ["key", "lamp"]
    assert lights[0].intensity == pytest.approx(KEY.intensity, rel=0.01)
    assert lights[1] == relight.PointLight(lamp.position, intensity=lights[1].intensity, name="lamp")
    assert lights[1].intensity == pytest.approx(lamp.intensity, rel=0.02)


def test_twice_everywhere_is_twice_the_light(viewed):
    (light,) = relight.paint_lights(viewed, [(np.ones(viewed.size), 2)], KEY)
    assert light.name == "key"
    assert light.direction == pytest.approx(KEY.direction, abs=1e-6)
    assert light.intensity == pytest.approx(2 * KEY.intensity, rel=0.01)


def test_a_stroke_that_asks_for_the_impossible_says_how_near_it_came(viewed):
    left, right = side(viewed.size), side(viewed.size, left=False)
    thin = np.zeros(viewed.size, np.float32)
    thin[viewed.size[0] // 2 :: 8] = 1
    with pytest.warns(
        UserWarning, match=r"stroke 1 asks for 300 times the light; the nearest that few lights"
    ):
        relight.paint_lights(viewed, [(thin, 300), (left, 0), (right, 0)], KEY)
    results = LightPainter(viewed, KEY).solve([(thin, 300), (left, 0), (right, 0)]).strokes
    assert results[0].asked == pytest.approx(300)
    assert results[0].stops_missed < -1


def test_the_light_of_the_photograph_is_what_is_painted_on_without_lights(viewed):
    lights = relight.paint_lights(viewed, [(side(viewed.size), 1.3)])
    photograph = viewed.relit([], amount=0)
    assert {light.name for light in lights} <= {f"paint{number}" for number in range(1, 5)}
    mask = side(viewed.size)
    assert under(viewed.relit(lights), mask) / under(photograph, mask) == pytest.approx(1.3, rel=0.15)


def test_gloss_counts(viewed):
    rim = relight.DirectionalLight(azimuth=165, elevation=20, intensity=4)
    picture = viewed.relit([KEY, rim], gloss=1)
    lights = relight.paint_lights(viewed, picture, KEY, gloss=1)
    error = viewed.relit(lights, gloss=1) - picture
    dull = viewed.relit(relight.paint_lights(viewed, picture, KEY)) - picture
    assert (error**2).mean() < 0.5 * (dull**2).mean()


@pytest.mark.parametrize(
    ("strokes", "message"),
    [
        ([], "strokes: expected at least one pair"),
        (3, "strokes: expected pairs"),
        ([(3,)], "stroke 1: expected a pair"),
        ([("left", 2)], "mask of stroke 1"),
        ([("empty", 2)], "stroke 1 is empty"),
        ([("outside", 2)], "stroke 1 is outside the person"),
        ([("left", -1)], "factor of stroke 1"),
        ([("left", float("nan"))], "factor of stroke 1"),
        ([("left", 2), ("left", 0.5)], "strokes 1 and 2 contradict each other"),
        ([("small", 2)], "expected the subject's size"),
    ],
)
def test_strokes_that_make_no_sense_are_refused_in_one_line(viewed, strokes, message):
    outside = np.float32(viewed.matte == 0)
    masks = {"left": side(viewed.size), "empty": 0 * outside, "outside": outside, "small": outside[:-1]}
    masks["outside"][:, viewed.size[1] // 8 :] = 0
    if message != "mask of stroke 1" and isinstance(strokes, list):
        strokes = [
            tuple(masks.get(each, each) if isinstance(each, str) else each for each in s) for s in strokes
        ]
    with pytest.raises((TypeError, ValueError), match=message) as refused:
        relight.paint_lights(viewed, strokes, KEY)
    assert "\n" not in str(refused.value)


def test_moving_lights_and_unchanged_pictures_are_refused(viewed):
    sun = relight.MovingLight(azimuth={1: -90, 100: 60}, name="sun")
    with pytest.raises(TypeError, match="sun moves"):
        relight.paint_lights(viewed, [(side(viewed.size), 2)], sun)
    follower = relight.PointLight((0, 0.5, 1), at="head")  # without its networks no head is seen
    with pytest.raises((ValueError, relight.errors.RelightError), match="head"):
        relight.paint_lights(viewed, [(side(viewed.size), 2)], follower)
    with pytest.raises(ValueError, match="differs nowhere"):
        relight.paint_lights(viewed, viewed.relit(KEY), KEY)
    with pytest.raises(ValueError, match="count: expected a whole number from 1 to 32"):
        relight.paint_lights(viewed, [(side(viewed.size), 2)], KEY, count=0)


@pytest.fixture
def strokes(here):
    """A picture of red and blue strokes, and a grey one."""
    person = np.ascontiguousarray(relight.read(PERSON)[::4, ::4])
    relight.write("person.png", person)
    picture = np.zeros((*person.shape[:2], 4), np.uint8)
    third = person.shape[1] // 3
    picture[:, :third] = (255, 0, 0, 255)
    picture[:, -third:] = (0, 0, 255, 255)
    relight.write("strokes.png", picture)
    grey = np.full((*person.shape[:2], 3), 128, np.uint8)
    grey[:, :third] = 192
    relight.write("grey.png", grey)
    return here


def test_a_picture_of_strokes_is_read_by_its_colours(strokes):
    up, down = read_strokes("strokes.png")
    assert up[0][0, 0] == down[0][0, -1] == 1
    assert up[1][0, 0] == pytest.approx(2, rel=0.01)
    assert down[1][0, -1] == pytest.approx(0.5, rel=0.01)
    ((mask, factor),) = read_strokes("grey.png")
    assert mask[0, 0] == 1
    assert mask[0, -1] == 0
    assert factor[0, 0] == pytest.approx(1.5, rel=0.01)
    relight.write("none.png", np.zeros((8, 8, 4), np.uint8))
    with pytest.raises(ValueError, match=r"none.png: holds no strokes; expected red"):
        read_strokes("none.png")


def test_the_command_paints(strokes):
    words = "apply person.png --light key:azimuth=0,elevation=10,intensity=0.8 --paint strokes.png -o out.exr"
    with small_canvas(256), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        run = CliRunner().invoke(app, [*words.split(), "--save-lights", "painted.yaml"])
        assert run.exit_code == 0, run.output
        lights = relight.read_lights("painted.yaml")
        layers = relight.read_layers("out.exr")
    assert 1 <= len(lights) <= 4
    assert {f"C_{light.name}" for light in lights} <= set(layers)
    plain = relight.Lighting(light=("key:azimuth=0",), paint="strokes.png", match_plate=False)
    assert plain.paint == "strokes.png"
    with pytest.raises(ValueError, match="paint: expected neither fill nor match_plate"):
        relight.Lighting(paint="strokes.png", match_plate=True)
