"""Parts, layers, primaries and pixel shapes of OpenEXR, and what callers know better than a file."""

import numpy as np
import OpenImageIO as oiio
import pytest
from helpers.foreign_files import decode_srgb, disc, parts, png, ramp, unsigned_exr
from helpers.refusals import first_line
from helpers.stored import store

import relight
from relight.media import images

LIGHT = decode_srgb(ramp() / 255).astype(np.float32)
RED = np.tile(np.uint8([255, 0, 0]), (8, 8, 1))


def test_object_numbers_of_an_exr(tmp_path):
    unsigned_exr(tmp_path / "a.exr", Y=disc() > 0)
    np.testing.assert_array_equal(relight.read_mask(tmp_path / "a.exr"), disc() > 0)
    unsigned_exr(tmp_path / "b.exr", **dict.fromkeys("RGB", disc() > 0))
    np.testing.assert_array_equal(relight.read_mask(tmp_path / "b.exr"), disc() > 0)
    assert "OpenEXR's UINT" in first_line(tmp_path / "b.exr")
    unsigned_exr(tmp_path / "c.exr", Y=np.arange(64).reshape(8, 8))
    assert "UINT with numbers up to 63" in first_line(tmp_path / "c.exr", relight.read_mask)


NORMALS = np.tile(np.float32([0, 0, 1]), (64, 64, 1))


def test_the_picture_of_several_parts_is_found_by_its_name(tmp_path):
    albedo = LIGHT / 2
    for name in ("C", "rgba", "beauty", "RGBA", "Ci", "ViewLayer.Combined"):
        parts(
            tmp_path / "a.exr",
            ("N", "RGB", NORMALS, {}), ("albedo", "RGB", albedo, {}), (name, "RGB", LIGHT, {}),
        )  # fmt: skip
        np.testing.assert_allclose(relight.read(tmp_path / "a.exr"), LIGHT, atol=1e-3)
        layers = relight.read_layers(tmp_path / "a.exr")
        assert {"N", "albedo"} <= layers.keys()
        np.testing.assert_allclose(layers["albedo"], albedo, atol=1e-3)
    np.testing.assert_allclose(relight.read(f"{tmp_path / 'a.exr'}:albedo"), albedo, atol=1e-3)
    np.testing.assert_allclose(relight.read(tmp_path / "a.exr", layer="Albedo"), albedo, atol=1e-3)
    np.testing.assert_array_equal(relight.read_normals(tmp_path / "a.exr", layer="N"), NORMALS)
    assert "layer: expected one of N, albedo" in first_line(tmp_path / "a.exr", layer="sky")


def test_parts_without_a_picture_are_named(tmp_path):
    parts(tmp_path / "a.exr", ("N", "RGB", NORMALS, {}), ("albedo", "RGB", LIGHT, {}))
    assert "the layers N, albedo; choose one with layer=" in first_line(tmp_path / "a.exr")


def test_layers_of_parts_have_the_names_of_their_channels(tmp_path):
    parts(
        tmp_path / "a.exr",
        ("rgba", "RGBA", np.dstack([LIGHT, disc() / 255]), {}),
        ("albedo", ("albedo.R", "albedo.G", "albedo.B"), LIGHT / 2, {}),
        ("N", ("N.X", "N.Y", "N.Z"), NORMALS, {}),
        ("depth", ("Z",), np.full((64, 64, 1), 3), {}),
    )
    assert relight.read(tmp_path / "a.exr").shape == (64, 64, 4)
    assert {name: layer.shape[-1] for name, layer in relight.read_layers(tmp_path / "a.exr").items()} == {
        "albedo": 3, "N": 3, "depth": 1,
    }  # fmt: skip
    np.testing.assert_array_equal(images.read_depth(tmp_path / "a.exr"), 3)
    np.testing.assert_array_equal(relight.read_mask(tmp_path / "a.exr"), disc() / 255 > 0)


def test_a_layer_of_one_part_can_be_chosen(tmp_path):
    relight.write(tmp_path / "a.exr", LIGHT, layers={"albedo": LIGHT / 2, "Z": np.ones((64, 64), np.float32)})
    np.testing.assert_allclose(relight.read(f"{tmp_path / 'a.exr'}:albedo"), LIGHT / 2, atol=1e-3)
    store(tmp_path / "b.exr", LIGHT, "half", channelnames=tuple(f"ViewLayer.Combined.{c}" for c in "RGB"))
    np.testing.assert_allclose(relight.read(tmp_path / "b.exr"), LIGHT, atol=1e-3)
    assert "only OpenEXR files have layers" in first_line(_png(tmp_path), layer="x")


def _png(folder):
    png(folder / "a.png", RED)
    return folder / "a.png"


def test_the_last_word_of_a_layer_is_enough(tmp_path):
    parts(
        tmp_path / "a.exr",
        ("a", [f"ViewLayer.DiffCol.{c}" for c in "RGB"], LIGHT / 2, {}),
        ("b", [f"ViewLayer.Combined.{c}" for c in "RGB"], LIGHT, {}),
    )
    np.testing.assert_allclose(relight.read(f"{tmp_path / 'a.exr'}:diffcol"), LIGHT / 2, atol=1e-3)


