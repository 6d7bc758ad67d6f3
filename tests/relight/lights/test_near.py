import numpy as np
import pytest
import torch
from helpers import damage, shots
from helpers.standins import ball, image_of
from typer.testing import CliRunner

import relight
from relight.analysis.camera import Camera
from relight.cli.commands import app

LAMP = relight.PointLight((-0.6, 0.4, 1.2), radius=0.1, name="lamp")
BOX = relight.RectLight((0, 1.5, 1.0), (0, 0, 0), 1.0, 0.5, intensity=2, name="box")


@pytest.fixture(scope="module")
def sphere():
    """A ball of 1.4 m across, 2.6 m from the camera."""
    coverage, normals = ball(200, 160)
    with damage.small_canvas(256):
        return relight.Subject(image_of(coverage), normals=normals, height=1.4)


def irradiance(light, point, normal):
    """What a light of intensity 1 gives to a surface, unoccluded."""
    total = 0.0
    for directions, strength in light.rays(torch.tensor(point, dtype=torch.float32)[:, None]):
        total += float(strength * (torch.tensor(normal, dtype=torch.float32)[:, None] * directions).sum())
    return total


@pytest.mark.parametrize("radius", [0.0, 0.05, 0.4])
def test_a_lamp_gives_one_at_one_metre_and_falls_off_with_the_square(radius):
    lamp = relight.PointLight((0, 0, 2), radius=radius)
    assert irradiance(lamp, (0, 0, 1), (0, 0, 1)) == pytest.approx(1, rel=1e-4)
    assert irradiance(lamp, (0, 0, 0), (0, 0, 1)) == pytest.approx(1 / 4, rel=1e-4)
    slanted = irradiance(lamp, (0, 0, 1), (0, 0.6, 0.8))
    assert slanted == pytest.approx(0.8, rel=0.02)  # a sphere above the horizon lights as its middle does


def test_a_rectangle_shines_to_one_side_as_its_form_factor_says():
    box = relight.RectLight((0, 0, 1), (0, 0, 0), 0.6, 0.4)
    a, b = 0.3, 0.2  # half sides at one metre: Howell, A Catalog of Radiation Configuration Factors, B-3
    corner = (
        a / np.sqrt(1 + a**2) * np.arctan(b / np.sqrt(1 + a**2))
        + b / np.sqrt(1 + b**2) * np.arctan(a / np.sqrt(1 + b**2))
    ) / (2 * np.pi)
    exact = 4 * corner * np.pi / (0.6 * 0.4)
    assert irradiance(box, (0, 0, 0), (0, 0, 1)) == pytest.approx(exact, rel=0.01)
    assert irradiance(box, (0, 0, -99), (0, 0, 1)) == pytest.approx(1e-4, rel=1e-3)
    assert irradiance(box, (0, 0, 2), (0, 0, -1)) == 0


@pytest.mark.parametrize("size", [(4.0, 3.0), (1.0, 1.0), (2.0, 0.2)])
@pytest.mark.parametrize("distance", [0.2, 0.5, 3.0])
def test_a_rectangle_near_the_surface_gives_what_integration_says(size, distance):
    box = relight.RectLight((0.1, 0.2, distance), (0.1, 0.2, 0), *size)
    normal = np.array([0.2, 0.1, 0.97])
    normal /= np.linalg.norm(normal)
    right, up = box.sides
    u, v = np.meshgrid(*(side * ((np.arange(600) + 0.5) / 600 - 0.5) for side in size))
    for point in ((0.0, 0.0, 0.0), (0.3, -0.4, 0.0)):
        vectors = np.array(box.position) + u[..., None] * right + v[..., None] * up - point
        squared = (vectors**2).sum(axis=-1)
        cosines = (vectors @ normal).clip(0) * -(vectors @ box.axis).clip(max=0) / squared
        exact = (cosines / squared).mean()
        assert irradiance_in_front(box, point, normal) == pytest.approx(exact, rel=0.05)


