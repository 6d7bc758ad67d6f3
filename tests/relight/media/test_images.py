import contextlib
import os

import numpy as np
import OpenImageIO as oiio
import pytest
from helpers.stored import AP1, PREMULTIPLIED, STRAIGHT, store
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

import relight
from relight.media import colour
from relight.media.images import scene_linear

# Round trips


@pytest.mark.parametrize(
    ("name", "depth", "tolerance"),
    [
        ("a.png", "uint8", 1 / 255),
        ("a.png", "uint16", 1 / 65535),
        ("a.tif", "uint8", 1 / 255),
        ("a.tif", "uint16", 1 / 65535),
        ("a.tif", "float", 0),
        ("a.exr", "half", 2**-11),
        ("a.exr", "float", 0),
    ],
)
@pytest.mark.parametrize("channels", [3, 4])
def test_a_written_image_is_read_back_to_one_code_value(tmp_path, name, depth, tolerance, channels):
    image = PREMULTIPLIED[..., :channels]
    relight.write(tmp_path / name, image, depth=depth)
    back = relight.read(tmp_path / name)
    assert back.shape == image.shape
    assert back.dtype == np.float32
    # sRGB is steepest at white, where one code is 2.3 codes of light; premultiplied alpha adds its own half.
    np.testing.assert_allclose(back, image, atol=2 * tolerance)


@pytest.mark.parametrize("name", ["a.jpg", "a.hdr"])
def test_formats_without_alpha(tmp_path, name):
    image = np.broadcast_to(np.linspace(0.05, 0.9, 32, dtype=np.float32)[:, None, None], (32, 32, 3))
    relight.write(tmp_path / name, image)
    np.testing.assert_allclose(relight.read(tmp_path / name), image, atol=0.03)
    opaque = np.concatenate([image, np.ones((32, 32, 1), np.float32)], axis=-1)
    relight.write(tmp_path / name, opaque)
    assert relight.read(tmp_path / name).shape == (32, 32, 3)
    with pytest.raises(ValueError, match="holds no alpha; put the image over a background first"):
        relight.write(tmp_path / name, opaque * 0.5)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integers_come_back_code_for_code(tmp_path, dtype):
    codes = (STRAIGHT * np.iinfo(dtype).max).astype(dtype)
    codes[..., 3] = np.iinfo(dtype).max
    relight.write(tmp_path / "a.png", codes, depth=np.dtype(dtype).name)
    stored = oiio.ImageInput.open(str(tmp_path / "a.png")).read_image(np.dtype(dtype).name)
    np.testing.assert_array_equal(stored, codes)


def test_floats_keep_light_beyond_white_and_below_black(tmp_path):
    image = np.array([[[-0.5, 100.0, 1e-3, 1.0]]], np.float32)
    relight.write(tmp_path / "a.exr", image)
    np.testing.assert_allclose(relight.read(tmp_path / "a.exr"), image, rtol=1e-3)


def test_display_files_roll_highlights_off(tmp_path):
    image = np.array([[[-0.5, 100.0, 0.0]] * 2, [[1.0, 2.0, 4.0]] * 2], np.float32)
    relight.write(tmp_path / "a.png", image, depth="uint16")
    shown = relight.read(tmp_path / "a.png")
    np.testing.assert_allclose(shown[0, 0], [0, 1, 0], atol=1e-5)
    assert (np.diff(shown[1, 0]) > 0.03).all()
    faint = np.array([[[0.5, 0.5, 0.5, 1.0], [0.9, 0.9, 0.9, 0.001]]], np.float32)  # its own colour: 900
    relight.write(tmp_path / "b.png", faint, depth="uint16")
    np.testing.assert_allclose(relight.read(tmp_path / "b.png")[0, 0], faint[0, 0], atol=1e-4)


def test_a_view_is_for_display_files(tmp_path):
    for name in ("a.png", "a.jpg", "a.exr"):
        relight.write(tmp_path / name, PREMULTIPLIED[..., :3], view="aces", exposure=1)
    np.testing.assert_allclose(relight.read(tmp_path / "a.exr"), PREMULTIPLIED[..., :3], atol=1e-3)
    shown = colour.encode(PREMULTIPLIED[..., :3], view="aces", exposure=1)
    stored = oiio.ImageInput.open(str(tmp_path / "a.png")).read_image("float")
    np.testing.assert_allclose(stored, shown, atol=0.6 / 255)
    with pytest.raises(ValueError, match="view: expected one of"):
        relight.write(tmp_path / "b.png", PREMULTIPLIED, view="acid")
    assert not (tmp_path / "b.png").exists()


