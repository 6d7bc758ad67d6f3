import numpy as np
import pytest

import relight
from relight import EnvironmentLight

GREY = 0.18


def landscape(size=(120, 180), sky=0.5, ground=0.2):
    """A plate: a bluish sky that is brighter to the right, over a brownish ground."""
    height, width = size
    slope = np.linspace(0.6, 1.4, width)[None, :, None]
    rows = np.where(np.arange(height)[:, None, None] < height / 2, sky * slope, ground)
    tint = np.where(np.arange(height)[:, None, None] < height / 2, (0.8, 1, 1.2), (1.1, 1, 0.8))
    return np.float32(rows * tint)


def irradiance(light, normals):
    directions, intensities = light.samples()
    return np.maximum(np.asarray(normals, float) @ directions.T, 0) @ intensities


@pytest.mark.parametrize(("size", "field_of_view"), [((120, 180), 40), ((90, 60), 25), ((60, 160), 75)])
def test_the_camera_sees_the_plate_again(size, field_of_view):
    plate = landscape(size)
    plate[size[0] // 3 : size[0] // 2, size[1] // 8 : size[1] // 4] = (0.7, 0.1, 0.05)  # at image left
    seen = EnvironmentLight.from_plate(plate, field_of_view).view(size, field_of_view)
    error = np.abs(seen - plate).mean(axis=-1)
    assert np.median(error) < 0.002
    assert error.mean() < 0.01  # edges are resampled twice


def test_light_comes_from_where_the_plate_is_bright():
    light = EnvironmentLight.from_plate(landscape(), 40)
    left, right, up, down, front = irradiance(
        light, [(-1, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)]
    ).mean(axis=1)
    assert right > 1.15 * left
    assert up > 2 * down
    assert left > down
    mirrored = EnvironmentLight.from_plate(landscape()[:, ::-1], 40)
    other = irradiance(mirrored, [(1, 0, 0), (-1, 0, 0)]).mean(axis=1)
    np.testing.assert_allclose(other, (left, right), rtol=0.03)
    assert front > down


@pytest.mark.parametrize("exposure", [0.3, 1.0])
def test_a_grey_card_on_the_ground_is_as_bright_as_the_ground(exposure):
    light = EnvironmentLight.from_plate(landscape() * exposure, 40)
    card = GREY * relight.media.colour.luminance(irradiance(light, [(0, 1, 0)]))
    np.testing.assert_allclose(
        card, 0.2 * exposure * relight.media.colour.luminance([1.1, 1, 0.8]), rtol=0.03
    )


def test_there_is_no_seam():
    """Around the plate, and where left and right meet before the person."""
    pixels = EnvironmentLight.from_plate(landscape(sky=0.2), 40).image.pixels
    steps = np.concatenate(
        [np.abs(np.diff(pixels, axis=1)).ravel(), np.abs(pixels[:, 0] - pixels[:, -1]).ravel()]
    )
    assert steps.max() < 0.03 * pixels.max()
    upward = np.abs(np.diff(pixels[: len(pixels) // 2 - 2], axis=0))  # the horizon is an edge
    assert upward.max() < 0.03 * pixels.max()


def test_clipped_highlights_are_as_bright_as_said():
    plate = np.uint8(np.full((120, 180, 3), 90))
    plate[20:40, 130:150] = 255
    lights = [EnvironmentLight.from_plate(plate, 40, highlights=times) for times in (1, 8)]
    plain, bright = (light.view((120, 180), 40) for light in lights)
    np.testing.assert_allclose(bright[30, 140], 8 * plain[30, 140], rtol=0.02)
    np.testing.assert_allclose(bright[80], plain[80], atol=1e-3)
    linear = relight.media.images.scene_linear("plate", plate) * np.float32(2)  # an HDR picture: not clipped
    np.testing.assert_allclose(
        EnvironmentLight.from_plate(linear, 40).view((120, 180), 40)[30, 140], 2, rtol=0.02
    )


def test_a_file_and_the_light_s_own_settings(tmp_path):
    plate = landscape()
    relight.write(tmp_path / "plate.exr", plate)
    of_file = EnvironmentLight.from_plate(tmp_path / "plate.exr", 40, exposure=1, name="street")
    assert of_file.name == "street"
    normals = [(1, 0, 0), (0, 1, 0)]
    np.testing.assert_allclose(
        irradiance(of_file, normals),
        2 * irradiance(EnvironmentLight.from_plate(plate, 40), normals),
        rtol=0.02,
    )


@pytest.mark.parametrize(
    ("plate", "settings", "message"),
    [
        (np.full((8, 8, 3), np.nan), {}, "background: contains NaN"),
        (np.ones((8, 8)), {}, "background: expected shape"),
        (np.full((8, 8, 4), 0.5), {}, "background: expected an opaque picture, got one with transparent"),
        (np.ones((8, 8, 3)), {"field_of_view": 0}, "field_of_view: expected"),
        (np.ones((8, 8, 3)), {"field_of_view": 171}, "field_of_view: expected"),
        (np.ones((8, 8, 3)), {"highlights": 0.5}, "highlights: expected"),
    ],
)
def test_from_plate_refuses_invalid_plates_and_settings(plate, settings, message):
    with pytest.raises(ValueError, match=message):
        EnvironmentLight.from_plate(plate, **settings)


@pytest.mark.parametrize("plate", [np.zeros((8, 8, 3)), np.full((1, 1, 3), 0.2), np.full((3, 90, 3), 0.2)])
def test_black_tiny_and_narrow_plates_give_finite_lights(plate):
    _, intensities = EnvironmentLight.from_plate(plate, 40).samples()
    assert np.isfinite(intensities).all()