def test_vectors_are_no_picture(tmp_path):
    store(tmp_path / "a.exr", NORMALS, "half", channelnames=("N.X", "N.Y", "N.Z"))
    assert "expected channels R, G, B or Y" in first_line(tmp_path / "a.exr", layer="N")
    store(tmp_path / "b.exr", NORMALS, "half", channelnames=("X", "Y", "Z"))
    first_line(tmp_path / "b.exr")


def test_xyz_is_not_adapted_but_for_a_neutral(tmp_path):
    xyz = LIGHT @ np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]).T
    for third in (1 / 3, 0.333, 0.3333):
        store(tmp_path / "a.exr", xyz, "float", chromaticities=(1, 0, 0, 1, 0, 0, third, third))
        np.testing.assert_allclose(relight.read(tmp_path / "a.exr"), LIGHT, atol=4e-3)
    warm = (0.34567, 0.3585)
    spec = oiio.ImageSpec(4, 4, 3, "float")
    spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), (1, 0, 0, 1, 0, 0, 1 / 3, 1 / 3))
    spec.attribute("adoptedNeutral", oiio.TypeDesc("float2"), warm)
    buffer = oiio.ImageBuf(spec)
    white = (warm[0] / warm[1], 1, (1 - sum(warm)) / warm[1])
    oiio.ImageBufAlgo.fill(buffer, white)
    assert buffer.write(str(tmp_path / "b.exr"))
    np.testing.assert_allclose(relight.read(tmp_path / "b.exr"), 1, atol=1e-3)


def test_a_white_that_is_no_colour_is_refused(tmp_path):
    store(tmp_path / "a.exr", LIGHT, "half", adoptedNeutral=(0.3, 0.0))
    assert "its white is stated as 0.3, 0; say which colour_space" in first_line(tmp_path / "a.exr")


# Pixel shape


@pytest.mark.parametrize(("name", "aspect"), [("a.exr", 2.0), ("a.exr", 0.5), ("a.dpx", 2.0), ("a.tif", 1.5)])
def test_pixels_are_made_square(tmp_path, name, aspect):
    store(tmp_path / name, LIGHT, "half" if name.endswith("exr") else "uint16", PixelAspectRatio=aspect)
    with pytest.warns(
        UserWarning, match=rf"its pixels are {aspect:g} times as wide as high; it is read with sq"
    ):
        found = relight.read(tmp_path / name)
    height, width = found.shape[:2]
    assert width / height == pytest.approx(aspect, rel=0.01)
    assert min(height, width) == 64


def test_mattes_normals_and_depth_are_made_square_as_well(tmp_path):
    store(tmp_path / "m.exr", disc()[..., None] / 255, "half", channelnames=("Y",), PixelAspectRatio=2.0)
    store(tmp_path / "n.exr", NORMALS, "half", PixelAspectRatio=2.0)
    store(tmp_path / "z.exr", NORMALS[..., 2:], "float", channelnames=("Z",), PixelAspectRatio=2.0)
    with pytest.warns(UserWarning, match="square pixels"):
        assert relight.read_mask(tmp_path / "m.exr").shape == (64, 128)
    assert relight.read_normals(tmp_path / "n.exr").shape == (64, 128, 3)
    assert images.read_depth(tmp_path / "z.exr").shape == (64, 128)


# What callers know better


@pytest.mark.parametrize(("alpha", "expected"), [("straight", 0.25), ("premultiplied", 0.5)])
def test_alpha_can_be_said(tmp_path, alpha, expected):
    store(tmp_path / "a.exr", np.full((4, 4, 4), 0.5, np.float32), "half")
    assert relight.read(tmp_path / "a.exr", alpha=alpha)[0, 0, 0] == pytest.approx(expected, abs=1e-3)
    with pytest.raises(ValueError, match="alpha: expected straight or premultiplied, got 'both'"):
        relight.read(tmp_path / "a.exr", alpha="both")


def test_the_logarithmic_spaces_of_cameras_are_known(tmp_path, monkeypatch):
    monkeypatch.delenv("OCIO", raising=False)
    store(tmp_path / "a.dpx", np.full((4, 4, 3), 0.4, np.float32), "uint16")
    grey = relight.read(tmp_path / "a.dpx", colour_space="ARRI LogC3 (EI800)")
    assert 0.15 < grey.mean() < 0.25  # LogC3 puts grey of 0.18 at 0.391
    store(tmp_path / "b.dpx", np.full((4, 4, 3), 0.4, np.float32), "uint16", oiio__ColorSpace="KodakLog")
    assert "ocio://studio-config-latest" in first_line(tmp_path / "b.dpx")


@pytest.mark.parametrize("space", ["lin_rec709", "ACEScg", "ACES2065-1", "Rec.2020"])
def test_light_without_coverage_stays_in_every_linear_space(tmp_path, space):
    glow = np.full((4, 6, 4), 0.5, np.float32)
    glow[..., 3] = 0
    relight.write(tmp_path / "glow.exr", glow, colour_space=None if space == "lin_rec709" else space)
    np.testing.assert_allclose(relight.read(tmp_path / "glow.exr"), glow, atol=1e-3)
    forced = relight.read(tmp_path / "glow.exr", colour_space=space)
    assert forced[..., :3].max() > 0.4
