"""ICC profiles in photographs, made here so that curve, primaries and name are known."""

import io
import struct

import colour
import numpy as np
import OpenImageIO as oiio
import pytest
from helpers.icc_profiles import SRGB, icc_profile
from PIL import Image, ImageCms

import relight

CODES = np.uint8([[[200, 120, 40], [255, 255, 255], [90, 90, 90]]] * 8).repeat(4, axis=1)
LAB = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
IDENTITY = struct.pack(">4s4xI", b"curv", 0)


def power(exponent):
    return struct.pack(">4s4xIH2x", b"curv", 1, round(exponent * 256))


def table(function, size=1024):
    codes = np.rint(function(np.linspace(0, 1, size)) * 65535).astype(">u2")
    return struct.pack(">4s4xI", b"curv", size) + codes.tobytes()


@pytest.mark.parametrize(
    ("description", "curve", "primaries", "space"),
    [
        ("sRGB IEC61966-2.1", table(colour.models.eotf_sRGB), "sRGB", "sRGB"),
        ("some camera", SRGB, "sRGB", "sRGB"),
        ("GIMP built-in Linear sRGB", IDENTITY, "sRGB", "lin_rec709"),
        ("sRGB-elle-V2-g10.icc", power(1), "sRGB", "lin_rec709"),
        ("sRGB-elle-V4-g22.icc", power(2.19921875), "sRGB", "g22_rec709_scene"),
        ("Display P3", SRGB, "Display P3", "srgb_p3d65_scene"),
        ("Adobe RGB (1998)", power(2.19921875), "Adobe RGB (1998)", "g22_adobergb_scene"),
        ("Rec2020-elle-V4-g10", IDENTITY, "ITU-R BT.2020", "lin_rec2020"),
    ],
)
@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif"])
def test_a_profile_counts_by_its_curve_and_primaries_not_its_name(
    tmp_path, name, description, curve, primaries, space
):
    profile = icc_profile(description, curve, primaries)
    assert ImageCms.getProfileDescription(ImageCms.ImageCmsProfile(io.BytesIO(profile)))
    Image.fromarray(CODES).save(tmp_path / name, icc_profile=profile)
    expected = relight.read(tmp_path / name, colour_space=space)
    found = relight.read(tmp_path / name)
    np.testing.assert_allclose(found, expected, atol=2e-3)
    if space == "sRGB":  # exact, like a file without a profile
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(("curve", "space"), [(IDENTITY, "lin_rec709"), (power(1.8), None), (SRGB, "sRGB")])
def test_grey_pictures_have_profiles_too(tmp_path, curve, space):
    codes = np.linspace(0, 255, 64).astype(np.uint8).reshape(8, 8)
    profile = icc_profile("grey", curve, kind=b"GRAY")
    Image.fromarray(codes).save(tmp_path / "a.png", icc_profile=profile)
    found = relight.read(tmp_path / "a.png")
    expected = (codes / 255) ** 1.8 if space is None else relight.read(tmp_path / "a.png", colour_space=space)
    np.testing.assert_allclose(found, np.broadcast_to(expected.reshape(8, 8, -1), (8, 8, 3)), atol=2e-3)


def test_straight_alpha_stays_beside_a_profile(tmp_path):
    codes = np.dstack([CODES, np.full(CODES.shape[:2], 128, np.uint8)])
    Image.fromarray(codes).save(tmp_path / "a.png", icc_profile=icc_profile("linear", IDENTITY))
    found = relight.read(tmp_path / "a.png")
    np.testing.assert_allclose(found[..., 3], 128 / 255, atol=1e-6)
    np.testing.assert_allclose(found[..., :3], CODES / 255 * (128 / 255), atol=1e-4)


def test_floats_beyond_white_are_decoded_where_the_curve_goes_on(tmp_path):
    light = np.full((4, 4, 3), (4.0, 0.5, 0.1), np.float32)
    for name, curve in (("linear.tif", IDENTITY), ("power.tif", power(2)), ("table.tif", table(np.square))):
        spec = oiio.ImageSpec(4, 4, 3, "float")
        profile = np.frombuffer(icc_profile("p", curve, "ITU-R BT.2020"), np.uint8)
        spec.attribute("ICCProfile", oiio.TypeDesc(f"uint8[{len(profile)}]"), profile)
        file = oiio.ImageOutput.create(name)
        assert file.open(str(tmp_path / name), spec)
        assert file.write_image(light)
        file.close()
    expected = relight.read(tmp_path / "linear.tif", colour_space="lin_rec2020")
    np.testing.assert_allclose(relight.read(tmp_path / "linear.tif"), expected, atol=2e-3)
    squared = colour.matrix_RGB_to_RGB("ITU-R BT.2020", "ITU-R BT.709", "Bradford") @ light[0, 0] ** 2
    np.testing.assert_allclose(relight.read(tmp_path / "power.tif")[0, 0], squared, rtol=2e-3, atol=5e-3)
    with pytest.raises(ValueError, match=r"table\.tif: its colour profile says nothing of values outside"):
        relight.read(tmp_path / "table.tif")


@pytest.mark.parametrize(
    ("function", "numbers", "expected"),
    [
        (0, (2,), lambda x: x**2),
        (1, (2, 1.25, -0.25), lambda x: np.where(x >= 0.2, (1.25 * x - 0.25) ** 2, 0)),
        (2, (2, 1, -0.25, 0.4375), lambda x: np.where(x >= 0.25, (x - 0.25) ** 2, 0) + 0.4375),
        (4, (2, 1, 0, 0.5, 0.25, 0, 0.125), lambda x: np.where(x >= 0.25, x**2, 0.5 * x + 0.125)),
    ],
)
def test_parametric_curves(tmp_path, function, numbers, expected):
    curve = struct.pack(
        f">4s4xH2x{len(numbers)}i", b"para", function, *(round(value * 65536) for value in numbers)
    )
    codes = np.linspace(0, 255, 64).astype(np.uint8).reshape(8, 8)
    Image.fromarray(codes).save(tmp_path / "a.tif", icc_profile=icc_profile("p", curve, kind=b"GRAY"))
    np.testing.assert_allclose(relight.read(tmp_path / "a.tif")[..., 0], expected(codes / 255), atol=1e-4)


@pytest.mark.parametrize(
    ("profile", "message"),
    [
        (LAB, "is of Lab, not of RGB"),
        (icc_profile("cut", SRGB)[:135], "is damaged"),
        (icc_profile("cut", SRGB)[:400], "is damaged"),
        (icc_profile("odd", b"curx" + IDENTITY[4:]), "has a tone curve of an unknown kind"),
        (icc_profile("odd", struct.pack(">4s4xH10x", b"para", 9)), "has a tone curve of an unknown kind"),
        (icc_profile("tables", SRGB).replace(b"gTRC", b"A2B0"), "has a colour table that is damaged"),
        (icc_profile("no green", SRGB).replace(b"gTRC", b"xTRC"), "is not made of curves and primaries"),
    ],
)
def test_profiles_that_cannot_be_used_are_named(tmp_path, profile, message):
    Image.new("RGB", (8, 8)).save(tmp_path / "a.tif", icc_profile=profile)
    with pytest.raises(
        ValueError, match=rf"a\.tif: its colour profile {message}; say which colour_space it is"
    ):
        relight.read(tmp_path / "a.tif")
    assert relight.read(tmp_path / "a.tif", colour_space="sRGB").shape == (8, 8, 3)