def irradiance_in_front(light, point, normal):
    """As `irradiance`, without light from behind the surface."""
    total, normal = 0.0, torch.tensor(normal, dtype=torch.float32)[:, None]
    for directions, strength in light.rays(torch.tensor(point, dtype=torch.float32)[:, None]):
        total += float(strength * (normal * directions).sum(dim=0).clamp_min(0))
    return total


def test_a_lamp_may_be_at_the_camera(sphere):
    flash = relight.PointLight((0, 0, sphere.distance), intensity=sphere.distance**2)
    picture = sphere.relit(flash)
    front = sphere.relit(relight.DirectionalLight(intensity=1))
    assert picture[..., :3].mean() == pytest.approx(front[..., :3].mean(), rel=0.25)


def test_the_width_of_a_rectangle_runs_level():
    points = relight.RectLight((0, 1, 1), (0, 0, 0), 2.0, 0.1).points - (0, 1, 1)
    assert np.ptp(points[:, 0]) > 1.8
    assert np.ptp(points[:, 1]) < 0.1
    down = relight.RectLight((0, 2, 0), (0, 0, 0), 2.0, 0.1).points
    assert np.ptp(down[:, 0]) > 1.8
    assert np.ptp(down[:, 1]) < 1e-6


def test_far_away_a_lamp_is_a_distant_light(sphere):
    distant = relight.DirectionalLight(azimuth=-35, elevation=25)
    place = 200 * np.array(distant.direction)
    for light in (
        relight.PointLight(place, intensity=200**2),
        relight.RectLight(place, (0, 0, 0), 1, 1, intensity=200**2),
    ):
        near, far = (subject_light[..., :3] for subject_light in map(sphere.relit, (light, distant)))
        assert np.abs(near - far).mean() < 0.01 * far.mean()
        visible = sphere.unshadowed(light) - sphere.visibility(np.array([distant.direction]))[0]
        assert np.abs(visible).mean() < 0.01


def test_each_pixel_has_its_own_direction(sphere):
    """A map of one direction everywhere is that of a distant light; of two, each half is one's."""
    found = sphere.record.maps
    pair = torch.nn.functional.normalize(torch.tensor([[-0.6, 0.3, 0.7], [0.5, 0.5, -0.3]]), dim=1)
    height, width = found.known.shape
    half = torch.arange(width).expand(height, width) < width // 2
    directions = torch.where(half, pair[0][:, None, None], pair[1][:, None, None])
    for maps in (found.visibility, found.shading):
        first, second = maps(pair)
        torch.testing.assert_close(
            maps.per_pixel(directions), torch.where(half, first, second), atol=1e-3, rtol=0
        )


def test_light_falls_off_across_the_person(sphere):
    low = relight.PointLight((0, -0.5, 1.0))
    light = sphere.lighting(low)[..., 0]
    assert light[150, 80] > 3 * light[50, 80]


def test_linear_in_intensity_and_additive(sphere):
    lamp, box = sphere.relit(LAMP), sphere.relit(BOX)
    np.testing.assert_allclose(sphere.relit([LAMP, BOX])[..., :3], (lamp + box)[..., :3], atol=1e-6)
    brighter = relight.PointLight(LAMP.position, radius=0.1, intensity=4, colour=(1, 0.5, 0))
    np.testing.assert_allclose(
        sphere.relit(brighter)[..., :3], lamp[..., :3] * np.float32([4, 2, 0]), rtol=1e-5, atol=1e-7
    )
    layers = sphere.layers([LAMP, BOX, relight.DirectionalLight(name="key")])
    assert list(layers) == ["lamp", "box", "key"]


def test_a_larger_lamp_is_softer_and_as_bright(sphere):
    hard, soft = (relight.PointLight((-1.2, 0.4, 0.6), radius=radius, name="lamp") for radius in (0.0, 0.45))
    inside = sphere.matte > 0.99
    edges = [((v > 0.2) & (v < 0.8))[inside].sum() for v in map(sphere.unshadowed, (hard, soft))]
    assert edges[1] > 1.15 * edges[0]
    sums = [sphere.lighting(light).sum() for light in (hard, soft)]
    assert sums[1] == pytest.approx(sums[0], rel=0.1)


