import itertools

import numpy as np
import pytest
import torch
from hypothesis import event, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import relight
from relight.compositing.composite import over
from relight.compositing.placement import cover, place
from relight.errors import MissingNetworksError
from relight.rendering import render, render_subject
from shading import diffuse
from shading.diffuse import ShadingField
from shadow import visibility
from shadow.networks.field import VisibilityField

LIGHTS = [
    relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2, colour=(1, 0.9, 0.8), name="key"),
    relight.DirectionalLight(azimuth=70, intensity=0.5),
]


def person(height=160, width=120):
    """A flat figure with a soft edge: (H, W, 4) linear, premultiplied."""
    y, x = np.mgrid[:height, :width] / (height, width)[0]
    distance = np.hypot((x - width / height / 2) * 2.2, y - 0.5)
    alpha = np.clip((0.4 - distance) * 40, 0, 1)[..., None]
    return np.concatenate([alpha * (0.5, 0.4, 0.3), alpha], axis=-1).astype(np.float32)


def test_over_along_a_soft_edge_is_exact():
    alpha = np.linspace(0, 1, 256, dtype=np.float32)[None, :, None].repeat(4, 0)
    front, back = np.array([0.8, 0.1, 4.0], np.float32), np.array([0.05, 0.9, 0.2], np.float32)
    result = over(np.concatenate([front * alpha, alpha], axis=-1), back)
    np.testing.assert_allclose(result, alpha * front + (1 - alpha) * back, atol=1e-6)
    assert result.dtype == np.float32


def test_over_takes_integers_as_srgb():
    front = np.zeros((4, 4, 4), np.uint8)
    back = np.full((4, 4, 3), 128, np.uint8)
    np.testing.assert_allclose(over(front, back), 0.2158605, atol=1e-5)


def test_a_background_is_covered_and_centred():
    wide = np.zeros((50, 400, 3), np.float32)
    wide[:, 175:225] = 1  # the middle square
    np.testing.assert_allclose(cover(wide, (80, 80)), 1, atol=1e-5)
    tall = np.zeros((400, 50, 3), np.float32)
    tall[175:225] = 1
    np.testing.assert_allclose(cover(tall, (20, 20)), 1, atol=1e-5)
    assert cover(wide, (33, 77)).shape == (33, 77, 3)


def test_a_lamp_in_the_background_gets_no_dark_ring():
    lamp = np.full((64, 64, 3), 0.1, np.float32)
    lamp[32, 32] = 1000
    assert cover(lamp, (200, 200)).min() > 0.0999
    assert cover(lamp, (30, 30)).min() > 0.0999


@pytest.mark.parametrize(
    ("foreground", "background", "message"),
    [
        (np.zeros((4, 4, 3)), (0, 0, 0), r"foreground: expected shape \(H, W, 4\)"),
        (np.zeros((4, 4, 4)), (0, 0), "background: expected an image or three finite numbers"),
        (np.zeros((4, 4, 4)), (0, np.nan, 0), "background: expected an image or three finite"),
        (np.zeros((4, 4, 4)), np.zeros((4, 4)), r"background: expected shape \(H, W, 3\)"),
        (np.zeros((4, 4, 4)), np.full((4, 4, 3), np.inf), "background: contains NaN or infinite"),
    ],
)
def test_over_names_what_is_wrong(foreground, background, message):
    with pytest.raises(ValueError, match=message):
        over(foreground, background)


def test_place_at_its_own_size_keeps_pixels():
    image = person(40, 30)
    np.testing.assert_array_equal(place(image, (40, 30)), image)
    framed = place(image, (60, 80), mode="centre", offset=(5, 2))
    np.testing.assert_array_equal(framed[8:48, 30:60], image)  # right is +columns, up is -rows
    framed[8:48, 30:60] = 0
    assert framed.max() == 0
    mask = image[..., 3]
    np.testing.assert_array_equal(place(mask, (60, 80), mode="centre")[10:50, 25:55], mask)


def test_place_takes_views_masks_and_what_it_may_not_change():
    image = person(40, 30)
    np.testing.assert_array_equal(place(image[:, ::-1], (40, 30)), image[:, ::-1])
    np.testing.assert_array_equal(relight.Subject(image[:, ::-1]).matte, image[:, ::-1, 3])
    image.flags.writeable = False
    np.testing.assert_array_equal(place(image, (40, 30)), image)
    mask = image[..., 3] > 0.5
    np.testing.assert_array_equal(place(mask, (40, 30)), mask)


def test_place_fits_fills_and_scales():
    white = np.ones((40, 20, 4), np.float32)
    fitted = place(white, (80, 200))
    assert (fitted[..., 3].sum(), fitted[:, 80:120, 3].min()) == pytest.approx((80 * 40, 1))
    assert place(white, (80, 200), mode="fill").min() == pytest.approx(1)
    half = place(white, (80, 200), scale=0.5)
    assert half[20:60, 90:110].min() == pytest.approx(1, abs=1e-5)
    assert half[..., 3].sum() == pytest.approx(40 * 20, rel=1e-4)
    twice = place(white, (40, 20), mode="centre", scale=2)
    assert twice.shape == (40, 20, 4)
    assert place(white, (40, 20), offset=(500, -500)).max() == 0


