import multiprocessing
import warnings

import numpy as np
import pytest
import torch
from helpers.damage import SHIPPED_CANVAS, small_canvas
from helpers.standins import Delighter, analysed, ball, image_of

import relight
from shadow.networks.backbone import Backbone

LEFT = relight.DirectionalLight(azimuth=-60, name="left")
RIGHT = relight.DirectionalLight(azimuth=60, intensity=0.7, colour=(0.2, 0.6, 1.0), name="right")
ABOVE = relight.DirectionalLight(elevation=70, angle=30, intensity=3, name="above")


@pytest.fixture(scope="module")
def sphere():
    coverage, normals = ball(200, 160)
    return relight.Subject(image_of(coverage), normals=normals)


# What it holds


def test_its_maps_cannot_be_changed_by_mistake(sphere):
    for name in ("matte", "albedo", "normals", "depth", "position"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(sphere, name)[:] = 0


def test_positions_are_what_depth_and_the_camera_say(sphere):
    inside, position = sphere.matte > 0.5, sphere.position
    assert position.shape == (*sphere.size, 3)
    np.testing.assert_allclose(position[inside][:, 2], -sphere.depth[inside], atol=1e-6)
    assert (position[sphere.matte == 0] == 0).all()
    # The outermost normals of an orthographic ball point away from a perspective camera.
    across = position[100, inside[100]]
    assert np.all(np.diff(across[:, 0]) > 0)  # x to image right
    assert np.ptp(position[inside][:, 1]) == pytest.approx(1.75, rel=0.2)  # the height that it shows
    row, column = np.argwhere(inside)[0]
    x, y = sphere.camera.on_plate(position[row, column])
    assert (x, y) == pytest.approx((column + 0.5, row + 0.5), abs=1e-2)


# Cost


def test_the_analysis_is_two_passes_and_lights_cost_none():
    passes = []

    def count(module, *_):
        if isinstance(module, Backbone):
            passes.append(module)

    hook = torch.nn.modules.module.register_module_forward_hook(count)
    try:
        subject = relight.Subject(image_of(ball(200, 160)[0]))
        assert len(passes) == 2
        subject.relit([LEFT, RIGHT, ABOVE])
        subject.visibility(np.eye(3))
        assert len(passes) == 2
    finally:
        hook.remove()


# Linearity


def test_light_adds(sphere):
    both = sphere.relit([LEFT, RIGHT])[..., :3]
    separate = sphere.relit([LEFT])[..., :3] + sphere.relit(RIGHT)[..., :3]
    np.testing.assert_allclose(both, separate, rtol=1e-5, atol=1e-6)
    assert both.max() > 0.01


@pytest.mark.parametrize("factor", [0.25, 2.0, 1024.0])
def test_light_scales_and_is_never_clipped(sphere, factor):
    once = sphere.relit(relight.DirectionalLight(azimuth=30, angle=20))
    scaled = sphere.relit(relight.DirectionalLight(azimuth=30, angle=20, intensity=factor))
    np.testing.assert_allclose(scaled[..., :3], factor * once[..., :3], rtol=1e-6)
    np.testing.assert_array_equal(scaled[..., 3], once[..., 3])
    assert factor < 1024 or scaled.max() > 10


def test_no_light_is_black(sphere):
    dark = sphere.relit([])
    assert (dark[..., :3] == 0).all()
    np.testing.assert_array_equal(dark[..., 3], sphere.relit(LEFT)[..., 3])


def test_layers_sum_to_the_picture(sphere):
    lights = [LEFT, RIGHT, relight.DirectionalLight()]
    layers, picture = sphere.layers(lights), sphere.relit(lights)
    assert list(layers) == ["left", "right", "light3"]
    np.testing.assert_allclose(
        sum(layer[..., :3] for layer in layers.values()), picture[..., :3], rtol=1e-5, atol=1e-6
    )
    for layer in layers.values():
        np.testing.assert_array_equal(layer[..., 3], picture[..., 3])
    with pytest.raises(ValueError, match="lights: expected different names, got left, left"):
        sphere.layers([LEFT, LEFT])


def test_the_picture_is_albedo_times_shading(sphere):
    shading = sphere.shading([LEFT.direction, RIGHT.direction])
    power = np.concatenate([light.samples()[1] for light in (LEFT, RIGHT)])
    expected = sphere.albedo * np.einsum("dhw,dc->hwc", shading, power)
    picture = sphere.relit([LEFT, RIGHT])
    np.testing.assert_allclose(picture[..., :3], expected * picture[..., 3:], rtol=1e-4, atol=1e-6)


# Axes, ranges and shapes


def test_a_light_brightens_its_side():
    coverage, normals = ball(200, 200)
    subject = relight.Subject(image_of(coverage), normals=normals, albedo=np.full((200, 200, 3), 0.5))
    left, above = subject.relit(LEFT)[..., :3], subject.relit(relight.DirectionalLight(elevation=60))[..., :3]
    assert left[:, :100].mean() > 2 * left[:, 100:].mean()
    assert above[:100].mean() > 1.5 * above[100:].mean()


def test_what_a_subject_knows_is_at_plate_size(sphere):
    directions = np.array([[0, 0, 1], [-1, 0, 1], [0, 3, 0.5], [0, 0, -1.0]])
    outside = sphere.relit(LEFT)[..., 3] == 0
    visibility, shading = sphere.visibility(directions), sphere.shading(directions)
    assert visibility.shape == shading.shape == (4, 200, 160)
    for maps in (visibility, shading):
        assert maps.dtype == np.float32
        assert maps.min() >= 0
        assert maps.max() <= 1 + 1e-6
        assert (maps[:, outside] == 0).all()
    assert shading[0].max() > 0
    length = np.linalg.norm(sphere.normals, axis=-1)
    np.testing.assert_allclose(length[~outside], 1, atol=1e-5)
    assert (length[outside] == 0).all()
    assert sphere.albedo.shape == (200, 160, 3)
    assert (sphere.albedo[outside] == 0).all()
    assert sphere.albedo.min() >= 0
    assert sphere.albedo.max() <= 1


def test_given_normals_and_albedo_are_used():
    coverage, normals = ball(400, 300, radius=0.35)
    albedo = np.random.default_rng(0).random((400, 300, 3), np.float32)
    subject = relight.Subject(image_of(coverage), albedo=albedo, normals=normals)
    covered = coverage > 0
    np.testing.assert_array_equal(subject.albedo[covered], albedo[covered])
    inside = ball(400, 300, radius=0.3)[0] == 1
    agreement = (subject.normals * normals).sum(axis=-1)[inside]
    assert agreement.min() > 0.98


@pytest.mark.parametrize("size", [(1080, 1920), (40, 30), (17, 90)])
def test_any_plate_size(size):
    coverage, normals = ball(*size)
    picture = relight.Subject(image_of(coverage), normals=normals).relit([LEFT, ABOVE])
    assert picture.shape == (*size, 4)
    assert np.isfinite(picture).all()
    np.testing.assert_array_equal(picture[..., 3], coverage)
    assert picture[..., :3].max() > 0


# Quality at the plate's resolution


def test_albedo_keeps_texture_and_loses_the_light():
    height, width = 1280, 960  # four plate pixels and more to a canvas pixel
    coverage, normals = ball(height, width)
    y, x = np.mgrid[:height, :width]
    albedo = (0.4 + 0.2 * np.sign(np.sin(x * 1.1)) * np.sign(np.sin(y * 0.9)))[..., None] * (1, 0.8, 0.6)
    light = 0.15 + 0.85 * np.clip(normals @ (0.6, 0.3, 0.74), 0, None)[..., None]
    photo = np.concatenate([albedo * light, np.ones((height, width, 1))], -1) * coverage[..., None]
    truth = torch.tensor([0.4, 0.32, 0.24])[:, None, None]  # the network sees the cloth but no threads
    delighter = Delighter(lambda rgb, mask: truth * (mask > 0))
    subject = analysed(photo.astype(np.float32), shader=delighter, normals=normals)
    inside = ball(height, width, radius=0.33)[0] == 1
    error = subject.albedo[inside] - albedo[inside]
    assert np.sqrt((error**2).mean()) < 0.03
    texture = np.corrcoef(subject.albedo[inside][:, 0], albedo[inside][:, 0])[0, 1]
    remains = np.corrcoef(subject.albedo[inside][:, 0], light[inside][:, 0])[0, 1]
    assert texture > 0.98
    assert abs(remains) < 0.1


def test_shading_edges_follow_the_plate_at_large_sizes():
    height, width, edge = 1280, 960, 503  # the edge between a lit and an averted half, off the canvas grid
    coverage = np.zeros((height, width), np.float32)
    coverage[100:-100, 150:-150] = 1
    right = np.arange(width) >= edge
    normals = np.where(right[None, :, None], (0.9, 0, 0.436), (-0.9, 0, 0.436)) * np.ones((height, 1, 1))
    colour = np.where(right[None, :, None], (0.6, 0.1, 0.1), (0.1, 0.3, 0.6)) * np.ones((height, 1, 1))
    image = np.concatenate([colour, np.ones((height, width, 1))], axis=-1) * coverage[..., None]
    subject = relight.Subject(
        image.astype(np.float32), normals=normals, albedo=np.full((height, width, 3), 0.5)
    )
    across = subject.normals[640, :, 0]
    assert across[edge - 3] < -0.8  # within 3 plate pixels; a canvas pixel is 5 and a bicubic ramp 15
    assert across[edge + 3] > 0.8


def test_black_and_extreme_plates_stay_finite():
    coverage, normals = ball(120, 90)
    for value in (0.0, 1e-8, 1e4):
        image = image_of(coverage, (value, value, value))
        subject = relight.Subject(image, normals=normals)
        assert np.isfinite(subject.albedo).all()
        assert np.isfinite(subject.relit(LEFT)).all()


def test_noise_in_the_black_is_not_lifted_to_white():
    coverage, normals = ball(240, 180)
    photo = image_of(coverage, (0.5, 0.5, 0.5))
    photo[:120, :, :3] = 0
    photo[80, 90, :3] = 2e-4  # a hot pixel in the deepest shadow
    grey = Delighter(lambda rgb, mask: torch.full_like(rgb, 0.5) * (mask > 0))
    albedo = analysed(photo, shader=grey, normals=normals).albedo
    assert 0 < albedo[80, 90].max() < 0.03  # the mean light is 0.5: lifted 100 times at most
    assert albedo[200, 90].min() > 0.4


# Errors


COVERAGE, NORMALS = ball(60, 45)
IMAGE = image_of(COVERAGE)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"image": IMAGE[..., :3], "matte": None}, ValueError, "mask: the image has no alpha channel"),
        ({"image": np.ones((60, 45, 4)), "matte": None}, ValueError, "the image is opaque everywhere"),
        ({"mask": COVERAGE, "matte": "m.onnx"}, ValueError, "matte: expected no mask beside a matting model"),
        ({"image": IMAGE[..., :3], "matte": COVERAGE}, TypeError, "give the matte itself as mask"),
        ({"image": IMAGE[..., :3]}, ImportError, "relight fetch person brings them"),
        ({"image": IMAGE * 0}, ValueError, "image's alpha: is empty"),
        ({"image": IMAGE * np.nan}, ValueError, "image: contains NaN or infinite"),
        ({"image": IMAGE[..., 0]}, ValueError, r"image: expected shape \(H, W, 3\) or"),
        ({"image": IMAGE.astype(int)}, TypeError, "image: expected uint8, uint16 or a floating dtype"),
        ({"mask": COVERAGE[:30]}, ValueError, r"mask: expected an array of shape \(60, 45\)"),
        ({"mask": COVERAGE * 2}, ValueError, r"mask: expected values in \[0, 1\]"),
        ({"mask": COVERAGE * np.nan}, ValueError, "mask: contains NaN"),
        ({"mask": COVERAGE * 0}, ValueError, "mask: is empty"),
        ({"mask": COVERAGE.astype(int)}, TypeError, "mask: expected an array"),
        ({"mask": 1 - COVERAGE, "image": IMAGE}, ValueError, "transparent where the mask shows"),
        ({"albedo": IMAGE}, ValueError, r"albedo: expected shape \(60, 45, 3\)"),
        ({"albedo": IMAGE[:9, :, :3]}, ValueError, r"albedo: expected shape \(60, 45, 3\)"),
        ({"albedo": IMAGE[..., :3] + np.inf}, ValueError, "albedo: contains NaN or infinite"),
        ({"albedo": IMAGE[..., :3] - 1}, ValueError, r"albedo: expected values in \[0, 1\]"),
        ({"normals": NORMALS[:9]}, ValueError, r"normals: expected shape \(60, 45, 3\)"),
        ({"normals": NORMALS * np.nan}, ValueError, "normals: contains NaN"),
        ({"normals": "up"}, ValueError, "unknown weights 'up'"),
        ({"normals": "up.exr"}, ValueError, "relight.read_normals reads images"),
        ({"normals": -NORMALS}, ValueError, "normals: point away from the camera"),
    ],
)
def test_a_subject_refuses_invalid_images_masks_albedo_and_normals(arguments, error, message):
    with pytest.raises(error, match=message), np.errstate(invalid="ignore"):
        relight.Subject(**({"image": IMAGE} | arguments))


