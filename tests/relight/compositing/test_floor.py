import numpy as np
import pytest
import torch
from helpers import ROOT

import relight
from relight.analysis.camera import Camera
from relight.compositing.floor_shadow import FloorShadow
from relight.rendering import render_subject
from shadow.directions import from_spherical

RADIUS, TALL, AWAY, EYES = 0.1, 0.6, 3.0, 0.55  # metres; a post that stands on the floor before a camera
SIZE, FOCAL = (500, 800), 1200.0
TILT = np.radians(5)  # by which the camera looks down
HORIZON = float(0.5 - np.tan(TILT) * FOCAL / SIZE[0])
# The floor's own axes, as rows: to image right, up, and along the floor toward the camera.
AXES = np.array([[1, 0, 0], [0, np.cos(TILT), np.sin(TILT)], [0, -np.sin(TILT), np.cos(TILT)]])
UP = np.float32(AXES[1])
FLOOR = relight.Floor(horizon=HORIZON)


def rays():
    x = (np.arange(SIZE[1]) + 0.5 - SIZE[1] / 2) / FOCAL
    y = (SIZE[0] / 2 - np.arange(SIZE[0]) - 0.5) / FOCAL
    across, up = np.meshgrid(x, y)
    return np.stack([across, up, -np.ones_like(across)], axis=-1)


def crossed(origins, ways):
    """Where lines, in the floor's axes, enter and leave an endless post: (H, W) times, NaN where not."""
    x, z = origins[..., 0], origins[..., 2] + AWAY
    square = ways[..., 0] ** 2 + ways[..., 2] ** 2
    half = -(x * ways[..., 0] + z * ways[..., 2]) / square
    with np.errstate(invalid="ignore"):
        reach = np.sqrt(half**2 - (x**2 + z**2 - RADIUS**2) / square)
    return half - reach, half + reach


@pytest.fixture(scope="module")
def post():
    """The post as the camera sees it, standing on its floor, and where its middle is, the camera at 0."""
    ways = rays() @ AXES.T
    time = np.nan_to_num(crossed(np.array([0, EYES, 0]), ways)[0], nan=-1)
    height = EYES + time * ways[..., 1]
    known = (time > 0) & (height > 0) & (height < TALL)
    positions = rays() * np.where(known, time, AWAY)[..., None]
    rows, columns = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    middle = float(columns[0] + columns[-1] + 1) / 2, float(rows[0] + rows[-1] + 1) / 2
    distance = float(np.median(-positions[known][:, 2]))
    camera = Camera(SIZE, FOCAL, middle, distance, int(rows[-1]) + 1)
    origin = np.append((middle - np.array(SIZE[::-1]) / 2) * [1, -1] / FOCAL, -1) * distance
    relative = torch.from_numpy(np.float32(positions - origin)).permute(2, 0, 1)
    return FloorShadow.of(FLOOR, camera, relative.contiguous(), torch.from_numpy(known), cut=False), origin


def in_the_way(light, near):
    """Whether the post lies between what the camera sees of the floor and a light: (H, W)."""
    ways = rays() @ AXES.T
    floor = ways[..., 1] < -1e-3
    points = ways * (EYES / -np.where(floor, ways[..., 1], -1))[..., None]  # the camera at 0
    toward = AXES @ light - points if near else np.broadcast_to(AXES @ light, points.shape)
    enters, leaves = crossed(points, toward)
    return floor & (leaves > 0) & (enters.clip(0) * toward[..., 1] < TALL)


def overlap(first, second):
    return (first & second).sum() / (first | second).sum()


@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 40), (70, 30), (-120, 50), (180, 35)])
def test_the_shadow_of_a_post_is_where_the_light_does_not_reach(post, azimuth, elevation):
    direction = from_spherical(azimuth, elevation)
    (shadow,), total = (lambda each, total: (each.values(), total))(
        *post[0].shadows({"key": relight.DirectionalLight(direction)})
    )
    truth = in_the_way(direction, near=False)
    assert overlap(shadow[..., 0] < 0.5, truth) > 0.9
    assert np.array_equal(shadow, total)
    assert shadow[: int(HORIZON * SIZE[0])].min() == 1  # the sky has none


def test_a_lamp_in_the_room_throws_a_shadow_from_where_it_is(post):
    stance, origin = post
    lamp = np.float32([0.3, 0.35, 0.1])
    _, shadow = stance.shadows({"lamp": relight.PointLight(lamp)})
    scale = EYES / stance.plane.below  # the stance has its metres from where the ball's lower edge is seen
    truth = in_the_way((lamp + origin) * scale, near=True)
    assert overlap(shadow[..., 0] < 0.5, truth) > 0.85
    distant = in_the_way(lamp / np.linalg.norm(lamp), near=False)
    assert overlap(shadow[..., 0] < 0.5, distant) < 0.8
    _, far = stance.shadows({"lamp": relight.PointLight(lamp * 1000, intensity=1e6)})
    _, sun = stance.shadows({"sun": relight.DirectionalLight(lamp)})
    assert np.abs(far - sun).mean() < 1e-3


def test_light_from_below_the_floor_casts_no_shadow(post):
    each, total = post[0].shadows({"below": relight.DirectionalLight(elevation=-20)})
    assert each["below"].min() == total.min() == 1


def test_a_soft_light_takes_as_much_light_and_has_no_edge(post):
    lights = {angle: relight.DirectionalLight(azimuth=80, elevation=40, angle=angle) for angle in (0, 20)}
    hard, soft = (post[0].shadows({"key": light})[1] for light in lights.values())
    partly = [((shadow > 0.1) & (shadow < 0.9)).sum() for shadow in (hard, soft)]
    assert partly[1] > 5 * partly[0]
    assert (1 - soft).sum() == pytest.approx((1 - hard).sum(), rel=0.1)


