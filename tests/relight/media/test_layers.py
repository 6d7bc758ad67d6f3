"""Layers of OpenEXR files, and channels that are neither red, green nor blue."""

import os
import struct
import warnings

import numpy as np
import OpenImageIO as oiio
import pytest
import torch
from helpers.stored import AP1, PREMULTIPLIED, STRAIGHT, store

import relight
from relight.media.content_hash import HASH_ATTRIBUTE
from relight.media.images import read_content_hash


def test_layers_come_back_under_their_names(tmp_path):
    layers = {
        "C_key": PREMULTIPLIED * 0.5,
        "C_fill light": PREMULTIPLIED * 2,
        "albedo": STRAIGHT[..., :3],
        "visibility_key": STRAIGHT[..., 0],
    }
    relight.write(tmp_path / "l.exr", PREMULTIPLIED, layers=layers, depth="float")
    np.testing.assert_array_equal(relight.read(tmp_path / "l.exr"), PREMULTIPLIED)
    names = oiio.ImageInput.open(str(tmp_path / "l.exr")).spec().channelnames
    assert names[:4] == ("R", "G", "B", "A")
    assert {"C_key.R", "C_key.A", "albedo.B", "visibility_key.Y"} <= set(names)
    back = relight.read_layers(tmp_path / "l.exr")
    assert set(back) == set(layers)
    for name, layer in layers.items():
        np.testing.assert_array_equal(back[name], layer.reshape(24, 32, -1))
    handed = {"C_key": torch.tensor(STRAIGHT), "C_fill": STRAIGHT.astype(">f4")}
    relight.write(tmp_path / "h.exr", PREMULTIPLIED, layers=handed, depth="float")
    for layer in relight.read_layers(tmp_path / "h.exr").values():
        np.testing.assert_array_equal(layer, STRAIGHT)


def test_names_that_openexr_gives_a_meaning_are_those_of_layers(tmp_path):
    layers = {"RGB": STRAIGHT[..., :3], "RGBA": STRAIGHT * 0.5, "a": STRAIGHT[..., 0], "a.Y": STRAIGHT}
    relight.write(tmp_path / "l.exr", PREMULTIPLIED, layers=layers, depth="float")
    names = ["RGB.R", "RGB.G", "RGB.B", *(f"RGBA.{c}" for c in "RGBA"), "a.Y", *(f"a.Y.{c}" for c in "RGBA")]
    file = oiio.ImageInput.open(str(tmp_path / "l.exr"))
    stored = dict(zip(file.spec().channelnames, file.read_image("float").transpose(2, 0, 1), strict=True))
    assert set(stored) == {*"RGBA", *names}
    expected = np.concatenate([layer.reshape(24, 32, -1) for layer in layers.values()], axis=-1)
    np.testing.assert_array_equal([stored[name] for name in names], expected.transpose(2, 0, 1))
    np.testing.assert_array_equal(relight.read(tmp_path / "l.exr"), PREMULTIPLIED)


def test_the_longest_names_come_back(tmp_path):
    name = "visibility_" + 80 * "光"  # of the longest name of a light
    relight.write(tmp_path / "l.exr", PREMULTIPLIED, layers={name: STRAIGHT[..., 0], "a": STRAIGHT[..., 1]})
    assert list(relight.read_layers(tmp_path / "l.exr")) == ["a", name]


def test_hundreds_of_layers_come_back(tmp_path):
    layers = {f"C_{number:03d}": np.full((2, 3, 4), number, np.float32) for number in range(300)}
    relight.write(tmp_path / "l.exr", np.ones((2, 3, 4), np.float32), layers=layers)
    assert (relight.read(tmp_path / "l.exr") == 1).all()
    back = relight.read_layers(tmp_path / "l.exr")
    assert len(back) == 300
    assert (back["C_299"] == 299).all()