def test_files_say_what_they_are(tmp_path):
    relight.write(tmp_path / "a.exr", PREMULTIPLIED)
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    assert str(spec.format) == "half"
    assert spec.getattribute("oiio:ColorSpace").startswith("lin_rec709")
    assert spec.getattribute("Software").startswith("relight")
    np.testing.assert_allclose(spec.getattribute("chromaticities")[:2], (0.64, 0.33), atol=1e-6)
    relight.write(tmp_path / "a.png", PREMULTIPLIED)
    spec = oiio.ImageInput.open(str(tmp_path / "a.png")).spec()
    assert spec.getattribute("oiio:ColorSpace").startswith("srgb")


def test_photographs_keep_what_is_said_of_them(tmp_path):
    said = {"Artist": "me", "Copyright": "us", "relight:frame": 3}
    for name in ("a.jpg", "a.tif"):
        relight.write(tmp_path / name, PREMULTIPLIED[..., :3], metadata=said)
        spec = oiio.ImageInput.open(str(tmp_path / name)).spec()
        assert [spec.getattribute(key) for key in ("Artist", "Copyright")] == ["me", "us"]
        assert spec.getattribute("Software").startswith("relight")


def test_large_pictures_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10)  # of what Pillow opens without a word
    for name in ("a.png", "a.jpg"):
        relight.write(tmp_path / name, PREMULTIPLIED[..., :3])
        assert relight.read(tmp_path / name).shape == (24, 32, 3)
    with pytest.raises(ValueError, match=r"b\.jpg: \.jpg holds at most 65500 pixels a side"):
        relight.write(tmp_path / "b.jpg", np.zeros((1, 65501, 3), np.uint8))


# Files of other programs


def test_straight_png_is_linearised_before_it_is_premultiplied(tmp_path):
    store(tmp_path / "a.png", STRAIGHT, "uint16", oiio__UnassociatedAlpha=1)
    codes = np.round(STRAIGHT * 65535).astype(np.uint16)
    np.testing.assert_allclose(relight.read(tmp_path / "a.png"), scene_linear("a", codes), atol=1e-6)


def test_encoded_premultiplied_tiff_is_unpremultiplied_first(tmp_path):
    store(tmp_path / "a.tif", PREMULTIPLIED, "uint16")  # associated alpha
    opaque = STRAIGHT[..., 3] > 0.2
    expected = scene_linear("a", np.round(STRAIGHT * 65535).astype(np.uint16))
    np.testing.assert_allclose(relight.read(tmp_path / "a.tif")[opaque], expected[opaque], atol=2e-4)


def test_grey_becomes_three_channels(tmp_path):
    store(tmp_path / "g.png", STRAIGHT[..., :1], "uint8")
    store(tmp_path / "ga.png", STRAIGHT[..., [0, 3]], "uint8", oiio__UnassociatedAlpha=1)
    grey, with_alpha = relight.read(tmp_path / "g.png"), relight.read(tmp_path / "ga.png")
    assert grey.shape == (24, 32, 3)
    assert with_alpha.shape == (24, 32, 4)
    assert (np.ptp(grey, axis=-1) == 0).all()
    np.testing.assert_allclose(with_alpha[..., 0], grey[..., 0] * with_alpha[..., 3], atol=1e-6)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_stands_the_picture_up(tmp_path, orientation):
    ramp = np.zeros((32, 48, 3), np.float32)
    ramp[:16, :24] = 0.8  # light where row 0 and column 0 of the file are
    store(tmp_path / "o.jpg", ramp, "uint8", Orientation=orientation)
    upright = relight.read(tmp_path / "o.jpg")
    assert upright.shape == ((32, 48, 3) if orientation < 5 else (48, 32, 3))
    # Where row 0 and column 0 belong (Exif 2.3, tag 274), as (bottom, right).
    corner = [(0, 0), (0, 1), (1, 1), (1, 0), (0, 0), (0, 1), (1, 1), (1, 0)][orientation - 1]
    bottom, right = (8 if not far else -8 for far in corner)
    assert upright[bottom, right, 0] > 0.3
    assert upright[-bottom, right, 0] < 0.05
    assert upright[bottom, -right, 0] < 0.05


def test_display_window_crops_overscan_and_pads(tmp_path):
    window = {"x": -2, "y": 3, "full_x": 0, "full_y": 0, "full_width": 40, "full_height": 20}
    store(tmp_path / "w.exr", STRAIGHT[..., :3], "float", **window)
    image = relight.read(tmp_path / "w.exr")
    assert image.shape == (20, 40, 3)
    np.testing.assert_array_equal(image[3:, :30], STRAIGHT[:17, 2:, :3])
    assert (image[:3] == 0).all()
    assert (image[:, 30:] == 0).all()