def test_place_keeps_edges_premultiplied():
    image = person(160, 120)
    small = place(image, (64, 64), scale=0.9)
    soft = (small[..., 3] > 0.02) & (small[..., 3] < 0.98)
    np.testing.assert_allclose(
        small[soft][:, :3], small[soft][:, 3:] * np.float32((0.5, 0.4, 0.3)), atol=1e-3
    )


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"mode": "stretch"}, ValueError, "mode: expected fit, fill or centre, got 'stretch'"),
        ({"scale": 0}, ValueError, "scale: expected a number above 0, got 0"),
        ({"scale": np.nan}, ValueError, "scale: expected a finite number above 0"),
        ({"scale": 1e6}, ValueError, r"scale: makes the image \d+ x \d+ pixels"),
        ({"offset": (0.5, 0)}, TypeError, "offset: expected two whole numbers"),
        ({"offset": 3}, TypeError, "offset: expected two whole numbers"),
        ({"size": (0, 5)}, ValueError, "size: expected 1 to 65536 pixels"),
        ({"image": np.zeros((4, 4, 2))}, ValueError, "image: expected shape"),
        ({"image": np.full((4, 4), 2.0)}, ValueError, r"image: expected values in \[0, 1\]"),
    ],
)
def test_place_names_what_is_wrong(arguments, error, message):
    with pytest.raises(error, match=message):
        place(**{"image": person(40, 30), "size": (20, 20)} | arguments)


def test_the_environment_itself_is_a_background():
    sky = relight.EnvironmentLight(np.full((8, 16, 3), 0.25, np.float32), intensity=2)
    np.testing.assert_allclose(over(np.zeros((6, 4, 4), np.float32), sky), 0.5, rtol=1e-5)


def test_an_environment_is_seen_by_the_persons_camera():
    sky = np.zeros((64, 128, 3), np.float32)
    sky[:, ::4] = 1
    light, image = relight.EnvironmentLight(sky), person(40, 30)
    outside = image[..., 3] == 0
    for angle in (20, 60):
        for picture in (
            relight.apply(image, light, background=light, field_of_view=angle),
            render(image, light, background=light, field_of_view=angle)[0],
        ):
            expected = light.view((40, 30), angle)
            np.testing.assert_allclose(picture[outside], expected[outside], rtol=2e-3)


def test_lights_may_be_a_generator():
    image, floor = person(40, 30), relight.Floor(height=1.5, horizon=0.45)
    options = {"background": (0.5, 0.5, 0.5), "floor": floor}
    expected = relight.apply(image, LIGHTS, **options)
    np.testing.assert_array_equal(relight.apply(image, iter(LIGHTS), **options), expected)
    layers = render_subject(relight.Subject(image), iter(LIGHTS), passes=["visibility"], **options)[1]
    assert {"visibility_key", "shadow_floor_key"} <= set(layers)


def test_apply_keeps_alpha_or_fills_the_frame():
    image = person()
    picture = relight.apply(image, LIGHTS)
    assert picture.shape == (160, 120, 4)
    np.testing.assert_allclose(picture[..., 3], image[..., 3], atol=1e-6)
    filled = relight.apply(image, LIGHTS, background=np.full((30, 90, 3), 0.25, np.float32))
    assert filled.shape == (160, 120, 3)
    outside = image[..., 3] == 0
    np.testing.assert_allclose(filled[outside], 0.25, atol=1e-5)
    expected = picture[..., :3] + (1 - picture[..., 3:]) * 0.25
    np.testing.assert_allclose(filled, expected, atol=1e-5)


@pytest.mark.slow
def test_render_layers_sum_to_the_picture():
    image = person()
    picture, layers = render(image, LIGHTS)
    assert list(layers) == ["C_key", "C_light2"]
    np.testing.assert_allclose(picture, relight.apply(image, LIGHTS), rtol=2e-3, atol=1e-6)
    np.testing.assert_allclose(sum(layer[..., :3] for layer in layers.values()), picture[..., :3], atol=1e-6)
    for layer in layers.values():
        np.testing.assert_allclose(layer[..., 3], picture[..., 3], rtol=1e-3)
    filled, layers = render(image, LIGHTS, background=(0.2, 0.3, 0.4))
    np.testing.assert_allclose(filled, over(picture, (0.2, 0.3, 0.4)), rtol=1e-3)
    np.testing.assert_allclose(sum(layer[..., :3] for layer in layers.values()), filled, atol=1e-6)


def test_render_names_what_is_wrong():
    with pytest.raises(ValueError, match="lights: expected at least one"):
        render(person(), [])
    light = relight.DirectionalLight(name="background")
    with pytest.raises(ValueError, match="'background' names the background's layer"):
        render(person(), [light], background=(0, 0, 0))


