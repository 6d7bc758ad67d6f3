import os

import numpy as np
import pytest
from helpers.stored import PREMULTIPLIED, STRAIGHT, store
from PIL import Image

import relight

# Masks


def test_masks_are_coverage_not_colour(tmp_path):
    grey = STRAIGHT[..., :1]
    store(tmp_path / "m.png", grey, "uint8")
    mask = relight.read_mask(tmp_path / "m.png")
    assert mask.shape == (24, 32)
    np.testing.assert_allclose(mask, grey[..., 0], atol=0.5 / 255 + 1e-6)


def test_masks_from_alpha_and_from_opaque_grey(tmp_path):
    store(tmp_path / "a.png", STRAIGHT, "uint16", oiio__UnassociatedAlpha=1)
    np.testing.assert_allclose(relight.read_mask(tmp_path / "a.png"), STRAIGHT[..., 3], atol=1e-5)
    opaque = np.concatenate([STRAIGHT[..., :1].repeat(3, -1), np.ones((24, 32, 1), np.float32)], -1)
    store(tmp_path / "b.png", opaque, "uint16", oiio__UnassociatedAlpha=1)
    np.testing.assert_allclose(relight.read_mask(tmp_path / "b.png"), STRAIGHT[..., 0], atol=1e-5)
    store(tmp_path / "c.png", STRAIGHT[..., :3], "uint8")
    with pytest.raises(ValueError, match="expected a mask"):
        relight.read_mask(tmp_path / "c.png")


@pytest.mark.parametrize("mode", ["L", "P", "RGBA"])
@pytest.mark.parametrize("frames", [1, 2])
def test_a_gif_is_a_mask_too(tmp_path, mode, frames):
    picture = Image.fromarray(np.uint8(STRAIGHT[..., 0] > 0.5) * 255).convert(mode)
    picture.save(tmp_path / "m.gif", save_all=True, append_images=[picture.rotate(180)] * (frames - 1))
    np.testing.assert_array_equal(relight.read_mask(tmp_path / "m.gif"), STRAIGHT[..., 0] > 0.5)


# Normal maps


def sphere_normals():
    """Unit vectors (24, 32, 3) of a ball, zero around it."""
    y, x = np.mgrid[1:-1:24j, -1:1:32j] * 1.2
    z = np.sqrt(np.clip(1 - x**2 - y**2, 0, None))
    return (np.stack([x, y, z], axis=-1) * (z > 0.1)[..., None]).astype(np.float32)


@pytest.mark.parametrize("background", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(("depth", "tolerance"), [("uint8", 0.01), ("uint16", 1e-4)])
def test_normals_of_integers_are_not_colour(tmp_path, depth, tolerance, background):
    normals = sphere_normals()
    known = normals.any(axis=-1, keepdims=True)
    codes = np.where(known, normals * 0.5 + 0.5, background).astype(np.float32)
    store(tmp_path / "n.png", codes, depth, oiio__ColorSpace="srgb_rec709_scene")
    found = relight.read_normals(tmp_path / "n.png")
    np.testing.assert_allclose(found, normals, atol=tolerance)
    assert found.dtype == np.float32
    assert not found[~known[..., 0]].any()


@pytest.mark.parametrize("names", ["RGB", "XYZ", ("N.R", "N.G", "N.B"), ("N.X", "N.Y", "N.Z")])
def test_normals_of_floats_are_signed(tmp_path, names):
    normals = sphere_normals()
    ap1 = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)  # of the render; vectors have none
    store(tmp_path / "n.exr", 0.9 * normals, "float", channelnames=tuple(names), chromaticities=ap1)
    layer = None if isinstance(names, str) else "N"
    np.testing.assert_allclose(relight.read_normals(tmp_path / "n.exr", layer=layer), normals, atol=1e-6)


def test_normals_of_our_own_layer(tmp_path):
    relight.write(tmp_path / "l.exr", PREMULTIPLIED, layers={"N": sphere_normals()}, depth="float")
    np.testing.assert_allclose(
        relight.read_normals(tmp_path / "l.exr", layer="N"), sphere_normals(), atol=1e-6
    )


def test_normals_in_opencvs_axes(tmp_path):
    normals = sphere_normals()
    store(tmp_path / "n.exr", normals * np.float32([1, -1, -1]), "float")
    np.testing.assert_allclose(relight.read_normals(tmp_path / "n.exr", axes="+x-y-z"), normals, atol=1e-6)


def test_bad_normal_maps_are_named(tmp_path):
    normals = sphere_normals()
    store(tmp_path / "encoded.exr", np.where(normals, normals * 0.5 + 0.5, 0), "float")
    with pytest.raises(ValueError, match=r"holds floats in \[0, 1\], expected signed normals"):
        relight.read_normals(tmp_path / "encoded.exr")
    store(tmp_path / "grey.png", np.full((4, 4, 1), 0.5, np.float32), "uint8")
    with pytest.raises(ValueError, match="expected channels R, G, B or X, Y, Z; got Y"):
        relight.read_normals(tmp_path / "grey.png")
    store(tmp_path / "black.exr", 0 * normals, "float")
    with pytest.raises(ValueError, match="holds no vector of about unit length"):
        relight.read_normals(tmp_path / "black.exr")
    store(tmp_path / "n.exr", normals, "float")
    with pytest.raises(ValueError, match=r"n\.exr: layer: the file has no layers, got 'N'"):
        relight.read_normals(tmp_path / "n.exr", layer="N")
    with pytest.raises(ValueError, match="axes: expected each of x, y and z once"):
        relight.read_normals(tmp_path / "n.exr", axes="+x+y+y")


@pytest.mark.parametrize(
    ("name", "tolerance"), [("m.png", 1e-5), ("m.tif", 1e-5), ("m.exr", 5e-4), ("M.TIFF", 1e-5)]
)
def test_masks_are_written_and_read_back(tmp_path, name, tolerance):
    relight.write_mask(tmp_path / name, STRAIGHT[..., 3])
    np.testing.assert_allclose(relight.read_mask(tmp_path / name), STRAIGHT[..., 3], atol=tolerance)
    codes = (STRAIGHT[..., 3] * 255).astype(np.uint8)
    relight.write_mask(tmp_path / name, codes)
    np.testing.assert_allclose(relight.read_mask(tmp_path / name), codes / 255, atol=tolerance)


@pytest.mark.parametrize(
    ("name", "mask", "arguments", "error", "message"),
    [
        ("m.jpg", STRAIGHT[..., 3], {}, ValueError, "expected .png, .tif or .exr for a matte"),
        (
            "m.png",
            STRAIGHT[..., 3],
            {"depth": "half"},
            ValueError,
            "depth: expected uint8 or uint16 for .png",
        ),
        ("m.png", STRAIGHT, {}, ValueError, r"mask: expected shape \(H, W\), got \(24, 32, 4\)"),
        ("m.png", STRAIGHT[..., 3] + 1, {}, ValueError, r"mask: expected values in \[0, 1\]"),
        ("m.png", np.full((3, 3), np.nan), {}, ValueError, r"mask: expected values in \[0, 1\]"),
        ("m.png", np.zeros((3, 3), int), {}, TypeError, "mask: expected uint8, uint16 or a floating dtype"),
    ],
)
def test_bad_masks_are_named(tmp_path, name, mask, arguments, error, message):
    with pytest.raises(error, match=message):
        relight.write_mask(tmp_path / name, mask, **arguments)
    assert os.listdir(tmp_path) == []