def test_colour_space_can_be_declared_and_is_honoured(tmp_path):
    store(tmp_path / "s.exr", STRAIGHT[..., :3], "float")
    linear = relight.read(tmp_path / "s.exr")
    np.testing.assert_array_equal(linear, STRAIGHT[..., :3])
    assert (relight.read(tmp_path / "s.exr", colour_space="sRGB") <= linear + 1e-6).all()
    store(tmp_path / "t.exr", np.ones((2, 2, 3), np.float32), "float", oiio__ColorSpace="ACEScg")
    np.testing.assert_allclose(relight.read(tmp_path / "t.exr"), 1, atol=1e-3)
    with pytest.raises(ValueError, match="colour_space: unknown 'bogus'"):
        relight.read(tmp_path / "s.exr", colour_space="bogus")


def test_primaries_of_a_file_are_honoured(tmp_path):
    store(tmp_path / "p.exr", PREMULTIPLIED, "float", chromaticities=AP1)
    store(tmp_path / "n.exr", PREMULTIPLIED, "float", oiio__ColorSpace="ACEScg")
    store(tmp_path / "u.exr", PREMULTIPLIED, "float")
    expected = relight.read(tmp_path / "u.exr", colour_space="ACEScg")
    for name in ("p.exr", "n.exr"):
        read = relight.read(tmp_path / name)
        np.testing.assert_allclose(read, expected, atol=1e-5)
        np.testing.assert_allclose(read[..., 3], PREMULTIPLIED[..., 3], atol=1e-6)
    assert np.abs(expected - PREMULTIPLIED).max() > 0.1
    store(tmp_path / "z.exr", PREMULTIPLIED, "float", chromaticities=(0.3,) * 8)
    with pytest.raises(ValueError, match=r"z\.exr: chromaticities: .* span no colours"):
        relight.read(tmp_path / "z.exr")
    store(tmp_path / "c.exr", PREMULTIPLIED, "float", colorInteropID="studio:camera")
    with pytest.raises(ValueError, match=r"c\.exr: colour_space: unknown 'studio:camera'"):
        relight.read(tmp_path / "c.exr")
    store(tmp_path / "c.exr", PREMULTIPLIED, "float", colorInteropID="unknown", chromaticities=AP1)
    np.testing.assert_allclose(relight.read(tmp_path / "c.exr"), expected, atol=1e-5)


# Errors


@pytest.mark.parametrize(
    ("name", "arguments", "error", "message"),
    [
        ("a.gif", {}, ValueError, "expected a file name that ends in .exr, .hdr"),
        ("a", {}, ValueError, "expected a file name that ends in"),
        ("a.png", {"depth": "half"}, ValueError, "depth: expected uint8 or uint16 for .png, got 'half'"),
        ("a.png", {"layers": {"x": STRAIGHT}}, ValueError, "layers need a .exr file"),
        ("none/a.png", {}, FileNotFoundError, "the folder .*none does not exist"),
    ],
)
def test_write_refuses_unsupported_formats_and_missing_folders(tmp_path, name, arguments, error, message):
    with pytest.raises(error, match=message):
        relight.write(tmp_path / name, PREMULTIPLIED, **arguments)
    assert os.listdir(tmp_path) == []


def test_half_refuses_what_it_cannot_hold(tmp_path):
    bright = np.full((2, 2, 3), 1e5, np.float32)
    with pytest.raises(ValueError, match="do not fit half; write it with depth='float'"):
        relight.write(tmp_path / "a.exr", bright)
    relight.write(tmp_path / "a.exr", bright, depth="float")
    np.testing.assert_array_equal(relight.read(tmp_path / "a.exr"), bright)


@pytest.mark.parametrize(
    "function", [relight.read, relight.read_mask, relight.read_normals, relight.read_layers]
)
def test_read_errors_name_the_path(tmp_path, function):
    with pytest.raises(FileNotFoundError, match=r"gone\.png: no such file"):
        function(tmp_path / "gone.png")
    (tmp_path / "text.png").write_text("not a picture")
    with pytest.raises(ValueError, match=r"text\.png: cannot be read as an image"):
        function(tmp_path / "text.png")


