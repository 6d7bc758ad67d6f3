"""A white diffuse sphere in each light: UsdLux's definition, integrated numerically, against our lights."""

import numpy as np
import pytest
from helpers import usdlux

import relight
from relight.scene import lights as scene_lights

pxr = pytest.importorskip("pxr")


@pytest.fixture(scope="module")
def normals():
    return usdlux.normals()


def check(folder, case, normals):
    text, expected = case
    (light,) = scene_lights.read_lights(usdlux.stage(folder, text))
    found, expected = usdlux.ours(light, normals), expected(normals)
    error = np.sqrt(((found[:, 0] - expected) ** 2).mean()) / expected.max()
    assert error < 0.01
    assert abs(found[:, 0].mean() / expected.mean() - 1) < 0.01


@pytest.mark.parametrize("normalize", [False, True])
@pytest.mark.parametrize("angle", [0.53, 40, 120])
def test_a_distant_light_gives_the_irradiance_that_usdlux_defines(tmp_path, normals, angle, normalize):
    check(tmp_path, usdlux.distant(angle, normalize), normals[:60])


@pytest.mark.parametrize("normalize", [False, True])
def test_a_sphere_light_gives_the_irradiance_that_usdlux_defines(tmp_path, normals, normalize):
    check(tmp_path, usdlux.sphere(normalize), normals)


@pytest.mark.parametrize("normalize", [False, True])
@pytest.mark.parametrize("kind", ["RectLight", "DiskLight"])
def test_rectangles_and_disks_give_the_irradiance_that_usdlux_defines(tmp_path, normals, kind, normalize):
    check(tmp_path, usdlux.flat(kind, normalize), normals)


def test_a_dome_lights_the_side_that_its_brightest_texel_faces(tmp_path, normals):
    """One bright texel in a known direction of the world lights that side of a sphere."""
    pixels = np.full((64, 128, 3), 0.05, np.float32)
    row, column = 20, 32
    pixels[row, column] = 400
    relight.write(tmp_path / "sky.exr", pixels)
    (light,) = scene_lights.read_lights(
        usdlux.stage(
            tmp_path,
            """def DomeLight "sky" {
            asset inputs:texture:file = @./sky.exr@
            float3 xformOp:rotateXYZ = (25, 70, 0)
            uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
            }""",
        )
    )
    # OpenEXR: latitude falls along a column, longitude along a row; longitude 90 degrees is +x.
    latitude = np.pi / 2 - (np.arange(64) + 0.5) * np.pi / 64
    longitude = np.pi - (np.arange(128) + 0.5) * 2 * np.pi / 128
    lat, lon = np.meshgrid(latitude, longitude, indexing="ij")
    directions = np.stack([np.cos(lat) * np.sin(lon), np.sin(lat), np.cos(lat) * np.cos(lon)], axis=-1)
    turn = usdlux.turned(25, 70)
    world = directions.reshape(-1, 3) @ turn.T
    weights = (pixels[..., 0] * np.cos(lat)).ravel() * (np.pi / 64) ** 2
    expected = (normals @ world.T).clip(0) @ weights / np.pi
    found = usdlux.ours(light, normals)
    brightest = normals[found[:, 0].argmax()]
    assert brightest @ (turn @ directions[row, column]) > 0.97
    error = np.sqrt(((found[:, 0] - expected) ** 2).mean()) / expected.max()
    assert error < 0.02  # the map is resampled, and its pixels are as large as the light