@pytest.fixture(scope="module")
def small_networks():
    """Networks with random weights, quick to run: for what must hold whatever they say."""
    torch.manual_seed(0)
    widths = {"size": 128, "widths": (8, 8, 8, 8, 8)}
    networks = VisibilityField(**widths), ShadingField(**widths)
    for parameter in itertools.chain(*(network.parameters() for network in networks)):
        torch.nn.init.normal_(parameter, std=0.1)
    with pytest.MonkeyPatch.context() as patch:
        for module, network in zip((visibility, diffuse), networks, strict=True):
            patch.setattr(module, "load", lambda *_, network=network, **__: network)
        yield


@pytest.mark.usefixtures("small_networks")
@settings(max_examples=10, deadline=None)
@given(
    height=st.integers(24, 100),
    width=st.integers(24, 100),
    dtype=st.sampled_from([np.uint8, np.uint16, np.float16, np.float32, np.float64]),
    alpha=st.booleans(),
    background=st.sampled_from([None, (0.1, 0.2, 0.3), np.ones((7, 5, 3), np.uint8)]),
)
def test_apply_takes_every_shape_and_dtype(height, width, dtype, alpha, background):
    image = person(height, width)
    mask = None if alpha else image[..., 3]
    image = image if alpha else image[..., :3] + 0.1
    if np.issubdtype(dtype, np.integer):
        image = image * np.iinfo(dtype).max
    result = relight.apply(image.astype(dtype), LIGHTS, mask=mask, background=background)
    assert result.shape == (height, width, 4 if background is None else 3)
    assert result.dtype == np.float32
    assert np.isfinite(result).all()
    assert result.min() >= 0


WRONG = [-1.0, -1e-5, 1e-30, 1.5, 60000, np.nan, np.inf]


def mostly(usual, *others):
    """Three times in four the usual, else one of the others."""
    return st.integers(0, 3).flatmap(lambda number: st.one_of(*others) if number == 3 else usual)


@st.composite
def nearly_images(draw, channels):
    """Somebody's picture or matte of any size and dtype, in which a few values may be wrong."""
    height, width = draw(st.integers(1, 30)), draw(st.integers(1, 30))
    image = person(height, width)[..., channels].astype(draw(st.sampled_from([np.float32, np.float64])))
    wrong = st.lists(st.tuples(st.floats(0, 1), st.sampled_from(WRONG)), min_size=1, max_size=3)
    for position, value in draw(mostly(st.just([]), wrong)):
        image.reshape(-1)[int(position * (image.size - 1))] = value
    dtype = draw(st.sampled_from([None, None, np.uint8, np.uint16, np.float16]))
    if dtype not in (np.uint8, np.uint16):
        return image if dtype is None else image.astype(dtype)
    return (np.nan_to_num(image).clip(0, 1) * np.iinfo(dtype).max).astype(dtype)


def anything():
    """Arrays that are no images, most of them."""
    shapes = st.lists(st.integers(0, 5), max_size=4).map(tuple)
    return hnp.arrays(hnp.scalar_dtypes(), shapes)


@pytest.mark.usefixtures("small_networks")
@settings(max_examples=15, deadline=None)
@given(
    image=mostly(nearly_images(slice(4)), nearly_images(slice(3)), anything()),
    mask=mostly(st.none(), nearly_images(3), anything()),
    background=mostly(
        st.sampled_from([None, (0.1, 0.2, 0.3), np.ones((2, 3, 3))]),
        st.sampled_from([(1, 2), "blue", np.full(3, np.nan)]),
        anything(),
    ),
    lights=mostly(
        st.sampled_from([LIGHTS, LIGHTS[0]]),
        st.just([]),
        st.sampled_from([None, [3], "key", relight.MovingLight(orbit=9)]),
    ),
)
def test_apply_gives_a_picture_or_names_what_is_wrong(image, mask, background, lights):
    try:
        result = relight.apply(image, lights, mask=mask, background=background)
    except (TypeError, ValueError, MissingNetworksError) as error:  # an opaque image needs the networks
        assert str(error).startswith(("image", "mask", "matte", "lights", "background"))  # noqa: PT017
        return
    except FileNotFoundError as error:
        assert str(error) == "blue: no such file"  # noqa: PT017
        return
    event("relit")
    assert result.shape == (*image.shape[:2], 4 if background is None else 3)
    assert result.dtype == np.float32
    assert np.isfinite(result).all()


def test_what_float32_cannot_hold_is_an_error():
    empty, bright = np.zeros((2, 2, 4), np.float32), np.full((2, 2, 4), (3e38, 3e38, 3e38, 0.5), np.float32)
    with pytest.raises(ValueError, match="background: expected an image or three finite numbers"):
        relight.over(empty, (3.41e38, 0, 0))
    with pytest.raises(ValueError, match="background: expected an image or three finite numbers"):
        relight.over(empty, (1j, 0, 0))
    with pytest.raises(ValueError, match="background: is so bright that the picture is beyond float32"):
        relight.over(bright, (3e38, 0, 0))
    np.testing.assert_allclose(relight.over(empty, (3e38, 0, 0))[..., 0], 3e38, rtol=1e-6)