@pytest.mark.slow
def test_a_filtered_person_is_lit_alike(sphere):
    coverage, normals = ball(200, 160, centre=(0.51, 0.5))
    with damage.small_canvas(256):
        other = relight.Subject(image_of(coverage), normals=normals, camera=sphere.camera)
    steady = sphere.temporally_filtered([other])
    own, mean = sphere.lighting(LAMP), steady.lighting(LAMP)
    assert np.abs(mean - own).mean() < 0.02 * own.mean()
    assert np.abs(steady.depth - sphere.depth)[sphere.matte > 0].mean() < 0.01
    assert np.abs(mean - own).max() > 0  # the other frame takes part


def test_a_light_in_or_at_the_person_is_refused(sphere):
    for place, words in (((0, 0, -0.2), "is inside the person"), ((0, 0, 0.3), "touches the person")):
        lamp = relight.PointLight(place, radius=0.3, name="lamp")
        with pytest.raises(ValueError, match=f"lamp: position: {words}"):
            sphere.relit(relight.PointLight(place, name="lamp") if place[2] < 0 else lamp)
    assert sphere.relit(relight.PointLight((0, 0.9, -1.5)))[..., :3].max() > 0  # behind them is well


@pytest.mark.parametrize(
    ("light", "words"),
    [
        ("lamp:position=nan/0/1", "position: expected 3 finite numbers of metres"),
        ("lamp:position=0/1", "position: expected 3 numbers of metres"),
        ("lamp:radius=0.1", "position is missing"),
        ("lamp:position=0/0/1,radius=-1", "radius: expected a number of metres from 0 to"),
        ("box:position=0/0/2,width=1,height=1", "toward is missing"),
        (
            "box:position=0/0/2,toward=0/0/0,width=0,height=1",
            "width: expected a number of metres from 0.0001 to",
        ),
        ("box:position=0/0/2,toward=0/0/2,width=1,height=1", "is at position, where the light stands"),
        ("lamp:position=0/0/-0.2", "is inside the person"),
    ],
)
def test_the_command_refuses_in_one_line_and_writes_nothing(tmp_path, light, words):
    coverage, _ = ball(200, 160)
    relight.write(tmp_path / "in.exr", image_of(coverage))
    outputs = ["-o", str(tmp_path / "out.png"), "--save-lights", str(tmp_path / "out.yaml")]
    options = ["--height", "1.4", "--light", light, *outputs]
    result = CliRunner().invoke(app, ["apply", str(tmp_path / "in.exr"), *options])
    assert result.exit_code == 2
    assert words in " ".join(result.output.split())
    assert not list(tmp_path.glob("out*"))


@pytest.mark.parametrize("name", ["lights.yaml", "lights.json"])
def test_files_hold_them_and_text_reads_them(tmp_path, name):
    moving = relight.MovingLight(
        relight.PointLight, position={1: (0.0, 0.0, 1.0), 11: (1.0, 0.0, 1.0)}, name="drift"
    )
    relight.write_lights(tmp_path / name, [LAMP, BOX, moving])
    assert relight.read_lights(tmp_path / name) == [LAMP, BOX, moving]
    assert moving.at(6).position == (0.5, 0, 1)
    (tmp_path / "bare.yaml").write_text("lights: [{name: lamp, position: [-0.6, 0.4, 1.2], radius: 0.1}]")
    assert relight.read_lights(tmp_path / "bare.yaml") == [LAMP]


def test_an_orbit_carries_a_lamp_around_the_vertical():
    lamp = relight.MovingLight(relight.PointLight, position=(0.0, 0.5, 1.0), orbit=4)
    np.testing.assert_allclose(lamp.at(2).position, (1, 0.5, 0), atol=1e-9)  # as azimuth: to image right
    np.testing.assert_allclose(lamp.at(3).position, (0, 0.5, -1), atol=1e-9)