@pytest.mark.slow
def test_a_sky_is_hidden_near_the_post_alone(post):
    sky = relight.EnvironmentLight(np.ones((16, 32, 3), np.float32))
    _, shadow = post[0].shadows({"sky": sky})
    row = post[0].camera.bottom
    near, far = shadow[row + 1, SIZE[1] // 2], shadow[row + 1, 50]
    assert near.max() < 0.65
    assert far.min() > 0.95


def test_shadows_are_weighted_by_the_light_that_the_floor_gets(post):
    red = relight.DirectionalLight(azimuth=-80, elevation=30, colour=(1, 0, 0), intensity=3)
    white = relight.DirectionalLight(azimuth=80, elevation=60)
    each, total = post[0].shadows({"red": red, "white": white})
    gets = {
        "red": np.float32([3, 0, 0]) * max(UP @ red.direction, 0),
        "white": UP @ white.direction * np.ones(3),
    }
    expected = sum(gets[name] * shadow for name, shadow in each.items()) / sum(gets.values())
    np.testing.assert_allclose(total, expected, atol=1e-5)
    again = post[0].shadows({"red": red, "white": white, "red again": red})[0]
    assert np.array_equal(again["red"], again["red again"])
    assert each["red"][..., 1:].min() == 1  # it has no green to keep off


def test_the_floor_ends_at_the_horizon(post):
    plane, camera = post[0].plane, post[0].camera
    top, points = plane.horizon(camera), plane.visible_points(camera, 1)
    assert top == int(HORIZON * SIZE[0])
    np.testing.assert_allclose(points[5:].numpy() @ UP, -post[0].plane.below, rtol=1e-3)


def test_height_says_how_the_floor_is_tilted(post):
    stance, _ = post
    points = torch.tensor([0.0, -EYES, -AWAY])[:, None]
    for height in (0.3, 0.8):
        plane = relight.Floor(height=height).plane(stance.camera, points)
        assert plane.below == pytest.approx(height, rel=1e-4)
    with pytest.warns(UserWarning, match="times as tall"):
        relight.Floor(height=1.5, horizon=HORIZON).plane(stance.camera, points)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("height=0", "height: expected a number of metres above 0"),
        ("height=-1,horizon=0.4", "height"),
        ("horizon=1.5", "horizon"),
        ("horizon=nan", "horizon"),
        ("tilt=3", "tilt: not known; expected height, horizon, feet"),
        ("height=1/2", "height: expected a number of metres"),
        ("feet=1/2/3", "feet"),
        ("", "not understood"),
    ],
)
def test_what_is_no_floor_is_refused(text, problem):
    with pytest.raises(ValueError, match=problem):
        relight.Floor.parse(text)


def test_a_floor_is_read_from_text():
    assert relight.Floor.parse("height=1.5, horizon=0.45") == relight.Floor(height=1.5, horizon=0.45)
    assert relight.Floor.parse("feet=10/20/30/40").feet == (10, 20, 30, 40)


def test_a_person_who_cannot_stand_there_is_refused(person):
    image, mask = person
    with pytest.raises(ValueError, match=r"horizon above the soles, which are at 0\.90"):
        relight.apply(image, relight.DirectionalLight(), mask=mask, floor=relight.Floor(horizon=0.95))
    with pytest.raises(ValueError, match="cuts the feet off"):
        relight.Floor(horizon=0.4).check(torch.from_numpy(mask[:150]))
    with pytest.raises(ValueError, match="points in the picture"):
        relight.Floor(feet=(10, 20, 300, 40)).check(torch.from_numpy(mask))
    relight.Floor(height=1.5, horizon=0.4).check(torch.from_numpy(mask[:150]))


@pytest.mark.slow
def test_the_background_alone_carries_the_shadow(person):
    image, mask = person
    lights = [relight.DirectionalLight(azimuth=50, elevation=40, name="key")]
    lights.append(relight.PointLight((-0.8, 0.5, 1.0), name="lamp"))
    options = {"mask": mask, "background": (0.5, 0.4, 0.3)}
    subject, floor, back = relight.Subject(image, mask), relight.Floor(horizon=0.3), options["background"]
    without, layers = render_subject(subject, lights, background=back)
    picture, shadowed = render_subject(subject, lights, background=back, floor=floor)
    assert shadowed.keys() - layers.keys() == {"shadow_floor_key", "shadow_floor_lamp"}
    for name in ("C_key", "C_lamp"):
        assert np.array_equal(layers[name], shadowed[name])
    groups = sum(layer[..., :3] for name, layer in shadowed.items() if name.startswith("C_"))
    np.testing.assert_allclose(groups, picture, atol=1e-6)
    assert (picture <= without).all()
    assert (picture < without - 0.1).any()
    applied = relight.apply(image, lights, floor=floor, **options)
    np.testing.assert_allclose(applied, picture, atol=2e-3)
    kept, alone = render_subject(subject, lights, floor=floor)
    assert np.array_equal(alone["shadow_floor_key"], shadowed["shadow_floor_key"])
    assert np.array_equal(kept[..., 3], mask)


@pytest.mark.slow
def test_shadows_of_bodies_are_nearer_the_truth_than_a_matte_laid_flat():
    """benchmarks/floor.py on four bodies."""
    import sys

    sys.path.insert(0, str(ROOT / "benchmarks"))
    from floor import View, laid_flat

    scores = []
    for seed in (1, 4, 5, 8):
        view = View(seed)
        subject = view.subject(view.depth)
        _, shadow = subject.shadows(relight.DirectionalLight(view.direction), view.floor)
        scores.append((view.score(shadow), view.score(laid_flat(view, subject))))
    ours, flat = np.mean(scores, axis=0)
    assert ours > flat + 0.1