def test_light_that_half_floats_lose_is_warned_of(tmp_path):
    bright = {"C_key": 1e-3 * PREMULTIPLIED, "N": STRAIGHT}
    dim = {"C_dim": PREMULTIPLIED * [1e-6, 1e-6, 1e-6, 1]}
    with pytest.warns(
        UserWarning, match=r"layers\['C_dim'\]: is so dim that half floats lose \d+ % of its li"
    ):
        relight.write(tmp_path / "l.exr", PREMULTIPLIED, layers=dim)
    with pytest.warns(UserWarning, match=r"image: is so dim that half floats lose 100 %"):
        relight.write(tmp_path / "l.exr", PREMULTIPLIED * np.float32([1e-9, 1e-9, 1e-9, 1]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        relight.write(tmp_path / "f.exr", PREMULTIPLIED, layers=dim, depth="float")
        relight.write(tmp_path / "h.exr", PREMULTIPLIED, layers=bright)
        relight.write(tmp_path / "h.exr", 0 * PREMULTIPLIED)
    np.testing.assert_allclose(relight.read_layers(tmp_path / "f.exr")["C_dim"], dim["C_dim"], rtol=1e-6)


@pytest.mark.parametrize("depth", ["half", "float"])
def test_autocrop_stores_the_box_and_reads_back_whole(tmp_path, depth):
    picture, layer, z = np.zeros((90, 70, 4)), np.zeros((90, 70, 3)), np.zeros((90, 70))
    picture[40:60, 30:50] = PREMULTIPLIED[:20, :20]
    layer[20:25, 10:12] = -0.25
    z[75, 60] = 2
    for name, autocrop in (("whole", False), ("box", True)):
        relight.write(
            tmp_path / f"{name}.exr",
            picture.astype(np.float32),
            layers={"N": layer, "Z": z},
            depth=depth,
            autocrop=autocrop,
            metadata={HASH_ATTRIBUTE: "a" * 32},
        )
        assert read_content_hash(tmp_path / f"{name}.exr") == "a" * 32
    spec = oiio.ImageInput.open(str(tmp_path / "box.exr")).spec()
    assert (spec.x, spec.y, spec.width, spec.height) == (10, 20, 51, 56)
    assert (spec.full_x, spec.full_y, spec.full_width, spec.full_height) == (0, 0, 70, 90)
    whole, box = (relight.read_layers(tmp_path / f"{name}.exr") for name in ("whole", "box"))
    assert whole.keys() == box.keys() == {"N", "Z"}
    for name in whole:
        np.testing.assert_array_equal(whole[name], box[name])
    np.testing.assert_array_equal(*(relight.read(tmp_path / f"{name}.exr") for name in ("whole", "box")))


def test_autocrop_of_nothing_and_elsewhere(tmp_path):
    relight.write(tmp_path / "n.exr", np.zeros((9, 7, 4), np.float32), autocrop=True)
    np.testing.assert_array_equal(relight.read(tmp_path / "n.exr"), np.zeros((9, 7, 4)))
    with pytest.raises(ValueError, match=r"n\.png: autocrop needs a \.exr file"):
        relight.write(tmp_path / "n.png", PREMULTIPLIED, autocrop=True)


def test_chroma_at_half_the_size_is_refused_in_one_line(tmp_path):
    """An OpenEXR file by hand, uncompressed, as RgbaOutputFile writes its luminance and chroma."""

    def attribute(name, kind, data):
        return f"{name}\0{kind}\0".encode() + struct.pack("<I", len(data)) + data

    described = b"".join(
        name + struct.pack("<xIB3xII", 2, 0, step, step) for name, step in ((b"BY", 2), (b"RY", 2), (b"Y", 1))
    )
    box = struct.pack("<4i", 0, 0, 7, 3)
    header = b"\x76\x2f\x31\x01" + struct.pack("<I", 2) + attribute("channels", "chlist", described + b"\0")
    header += attribute("compression", "compression", b"\0") + attribute("lineOrder", "lineOrder", b"\0")
    header += attribute("dataWindow", "box2i", box) + attribute("displayWindow", "box2i", box)
    header += attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    header += attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0))
    header += attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
    rows = [np.full(8 if row % 2 else 16, 0.3, np.float32).tobytes() for row in range(4)]
    rows = [struct.pack("<iI", row, len(data)) + data for row, data in enumerate(rows)]
    starts = np.cumsum([len(header) + 8 * len(rows)] + [len(row) for row in rows[:-1]])
    (tmp_path / "y.exr").write_bytes(header + struct.pack("<4Q", *starts) + b"".join(rows))
    with pytest.raises(
        ValueError, match=r"y\.exr: cannot be read as an image: Subsampled .*; save it as red"
    ):
        relight.read(tmp_path / "y.exr")