def test_the_frames_of_a_shot_share_one_room(tmp_path):
    """The room is that of the source's first frame, whichever part of the shot is made."""
    mattes = [ball(120, 90, radius=radius)[0] for radius in (0.2, 0.4)]
    for number, coverage in enumerate(mattes, 1):
        relight.write(tmp_path / f"in.{number:04d}.exr", image_of(coverage))
    source, output = str(tmp_path / "in.%04d.exr"), tmp_path / "out.%04d.exr"
    shots.render(source, LAMP, output, frames=(2, 2), passes=["Z"], height=0.8, temporal_filter=False)
    depth = relight.read_layers(tmp_path / "out.0002.exr")["Z"]
    room = Camera.of(torch.from_numpy(mattes[0]), 0.8)
    assert np.median(depth[depth > 0]) == pytest.approx(room.distance, rel=0.01)
    assert Camera.of(torch.from_numpy(mattes[1]), 0.8).distance < 0.6 * room.distance


@pytest.mark.usefixtures("full_canvas")
@pytest.mark.slow
def test_truth_is_nearer_to_a_near_light_than_to_a_distant_one(benchmark_module):
    """`benchmarks/near.py --truth`, on two bodies."""
    scores = benchmark_module("near").truth(2)
    for what in ("visibility", "shading"):
        assert scores[f"{what}, near"].mean() < 0.96 * scores[f"{what}, directional"].mean()
    assert scores["depth"].mean() < 0.6 * scores["no depth"].mean()


def test_a_cone_keeps_the_light_in():
    """UsdLux's: a smooth step from the soft part's beginning to the cone's edge."""
    lamp = relight.PointLight((0, 0, 2), toward=(0, 0, 0), cone=20, softness=0.5)
    degrees = np.array([0, 9, 15, 19.9, 20.1, 90])
    points = np.stack([2 * np.tan(np.radians(degrees[:5])), np.zeros(5), np.zeros(5)])
    points = np.concatenate([points, [[1], [0], [2]]], axis=1)
    ((_, lit),) = lamp.rays(torch.from_numpy(np.float32(points)))
    ((_, bare),) = relight.PointLight((0, 0, 2)).rays(torch.from_numpy(np.float32(points)))
    np.testing.assert_allclose(lit / bare, [1, 1, 0.5, 0.0003, 0, 0], atol=1e-3)


def test_a_cone_without_softness_has_a_sharp_edge():
    lamp = relight.RectLight((0, 0, 2), (0, 0, 0), 1e-3, 1e-3, cone=20)
    points = torch.tensor([[2 * np.tan(np.radians(19)), 2 * np.tan(np.radians(21))], [0, 0], [0, 0]]).float()
    lit = sum(irradiance for _, irradiance in lamp.rays(points))
    assert lit[0] > 0.15
    assert lit[1] == 0


def test_spotlights_come_from_text_and_move():
    spot = relight.PointLight.parse("spot:position=0/1/2,toward=0/0/0,cone=30,softness=0.2")
    assert spot.cone == 30
    moving = relight.MovingLight(
        relight.PointLight, position=(0, 1, 2), toward=(0, 0, 0), cone={1: 10, 11: 30}
    )
    assert moving.at(6).cone == 20
    with pytest.raises(ValueError, match="toward: is missing"):
        relight.PointLight((0, 0, 1), cone=30)
    with pytest.raises(ValueError, match="cone: expected"):
        relight.RectLight((0, 0, 1), (0, 0, 0), 1, 1, cone=100)


def test_a_light_writes_only_what_is_not_the_default_of_its_kind():
    box = relight.RectLight((1, 1, 1), toward=(0, 0, 0), width=1, height=2)
    assert box.settings() == {"position": (1, 1, 1), "toward": (0, 0, 0), "width": 1, "height": 2}
    assert relight.PointLight((1, 1, 1), toward=(0, 0, 0), cone=90).settings()["cone"] == 90
