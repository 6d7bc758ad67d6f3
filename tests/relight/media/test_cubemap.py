"""Cube strips and crosses as environments: each face is where its convention says."""

import numpy as np
import pytest
from helpers.stored import store

import relight
from relight.media.cubemap import is_cube, to_latlong

SIDE = 32
# What is seen in the direction of each axis: its colour falls from the middle of the face to its edges.
COLOURS = {
    "+x": (1, 0, 0),
    "-x": (0, 1, 1),
    "+y": (0, 1, 0),
    "-y": (1, 0, 1),
    "+z": (0, 0, 1),
    "-z": (1, 1, 0),
}


def face(name):
    """A face whose lower half is darker, to tell its top."""
    picture = np.tile(np.float32(COLOURS[name]), (SIDE, SIDE, 1))
    picture[SIDE // 2 :] *= 0.5
    return picture


def cross(rows, columns, cells):
    whole = np.zeros((rows * SIDE, columns * SIDE, 3), np.float32)
    for (row, column), picture in cells.items():
        whole[row * SIDE : (row + 1) * SIDE, column * SIDE : (column + 1) * SIDE] = picture
    return whole


SIDES = {(0, 1): face("+y"), (1, 0): face("+x"), (1, 1): face("+z"), (1, 2): face("-x"), (2, 1): face("-y")}
GL = ("-x", "+x", "+y", "-y", "+z", "-z")  # in our frame, whose +x is at the left of the front
LAYOUTS = {
    "horizontal cross": cross(3, 4, SIDES | {(1, 3): face("-z")}),
    "vertical cross": cross(4, 3, SIDES | {(3, 1): face("-z")[::-1, ::-1]}),
    "horizontal strip": np.concatenate([face(name) for name in GL], axis=1),
    "vertical strip": np.concatenate([face(name) for name in GL]),
}


def seen(latlong, x, y, z):
    """The colour of a map in a direction."""
    height = len(latlong)
    row = (0.5 - np.arcsin(y / np.linalg.norm([x, y, z])) / np.pi) * height
    column = (0.5 - np.arctan2(x, z) / (2 * np.pi)) * 2 * height
    return latlong[int(min(row, height - 1)), int(column) % (2 * height)]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_faces_are_where_they_belong(layout):
    found = to_latlong(LAYOUTS[layout])
    assert found.shape == (2 * SIDE, 4 * SIDE, 3)
    for axis, name in enumerate("xyz"):
        for sign in (1, -1):
            direction = np.zeros(3)
            direction[axis] = sign
            colour = COLOURS[f"{'+' if sign > 0 else '-'}{name}"]
            if name == "y":  # toward the front is the lower side of the top, and the upper of the bottom
                lower, upper = (1, -1) if sign > 0 else (-1, 1)
                np.testing.assert_allclose(seen(found, *(direction + [0, 0, 0.5 * upper])), colour, atol=1e-5)
                dark = seen(found, *(direction + [0, 0, 0.5 * lower]))
            else:
                np.testing.assert_allclose(seen(found, *(direction + [0, 0.5, 0])), colour, atol=1e-5)
                dark = seen(found, *(direction - [0, 0.5, 0]))
            np.testing.assert_allclose(dark, 0.5 * np.float32(colour), atol=1e-5)


def test_a_strip_of_openexr_has_its_own_order(tmp_path):
    faces = [face(name) for name in COLOURS]  # +x, which is at the left of +z, first
    store(tmp_path / "a.exr", np.concatenate(faces), "half", envmap="cubemap")
    light = relight.EnvironmentLight(tmp_path / "a.exr")
    latlong = light.image.pixels
    for name, direction in {"+x": (1, 0.4, 0), "-x": (-1, 0.4, 0), "+z": (0, 0.4, 1)}.items():
        np.testing.assert_allclose(seen(latlong, *direction), COLOURS[name], atol=1e-3)
    np.testing.assert_allclose(seen(latlong, 0, 1, 0.5), COLOURS["+y"], atol=1e-3)  # its top is toward +z
    np.testing.assert_allclose(seen(latlong, 0, 1, -0.5), 0.5 * np.float32(COLOURS["+y"]), atol=1e-3)


def test_a_cube_lights_as_its_map_does():
    sky = np.ones((SIDE, 6 * SIDE, 3), np.float32)
    total = relight.EnvironmentLight(sky).samples()[1].sum(axis=0)
    np.testing.assert_allclose(total, 4, rtol=1e-3)


def test_a_photograph_of_four_to_three_is_no_cross():
    photograph = np.random.default_rng(1).uniform(0, 1, (96, 128, 3)).astype(np.float32)
    assert not is_cube(photograph)
    with pytest.raises(ValueError, match="expected a map twice as wide as high, got 128 x 96 pixels; or six"):
        relight.EnvironmentLight(photograph)


def test_the_colour_space_of_an_environment_can_be_said(tmp_path):
    store(tmp_path / "a.exr", np.ones((8, 16, 3), np.float32) * [1, 0, 0], "float")
    light = relight.EnvironmentLight.parse(f"{tmp_path / 'a.exr'},colour_space=ACEScg")
    np.testing.assert_allclose(light.image.pixels[0, 0], (1.705, -0.130, -0.024), atol=2e-3)
    relight.write_lights(tmp_path / "a.yaml", [light])
    again = relight.read_lights(tmp_path / "a.yaml")[0]
    assert again.colour_space == "ACEScg"
    np.testing.assert_array_equal(again.image.pixels, light.image.pixels)
    with pytest.raises(ValueError, match="colour_space: is that of a file"):
        relight.EnvironmentLight(np.ones((8, 16, 3), np.float32), colour_space="ACEScg")


def test_an_environment_may_be_a_layer(tmp_path):
    sky = np.ones((8, 16, 3), np.float32) * [1, 0.5, 0.25]
    relight.write(tmp_path / "a.exr", np.zeros_like(sky), layers={"sky": sky}, depth="float")
    light = relight.EnvironmentLight.parse(f"{tmp_path / 'a.exr'}:sky,rotation=90")
    np.testing.assert_allclose(light.image.pixels, sky)
    relight.write_lights(tmp_path / "a.yaml", [light])
    np.testing.assert_allclose(relight.read_lights(tmp_path / "a.yaml")[0].image.pixels, sky)
    with pytest.raises(FileNotFoundError, match=r"b\.exr: no such file"):
        relight.EnvironmentLight(f"{tmp_path / 'b.exr'}:sky")