def test_nan_in_a_file_is_an_error(tmp_path):
    store(tmp_path / "n.exr", np.full((4, 4, 3), np.nan, np.float32), "float")
    with pytest.raises(ValueError, match=r"n\.exr: contains NaN"):
        relight.read(tmp_path / "n.exr")


@pytest.fixture(scope="module")
def whole_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    for name in ("a.png", "a.tif", "a.exr"):
        relight.write(folder / name, PREMULTIPLIED)
    for name in ("a.jpg", "a.hdr"):
        relight.write(folder / name, PREMULTIPLIED[..., :3])
    return folder


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.exr", "a.jpg", "a.hdr"])
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0, 0.99))
def test_truncated_files_never_give_half_a_picture(whole_files, tmp_path, name, share):
    data = (whole_files / name).read_bytes()
    (tmp_path / name).write_bytes(data[: int(len(data) * share)])
    if share < 0.8:
        with pytest.raises(ValueError, match=rf"{name}: (cannot be read|is damaged or truncated)"):
            relight.read(tmp_path / name)
        return
    with contextlib.suppress(ValueError):  # unless only metadata is missing, that a TIFF has at its end
        picture = relight.read(tmp_path / name)
        np.testing.assert_array_equal(picture, relight.read(whole_files / name))


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    name=st.sampled_from(["a.png", "a.tif", "a.exr", "a.jpg", "a.hdr"]),
    edits=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), min_size=1, max_size=8),
    header=st.booleans(),
)
def test_corrupted_files_are_a_picture_or_an_error(whole_files, tmp_path, name, edits, header):
    data = bytearray((whole_files / name).read_bytes())
    for position, value in edits:
        data[int(position * (min(400, len(data)) if header else len(data) - 1))] = value
    (tmp_path / name).write_bytes(data)
    for function in (relight.read, relight.read_mask, relight.read_layers):
        try:
            found = function(tmp_path / name)
        except ValueError as error:
            assert str(tmp_path / name) in str(error)  # noqa: PT017
            continue
        for pixels in found.values() if isinstance(found, dict) else [found]:
            assert pixels.dtype == np.float32
            assert function is relight.read_layers or np.isfinite(pixels).all()


@pytest.mark.parametrize(
    ("text", "garbled"),
    [(b"lin_rec709_scene", b"lin\xff\xfe09_scene"), (b"\0A\0", b"\0\xff\0"), (b"zip", b"\xff\xfe\xfd")],
)
def test_garbled_names_are_an_error(whole_files, tmp_path, text, garbled):
    data = (whole_files / "a.exr").read_bytes().replace(text, garbled)
    (tmp_path / "a.exr").write_bytes(data)
    with contextlib.suppress(ValueError):
        assert relight.read(tmp_path / "a.exr").shape[:2] == (24, 32)


def test_a_size_beyond_memory_is_an_error(tmp_path):
    huge = {"x": 0, "y": 0, "full_x": 0, "full_y": 0, "full_width": 1 << 20, "full_height": 1 << 20}
    store(tmp_path / "h.exr", STRAIGHT, "half", **huge)
    with pytest.raises(ValueError, match=r"h\.exr: is too large: .* claim 1048576 x"):
        relight.read(tmp_path / "h.exr")


# Whole files or none


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.jpg", "a.tif"])
def test_a_failing_write_keeps_the_old_file_and_leaves_nothing(tmp_path, full_disk, name):
    image = PREMULTIPLIED[..., :3]
    relight.write(tmp_path / name, image)
    before = (tmp_path / name).read_bytes()

    with full_disk(), pytest.raises(OSError, match="No space left"):
        relight.write(tmp_path / name, image * 0.5)
    assert os.listdir(tmp_path) == [name]
    assert (tmp_path / name).read_bytes() == before


def test_a_write_that_openimageio_refuses_is_an_oserror(tmp_path, monkeypatch):
    class Refuses:
        def open(self, name, spec):
            with open(name, "wb") as file:
                file.write(b"half a file")
            return True

        def write_image(self, pixels):
            return False

        def close(self):
            return True

        def geterror(self):
            return "disk full"

    monkeypatch.setattr(oiio.ImageOutput, "create", lambda name: Refuses())
    with pytest.raises(OSError, match=r"a\.png: cannot be written: disk full"):
        relight.write(tmp_path / "a.png", PREMULTIPLIED)
    assert os.listdir(tmp_path) == []


def test_what_is_read_is_contiguous(tmp_path):
    relight.write(tmp_path / "a.png", np.random.default_rng(0).random((5, 7, 4), np.float32))
    assert relight.read(tmp_path / "a.png").flags.c_contiguous