@pytest.mark.parametrize("lights", [3, [LEFT, (0, 0, 1)]])
def test_only_lights_light(sphere, lights):
    with pytest.raises(TypeError, match="lights: expected lights"):
        sphere.relit(lights)
    with pytest.raises(ValueError, match="lights: no preset is called 'key'; there are three-point"):
        sphere.relit("key")


@pytest.mark.parametrize("ask", ["visibility", "shading"])
def test_bad_directions_are_named(sphere, ask):
    with pytest.raises(ValueError, match="directions: direction 1 has zero length"):
        getattr(sphere, ask)([[0.0, 0, 1], [0, 0, 0]])
    with pytest.raises(ValueError, match=r"directions: expected light directions of shape \(D, 3\)"):
        getattr(sphere, ask)([0.0, 0, 1])


def test_values_beyond_float32_are_refused(person):
    rgb, mask = person
    spoiled = rgb.copy()
    spoiled[100, 80] = 3e38
    with pytest.raises(ValueError, match="image: expected values of at most 1e\\+15, got 3e\\+38"):
        relight.Subject(spoiled, mask)
    subject = relight.Subject(rgb, mask)
    for bright in ([relight.DirectionalLight(intensity=3e38)] * 3, relight.DirectionalLight(intensity=1e39)):
        with pytest.raises(ValueError, match="lights: are too bright"):
            subject.relit(bright)
        with pytest.raises(ValueError, match="lights: are too bright"):
            subject.lighting(bright)


