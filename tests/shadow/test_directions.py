import numpy as np
import pytest

from shadow import directions


@pytest.mark.parametrize(
    ("azimuth", "elevation", "vector"),
    [(0, 0, [0, 0, 1]), (90, 0, [1, 0, 0]), (-90, 0, [-1, 0, 0]), (0, 90, [0, 1, 0]), (180, 0, [0, 0, -1])],
)
def test_azimuth_and_elevation_of_the_axes(azimuth, elevation, vector):
    np.testing.assert_allclose(directions.from_spherical(azimuth, elevation), vector, atol=1e-6)


def test_spherical_round_trip():
    azimuth, elevation = np.meshgrid(np.linspace(-170, 170, 12), np.linspace(-80, 80, 9))
    back = directions.to_spherical(directions.from_spherical(azimuth, elevation))
    np.testing.assert_allclose(back, [azimuth, elevation], atol=1e-3)


def test_other_axes_are_turned_to_the_cameras():
    toward_camera, up = np.float32([0, 0, 1]), np.float32([0, 1, 0])
    np.testing.assert_array_equal(directions.from_axes(directions.CAMERA), np.eye(3))
    # OpenCV: y down, z into the scene. What faces its camera has z = -1, what faces up y = -1.
    np.testing.assert_array_equal(directions.from_axes("+x-y-z") @ [0, 0, -1], toward_camera)
    np.testing.assert_array_equal(directions.from_axes("+x-y-z") @ [0, -1, 0], up)
    # A world with z up, seen along its +y: facing the camera is -y.
    np.testing.assert_array_equal(directions.from_axes("+x-z+y") @ [0, -1, 0], toward_camera)
    np.testing.assert_array_equal(directions.from_axes("+x-z+y") @ [0, 0, 1], up)


@pytest.mark.parametrize("axes", ["xyz", "+x+y", "+x+y+x", "+X+Y+Z", "+x+y+z ", "", None])
def test_unknown_axes_are_named(axes):
    with pytest.raises(ValueError, match="axes: expected each of x, y and z once, signed"):
        directions.from_axes(axes)


def test_the_olat_set_has_64_directions_in_front_and_32_behind():
    front, whole = directions.olat(), directions.olat(behind=True)
    assert front.shape == (64, 3)
    assert whole.shape == (96, 3)
    np.testing.assert_array_equal(whole[:64], front)
    assert (front[:, 2] > 0).all()
    assert (whole[64:, 2] < 0).all()
    np.testing.assert_allclose(np.linalg.norm(whole, axis=1), 1, atol=1e-6)


def test_olat_is_uniform():
    front = directions.olat()
    angles = np.degrees(np.arccos(np.clip(front @ front.T - 2 * np.eye(64), -1, 1)))
    nearest = angles.min(axis=1)
    # 64 equal caps of the hemisphere have a radius of 10 degrees.
    assert nearest.min() > 12
    assert nearest.max() < 22
    np.testing.assert_allclose(front.mean(axis=0), [0, 0, 0.5], atol=0.03)


@pytest.mark.parametrize(("behind", "back"), [(False, 0), (True, 16)])
def test_stratified_directions_differ_and_are_uniform(behind, back):
    drawn = [directions.stratified(48, np.random.default_rng(seed), behind) for seed in range(200)]
    for found in drawn:
        assert found.shape == (48, 3)
        assert found.dtype == np.float32
        assert (found[:, 2] < 0).sum() == back
        np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-6)
    assert abs(drawn[0] - drawn[1]).max() > 0.1
    np.testing.assert_array_equal(drawn[0], directions.stratified(48, np.random.default_rng(0), behind))
    front = np.concatenate([found[found[:, 2] > 0] for found in drawn])
    np.testing.assert_allclose(front.mean(axis=0), [0, 0, 0.5], atol=0.02)
    np.testing.assert_allclose((front**2).mean(axis=0), 1 / 3, atol=0.02)
