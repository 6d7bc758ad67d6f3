import numpy as np
import pytest

from relight import colour


def test_srgb_decodes_integers_exactly_as_floats():
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, -1)
    linear = colour.decode(codes, "sRGB")
    assert linear.dtype == np.float32
    np.testing.assert_allclose(linear, colour.decode(codes / np.float32(255), "sRGB"), atol=1e-7)
    assert linear[0, 0, 0] == 0
    assert linear[-1, -1, 0] == 1
    assert linear[8, 0, 0] == pytest.approx(((128 / 255 + 0.055) / 1.055) ** 2.4, abs=1e-6)  # IEC 61966-2-1


def test_every_16_bit_code_survives():
    codes = np.arange(65536, dtype=np.uint16).reshape(256, 256, 1).repeat(3, -1)
    encoded = colour.encode(colour.decode(codes, "sRGB"))
    np.testing.assert_array_equal(np.round(encoded * 65535).astype(np.uint16), codes)


def test_encode_clips_to_the_display():
    np.testing.assert_array_equal(colour.encode(np.array([[[-1.0, 0.0, 8.0]]])), [[[0, 0, 1]]])


def test_linear_is_left_alone():
    light = np.array([[[-0.5, 0.0, 1e4]]], np.float32)
    np.testing.assert_array_equal(colour.decode(light, "lin_rec709"), light)


def test_white_stays_white_from_other_primaries():
    np.testing.assert_allclose(colour.decode(np.ones((2, 2, 3), np.float32), "ACEScg"), 1, atol=1e-3)
    green = colour.decode(np.array([[[0.0, 1.0, 0.0]]], np.float32), "ACEScg")
    assert green[0, 0, 0] < -0.3  # outside Rec.709, and not clipped


def test_unknown_space_is_named():
    with pytest.raises(ValueError, match=r"colour_space: unknown 'bogus'"):
        colour.decode(np.zeros((1, 1, 3), np.float32), "bogus")


@pytest.mark.parametrize("kelvin", [1000, 2700, 6500, 40000])
def test_temperature_has_luminance_one(kelvin):
    assert colour.luminance(np.array(colour.temperature(kelvin))) == pytest.approx(1)


def test_temperature_runs_from_red_to_blue():
    red, _, blue = np.array([colour.temperature(k) for k in (2000, 4000, 6500, 10000)]).T
    assert (np.diff(red) < 0).all()
    assert (np.diff(blue) > 0).all()
    np.testing.assert_allclose(colour.temperature(6500), 1, atol=0.06)


@pytest.mark.parametrize("kelvin", [999, 40001, float("nan")])
def test_temperature_out_of_range(kelvin):
    with pytest.raises(ValueError, match="temperature: expected 1000 to 40000 kelvin"):
        colour.temperature(kelvin)