@pytest.mark.slow
def test_a_spawned_pool_relights_what_it_is_sent():
    """Two processes: one relights a filtered Subject that this process made; one makes its own."""
    light = relight.DirectionalLight(azimuth=30)
    with small_canvas(SHIPPED_CANVAS):  # the networks' own, as in the other processes
        here, again = relight.Subject(IMAGE), relight.Subject(IMAGE)
    filtered = here.temporally_filtered([again])
    expected = filtered.relit(light)
    context = multiprocessing.get_context("spawn")  # forked after the networks ran, a process may hang
    with context.Pool(2) as pool:
        sent = pool.apply_async(filtered.relit, (light,))
        made = pool.apply_async(relight.apply, (IMAGE, light))
        np.testing.assert_allclose(sent.get(120), expected, atol=1e-3)  # a pickle has the precision of a file
        np.testing.assert_allclose(made.get(120), here.relit(light), atol=1e-3)


def test_a_camera_of_another_plate_is_refused(person):
    rgb, mask = person
    subject = relight.Subject(rgb, mask)
    with pytest.raises(ValueError, match="camera: expected that of a plate of"):
        relight.Subject(rgb[:-1], mask[:-1], camera=subject.camera)


def test_a_distant_light_needs_no_depth_of_a_person_whom_the_frame_cuts():
    subject = relight.Subject(np.full((64, 48, 3), 0.3, np.float32), np.eye(64, 48, k=-8) < 0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # that the height is a guess
        subject.relit([relight.DirectionalLight(azimuth=-40), relight.EnvironmentLight(np.ones((4, 8, 3)))])
        subject.unshadowed(relight.DirectionalLight(azimuth=-40))
    with pytest.warns(UserWarning, match="height"):
        subject.relit(relight.PointLight(position=(0, 0, 3)))
