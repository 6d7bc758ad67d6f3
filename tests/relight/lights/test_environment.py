import dataclasses

import numpy as np
import pytest

import relight
from relight import EnvironmentLight
from relight.lights.environment import MAX_LAMPS

ROWS, COLUMNS = 64, 128


def solid_angles(rows, columns):
    """Of the pixels of a row (rows, 1, 1), steradians."""
    edges = np.sin(np.linspace(np.pi / 2, -np.pi / 2, rows + 1))
    return ((edges[:-1] - edges[1:]) * 2 * np.pi / columns)[:, None, None]


def pixel_directions(rows, columns):
    """(rows, columns, 3), written out from OpenEXR's ImfEnvmap.h: LatLongMap::direction."""
    latitude = (0.5 - (np.arange(rows)[:, None] + 0.5) / rows) * np.pi
    longitude = (0.5 - (np.arange(columns) + 0.5) / columns) * 2 * np.pi
    x = np.sin(longitude) * np.cos(latitude)
    z = np.cos(longitude) * np.cos(latitude)
    return np.stack([x, np.broadcast_to(np.sin(latitude), x.shape), z], axis=-1)


def studio(rows=ROWS):
    """Light everywhere, most of it in a few lamps; some colours outside Rec.709."""
    random = np.random.default_rng(5)
    pixels = random.gamma(0.3, 1, (rows, 2 * rows, 3)).astype(np.float32)
    pixels[rows // 4, rows // 2] = (900, 600, 300)
    pixels[rows // 2] = (-0.01, 0.5, 0.4)
    return pixels


def irradiance(light, normals):
    """Shading (N, 3) of unoccluded surfaces."""
    directions, intensities = light.samples()
    return np.maximum(normals @ directions.T, 0) @ intensities


def sphere(count=300):
    vectors = np.random.default_rng(1).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_a_white_sky_gives_a_white_surface_its_value():
    normals = sphere()
    np.testing.assert_allclose(
        irradiance(EnvironmentLight(np.ones((ROWS, COLUMNS, 3))), normals), 1, atol=0.01
    )
    dim = EnvironmentLight(np.full((ROWS, COLUMNS, 3), 0.25), exposure=1, colour=(1, 0.5, 0))
    np.testing.assert_allclose(irradiance(dim, normals), np.tile([0.5, 0.25, 0], (300, 1)), atol=0.01)


@pytest.mark.parametrize("rows", [1, 7, 64, 300, 512])
def test_no_energy_is_lost(rows):
    pixels = studio(rows)
    energy = (pixels * solid_angles(rows, 2 * rows)).sum(axis=(0, 1), dtype=np.float64)
    directions, intensities = EnvironmentLight(pixels, rotation=33).samples()
    np.testing.assert_allclose(intensities.sum(axis=0, dtype=np.float64) * np.pi, energy, rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
    assert directions.dtype == intensities.dtype == np.float32


@pytest.mark.parametrize("rows", [64, 300])
def test_lamps_light_as_all_pixels_do(rows):
    pixels, normals = studio(rows), sphere()
    every = pixel_directions(rows, 2 * rows).reshape(-1, 3)
    power = (pixels * solid_angles(rows, 2 * rows)).reshape(-1, 3) / np.pi
    exact = np.stack([np.maximum(every @ normal, 0) @ power for normal in normals])
    lamps = irradiance(EnvironmentLight(pixels), normals)
    error = (lamps - exact) / exact.mean()
    assert np.sqrt((error**2).mean()) < 0.004
    assert np.abs(error).max() < 0.015


def test_lamps_are_many_and_all_around():
    directions, _ = EnvironmentLight(np.ones((ROWS, COLUMNS, 3))).samples()
    assert 64 <= len(directions) <= MAX_LAMPS
    assert (directions[:, 2] < 0).mean() == pytest.approx(0.5, abs=0.05)
    nearest = (pixel_directions(16, 32).reshape(-1, 3) @ directions.T).max(axis=1)
    assert np.degrees(np.arccos(nearest.min())) < 12  # no hole in the sky


@pytest.mark.parametrize(
    ("row", "column", "direction"),
    [
        (ROWS // 2, COLUMNS // 2, (0, 0, 1)),  # the centre: at the camera
        (ROWS // 2, COLUMNS // 4, (1, 0, 0)),  # the left half: image right
        (ROWS // 2, 3 * COLUMNS // 4, (-1, 0, 0)),
        (0, 5, (0, 1, 0)),
        (ROWS - 1, 5, (0, -1, 0)),
        (ROWS // 2, 0, (0, 0, -1)),  # the seam: behind
        (ROWS // 2, COLUMNS - 1, (0, 0, -1)),
    ],
)
def test_pixels_of_a_map_light_from_their_directions(row, column, direction):
    pixels = np.zeros((ROWS, COLUMNS, 3), np.float32)
    pixels[row, column] = 100
    directions, intensities = EnvironmentLight(pixels).samples()
    brightest = directions[intensities.sum(axis=1).argmax()]
    assert brightest @ np.array(direction) > np.cos(np.radians(180 / ROWS))


def test_rotation_turns_the_world_as_azimuth_does():
    pixels = studio()
    directions, intensities = EnvironmentLight(pixels).samples()
    whole = EnvironmentLight(pixels, rotation=360).samples()
    np.testing.assert_array_equal(whole[0], directions)
    np.testing.assert_array_equal(whole[1], intensities)
    np.testing.assert_allclose(
        EnvironmentLight(pixels, rotation=180).samples()[0], directions * (-1, 1, -1), atol=1e-6
    )
    front = np.zeros((ROWS, COLUMNS, 3), np.float32)
    front[ROWS // 2 - 1 : ROWS // 2 + 1, COLUMNS // 2 - 1 : COLUMNS // 2 + 1] = 1
    directions, intensities = EnvironmentLight(front, rotation=40).samples()
    middle = directions.T @ intensities.sum(axis=1)
    expected = relight.DirectionalLight(azimuth=40).direction
    np.testing.assert_allclose(middle / np.linalg.norm(middle), expected, atol=1e-3)


def test_half_a_turn_swaps_the_rims(person):
    rgb, mask = person
    side = np.clip((np.mgrid[:200, :160][1] - 80) / 55, -0.95, 0.95)
    normals = np.stack([side, 0 * side, np.sqrt(1 - side**2)], axis=-1).astype(np.float32)
    subject = relight.Subject(rgb, mask, normals=normals, albedo=np.full((200, 160, 3), 0.5, np.float32))
    pixels = np.full((ROWS, COLUMNS, 3), 0.05, np.float32)
    pixels[24:40, COLUMNS // 4 - 3 : COLUMNS // 4 + 3] = 20  # a strip light at image right
    light = EnvironmentLight(pixels)

    def rims(rotation):
        picture = subject.relit(dataclasses.replace(light, rotation=rotation))[..., 0]
        return picture[62:78, 32:42].mean(), picture[62:78, 118:128].mean()

    left, right = rims(0)
    assert right > 3 * left
    left, right = rims(180)
    assert left > 3 * right


def bearings():
    """A map that says where it is: red is the azimuth's sine, green its cosine, blue the elevation's sine."""
    directions = pixel_directions(256, 512)
    level = directions / np.maximum(np.hypot(directions[..., :1], directions[..., 2:]), 1e-6)
    return np.stack([level[..., 0], level[..., 2], directions[..., 1]], axis=-1).astype(np.float32) + 1


@pytest.mark.parametrize("rotation", [0, 30, -100, 180, 360])
def test_the_camera_sees_what_is_behind_the_subject(rotation):
    light = EnvironmentLight(bearings(), rotation=rotation, intensity=2)
    size, half = (90, 120), np.tan(np.radians(50 / 2))
    picture = light.view(size, 50) / 2 - 1
    row, column = np.mgrid[:90, :120]
    x, y = (column + 0.5 - 60) / 45 * half, (45 - row - 0.5) / 45 * half
    azimuth = np.arctan2(x, -1) - np.radians(rotation)  # in the map
    np.testing.assert_allclose(picture[..., 0], np.sin(azimuth), atol=0.02)
    np.testing.assert_allclose(picture[..., 1], np.cos(azimuth), atol=0.02)
    np.testing.assert_allclose(picture[..., 2], y / np.sqrt(x**2 + y**2 + 1), atol=0.02)


def test_what_a_camera_sees_is_what_lights():
    pixels = np.full((ROWS, COLUMNS, 3), 0.1, np.float32)
    pixels[ROWS // 2 - 6 : ROWS // 2 - 4, 4:6] = 50  # behind, a little to image right, a little up
    light = EnvironmentLight(pixels)
    directions, intensities = light.samples()
    lamp = directions[intensities[:, 0] > intensities.max() / 2].mean(axis=0)
    picture = light.view((200, 200), 60)[..., 0] > 25
    row, column = np.argwhere(picture).mean(axis=0)
    seen = np.array([(column - 99.5) / 100, (99.5 - row) / 100]) * np.tan(np.radians(30))
    np.testing.assert_allclose(seen, lamp[:2] / -lamp[2], atol=0.01)


def test_a_view_neither_flickers_nor_shows_pixels():
    fine = np.zeros((256, 512, 3), np.float32)
    fine[::2] = 1
    np.testing.assert_allclose(EnvironmentLight(fine).view((12, 12), 120)[3:9], 0.5, atol=0.06)
    coarse = np.random.default_rng(0).random((16, 32, 3), np.float32)
    assert np.abs(np.diff(EnvironmentLight(coarse).view((300, 300), 40), axis=0)).max() < 0.04


def test_view_names_what_is_wrong():
    light = EnvironmentLight(np.ones((4, 8, 3)))
    with pytest.raises(
        ValueError, match=r"field_of_view: expected a number of degrees from 0\.001 to 170, got 180"
    ):
        light.view((9, 9), 180)
    with pytest.raises(ValueError, match="size: expected"):
        light.view((0, 9))


def test_a_map_is_a_file_or_an_array(tmp_path):
    pixels = np.clip(studio(), 0, None)
    relight.write(tmp_path / "map.exr", pixels, depth="float")
    relight.write(tmp_path / "map.hdr", pixels)
    expected = EnvironmentLight(pixels).samples()[1].sum(axis=0)
    for name, tolerance in (("map.exr", 1e-6), ("map.hdr", 0.02)):  # RGBE shares an exponent among channels
        light = EnvironmentLight(tmp_path / name)
        np.testing.assert_allclose(light.samples()[1].sum(axis=0), expected, rtol=tolerance)
    opaque = np.concatenate([pixels, np.ones((ROWS, COLUMNS, 1), np.float32)], axis=-1)
    np.testing.assert_array_equal(EnvironmentLight(opaque).samples()[1].sum(axis=0), expected)
    assert EnvironmentLight(str(tmp_path / "map.exr")) == EnvironmentLight(tmp_path / "map.exr")


def test_a_file_that_changes_is_read_again(tmp_path):
    path = tmp_path / "map.exr"
    relight.write(path, np.ones((4, 8, 3), np.float32))
    before = EnvironmentLight(path).samples()[1].sum()
    relight.write(path, np.full((4, 8, 3), 2.0, np.float32))
    assert EnvironmentLight(path).samples()[1].sum() == pytest.approx(2 * before)


def test_darkness_is_a_light_too():
    directions, intensities = EnvironmentLight(np.zeros((ROWS, COLUMNS, 3))).samples()
    assert intensities.sum() == 0
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)


@pytest.mark.parametrize(
    ("image", "arguments", "error", "message"),
    [
        (np.zeros((4, 4, 3)), {}, ValueError, "image: expected a map twice as wide as high, got 4 x 4"),
        (np.zeros((4, 8)), {}, ValueError, r"image: expected shape \(H, W, 3\)"),
        (np.full((4, 8, 3), np.nan), {}, ValueError, "image: contains NaN or infinite"),
        (np.full((4, 8, 3), np.inf), {}, ValueError, "image: contains NaN or infinite"),
        (np.full((4, 8, 3), -1.0), {}, ValueError, "image: holds negative light, -1 in row 0, column 0"),
        (np.zeros((4, 8, 3), int), {}, TypeError, "image: expected uint8"),
        ("gone.exr", {}, FileNotFoundError, "gone.exr: no such file"),
        (np.zeros((4, 8, 3)), {"rotation": np.inf}, ValueError, "rotation: expected a finite number"),
        (np.zeros((4, 8, 3)), {"intensity": -1}, ValueError, "intensity: expected a number of at least 0"),
        (np.zeros((4, 8, 3)), {"name": ""}, ValueError, "name: expected a non-empty text"),
    ],
)
def test_an_environment_light_refuses_invalid_maps_and_settings(image, arguments, error, message):
    with pytest.raises(error, match=message):
        EnvironmentLight(image, **arguments)


def test_a_bad_file_is_named(tmp_path):
    relight.write(tmp_path / "square.exr", np.ones((8, 8, 3), np.float32))
    with pytest.raises(ValueError, match=r"square\.exr: expected a map twice as wide as high, got 8 x 8"):
        EnvironmentLight(tmp_path / "square.exr")


def test_text_gives_an_environment_and_what_is_not_understood_is_named(tmp_path):
    path = tmp_path / "sky, noon.exr"
    relight.write(path, np.ones((4, 8, 3), np.float32))
    assert EnvironmentLight.parse(str(path)) == EnvironmentLight(path, name="environment")
    light = EnvironmentLight.parse(f"{path},rotation=-90,intensity=2,colour=1/0.5/1,name=sky")
    assert light == EnvironmentLight(path, rotation=-90, intensity=2, colour=(1, 0.5, 1), name="sky")
    for text, message in [
        (f"{path},turn=3", "turn: not known; expected image, rotation"),
        (f"{path},rotation=east", "rotation: expected a number of degrees, got 'east'"),
        (f"{path},exposure=99", "exposure: expected a number of stops from -64 to 64"),
    ]:
        with pytest.raises(ValueError, match=message):
            EnvironmentLight.parse(text)
