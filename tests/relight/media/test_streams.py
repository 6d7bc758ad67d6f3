"""File objects in place of paths, as services have them."""

import io
import warnings

import numpy as np
import pytest
from helpers.foreign_files import ramp
from PIL import Image

import relight

PICTURE = np.dstack([ramp(24, 32), np.full((24, 32), 255, np.uint8)])


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP", "TIFF", "AVIF", "BMP"])
def test_a_stream_is_read_as_its_file(tmp_path, kind):
    whole = io.BytesIO()
    Image.fromarray(ramp(24, 32)).save(whole, kind)
    (tmp_path / "a").write_bytes(whole.getvalue())
    stream = io.BytesIO(b"before" + whole.getvalue())
    stream.seek(6)
    np.testing.assert_array_equal(relight.read(stream), relight.read(tmp_path / "a"))
    with (tmp_path / "a").open("rb") as file:
        np.testing.assert_array_equal(relight.read(file), relight.read(tmp_path / "a"))


@pytest.mark.parametrize("name", ["exr", ".png", "TIF", "jpg", "hdr"])
def test_what_is_written_to_a_stream_is_read_back(tmp_path, name):
    suffix, image = name.lower().removeprefix("."), relight.read(io.BytesIO(_png()))[..., :3]
    stream = io.BytesIO()
    relight.write(stream, image, format=name)
    relight.write(tmp_path / f"a.{suffix}", image)
    stream.seek(0)
    np.testing.assert_array_equal(relight.read(stream), relight.read(tmp_path / f"a.{suffix}"))


def test_layers_options_and_mattes_go_through_streams(tmp_path):
    stream, image = io.BytesIO(), relight.read(io.BytesIO(_png()))
    relight.write(stream, image, layers={"C_key": image[..., :3] * 2}, format="exr")
    stream.seek(0)
    np.testing.assert_allclose(relight.read(stream, layer="C_key"), image[..., :3] * 2, atol=1e-3)
    matte = np.zeros((24, 32), np.uint8)
    matte[4:20] = 255
    stream = io.BytesIO()
    Image.fromarray(matte).save(stream, "PNG")
    stream.seek(0)
    np.testing.assert_array_equal(relight.read_mask(stream), matte / 255)
    stream = io.BytesIO()
    relight.write(stream, [image[..., :3]] * 3, format="mp4", rate=24)
    (tmp_path / "a.mp4").write_bytes(stream.getvalue())
    assert stream.getvalue()[4:8] == b"ftyp"


def test_errors_of_streams_say_stream(tmp_path):
    for content in (b"", b"no picture", _png()[:60]):
        with pytest.raises(ValueError, match=r"^stream: "):
            relight.read(io.BytesIO(content))
    with pytest.raises(TypeError, match=r"path: expected a stream of bytes, got one of str"):
        relight.read(io.StringIO("text"))
    with pytest.raises(TypeError, match=r"format: expected that of a stream"):
        relight.write(io.BytesIO(), np.zeros((4, 4, 3), np.float32))
    with pytest.raises(ValueError, match=r"^stream: expected a file name that ends in"):
        relight.write(io.BytesIO(), np.zeros((4, 4, 3), np.float32), format="xyz")
    with pytest.raises(TypeError, match=r"format: is for streams"):
        relight.write(tmp_path / "a.png", np.zeros((4, 4, 3), np.float32), format="png")


def test_a_path_in_place_of_a_picture_is_named_for_what_it_is(tmp_path):
    for path in ("plate.png", tmp_path / "plate.png"):
        with pytest.raises(
            TypeError, match=r"image: expected an array, got the path '.*plate\.png'; read it"
        ):
            relight.apply(path, relight.DirectionalLight())
    with pytest.raises(TypeError, match=r"mask: expected an array, got the path 'm\.png'"):
        relight.Subject(np.zeros((8, 8, 3), np.float32), "m.png")


def test_read_only_arrays_are_taken_without_a_word():
    image = np.full((64, 48, 4), 0.3, np.float32)
    image[:4], image[..., 3] = 0, 0
    image[8:56, 12:36, 3] = 1
    image[..., :3] *= image[..., 3:]
    image.flags.writeable = False
    light = relight.DirectionalLight(azimuth=-40)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        relit = relight.apply(image, light)
        relight.apply(image[..., :3], light, mask=image[..., 3])
        relight.Subject(image, albedo=image[..., :3]).visibility(np.broadcast_to([0.0, 0.0, 1.0], (2, 3)))
    assert relit.flags.writeable


def _png():
    stream = io.BytesIO()
    Image.fromarray(PICTURE).save(stream, "PNG")
    return stream.getvalue()