@pytest.mark.parametrize("chromaticities", [None, AP1])
@pytest.mark.parametrize("channels", [3, 4])
def test_luminance_and_chroma_are_colour(tmp_path, chromaticities, channels):
    """As OpenEXR's technical introduction defines them."""
    light = STRAIGHT[..., :3] + 0.1
    weights = {None: (0.2126, 0.7152, 0.0722)}.get(chromaticities, (0.2722, 0.6741, 0.0537))  # AP1's
    y = light @ np.float32(weights)
    stored = np.stack([y, light[..., 0] / y - 1, light[..., 2] / y - 1, STRAIGHT[..., 3]], axis=-1)
    more = {} if chromaticities is None else {"chromaticities": chromaticities}
    names = ("Y", "RY", "BY", "A")[:channels]
    store(tmp_path / "y.exr", stored[..., :channels], "float", channelnames=names, **more)
    store(tmp_path / "rgb.exr", light, "float", **more)
    found = relight.read(tmp_path / "y.exr")
    np.testing.assert_allclose(found[..., :3], relight.read(tmp_path / "rgb.exr"), atol=2e-3)
    assert found.shape == (24, 32, channels)
    if channels == 4:
        np.testing.assert_array_equal(found[..., 3], STRAIGHT[..., 3])


def test_a_file_of_layers_only_has_no_picture(tmp_path):
    store(tmp_path / "n.exr", STRAIGHT[..., :3], "half", channelnames=("N.X", "N.Y", "N.Z"))
    with pytest.raises(ValueError, match=r"n\.exr: holds no picture .* the layers N; choose one with layer="):
        relight.read(tmp_path / "n.exr")
    assert relight.read_layers(tmp_path / "n.exr")["N"].shape == (24, 32, 3)


@pytest.mark.parametrize(
    ("layers", "error", "message"),
    [
        ({"C_key": np.zeros((3, 3, 3))}, ValueError, r"layers\['C_key'\]: expected shape \(24, 32\)"),
        ({"C_key": np.zeros((24, 32, 2))}, ValueError, r"got \(24, 32, 2\)"),
        ({"C_key": np.zeros((24, 32, 3), np.uint8)}, TypeError, "expected a floating dtype, got uint8"),
        ({"C_key": np.full((24, 32), np.nan)}, ValueError, r"layers\['C_key'\]: contains NaN"),
        ({"": np.zeros((24, 32))}, TypeError, "layers: expected names"),
        (
            {"a\0b": np.zeros((24, 32))},
            ValueError,
            "layers: expected names of .* without NUL",
        ),
        ({"a\ud800": np.zeros((24, 32))}, ValueError, "layers: expected names of up to 253 bytes of UTF-8"),
        ({254 * "a": np.zeros((24, 32))}, ValueError, "layers: expected names of up to 253 bytes"),
    ],
)
def test_bad_layers_are_named(tmp_path, layers, error, message):
    with pytest.raises(error, match=message):
        relight.write(tmp_path / "l.exr", PREMULTIPLIED, layers=layers)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("layer", ["ViewLayer.Combined.", "rgba.", "beauty.", ""])
def test_a_matte_is_the_alpha_of_the_picture_wherever_that_is(tmp_path, layer):
    """Blender's multilayer files have no channel without a layer."""
    pixels = np.full((8, 8, 8), 0.5, np.float32)
    pixels[:4, :, 3] = 0
    spec = oiio.ImageSpec(8, 8, 8, "half")
    others = ["Depth.Z", "Normal.X", "Normal.Y", "Normal.Z"]
    spec.channelnames = [*(f"{layer}{name}" for name in "RGBA"), *(f"ViewLayer.{name}" for name in others)]
    file = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    file.open(str(tmp_path / "a.exr"), spec)
    file.write_image(pixels)
    file.close()
    np.testing.assert_array_equal(relight.read_mask(tmp_path / "a.exr"), pixels[..., 3])
