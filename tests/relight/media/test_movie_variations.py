"""Variations of what containers of movies say: other codecs, layouts of pixels and containers."""

import struct

import numpy as np
import pytest
from helpers.foreign_files import movie, ramp

from relight.media.movies import MatteMovie, Movie

SOFT = np.uint8(np.clip(np.linspace(-20, 280, 64), 0, 255))[None].repeat(64, 0)  # a matte with a wide edge
CUT = np.dstack([ramp(), SOFT])
GREY = np.dstack([SOFT, SOFT, SOFT, np.full_like(SOFT, 255)])
# Codec, layout of pixels, container, tolerance of alpha; the codec's own options where it needs them
WITH_ALPHA = [
    ("qtrle", "argb", "a.mov", 1e-4),
    ("png", "rgba64be", "b.mov", 1e-4),
    ("rawvideo", "bgra", "a.avi", 1e-4),
    ("targa", "bgra", "a.mov", 1e-4),
    ("cfhd", "gbrap12le", "a.mov", 0.02),
    ("huffyuv", "bgra", "a.avi", 1e-4),
    ("utvideo", "gbrap", "a.avi", 0.004),
    ("magicyuv", "gbrap", "a.avi", 0.004),
    ("ffv1", "yuva420p", "a.mkv", 0.004),
    ("ffv1", "yuva444p10le", "b.mkv", 0.004),
]


@pytest.mark.parametrize(("codec", "layout", "name", "tolerance"), WITH_ALPHA)
def test_alpha_of_every_codec_is_coverage(tmp_path, codec, layout, name, tolerance):
    movie(tmp_path / name, [CUT] * 2, codec=codec, layout=layout)
    found = Movie(tmp_path / name).read(2)
    np.testing.assert_allclose(found[..., 3], SOFT / 255, atol=tolerance)
    opaque = SOFT == 255
    light = ((ramp() / 255 + 0.099) / 1.099) ** (1 / 0.45)  # BT.709's curve
    np.testing.assert_allclose(found[opaque][:, :3], light[opaque], atol=0.03)
    np.testing.assert_allclose(MatteMovie(tmp_path / name).read(1), SOFT / 255, atol=tolerance)


@pytest.mark.parametrize(
    ("codec", "layout", "name", "tolerance"),
    [
        WITH_ALPHA[0],
        *WITH_ALPHA[2:5],
        ("png", "ya8", "a.mov", 1e-4),
        ("libvpx-vp9", "yuva420p", "a.webm", 0.02),
    ],
)
def test_grey_with_opaque_alpha_of_every_codec_is_a_matte(tmp_path, codec, layout, name, tolerance):
    options = {"lossless": "1"} if "vp9" in codec else None
    movie(tmp_path / name, [GREY] * 2, codec=codec, layout=layout, options=options)
    found = MatteMovie(tmp_path / name).read(2)
    np.testing.assert_allclose(found, SOFT / 255, atol=tolerance)


def test_a_matte_that_begins_with_a_full_frame(tmp_path):
    white = np.full((64, 64, 4), 255, np.uint8)
    for name, frame in (("grey.mov", GREY), ("alpha.mov", CUT)):
        movie(tmp_path / name, [white, frame, frame], codec="qtrle", layout="argb")
        source = MatteMovie(tmp_path / name)
        assert source.read(1).min() == 1
        np.testing.assert_allclose(source.read(2), SOFT / 255, atol=1e-4)


@pytest.mark.parametrize("code", [0, 255])
@pytest.mark.parametrize(
    ("codec", "layout", "name"),
    [
        ("v210", "yuv422p10le", "a.mov"),
        ("rawvideo", "uyvy422", "a.mov"),
        ("rawvideo", "yuyv422", "a.avi"),
        ("mjpeg", "yuvj422p", "a.avi"),
        ("mpeg2video", "yuv422p", "a.mxf"),
        ("wmv2", "yuv420p", "a.wmv"),
        ("libvpx-vp9", "gbrp", "a.webm"),
        ("dnxhd", "yuv422p10le", "b.mov"),
        ("ffv1", "yuv411p", "a.mkv"),
    ],
)
def test_white_of_every_codec_is_one(tmp_path, codec, layout, name, code):
    options = {"dnxhd": {"profile": "dnxhr_hqx"}, "mjpeg": {"qmin": "1", "qmax": "1"}}.get(codec)
    size = (128, 256) if codec == "dnxhd" else (64, 64)
    full = 2 if layout.startswith(("gbrp", "yuvj")) else 1
    frame = np.full((*size, 3), code, np.uint8)
    movie(tmp_path / name, [frame] * 2, codec=codec, layout=layout, range_=full, options=options)
    expected = code / 255
    np.testing.assert_allclose(Movie(tmp_path / name).read(1), expected, atol=1e-3)
    np.testing.assert_allclose(MatteMovie(tmp_path / name).read(1), expected, atol=1e-3)


@pytest.mark.parametrize(
    ("codec", "layout", "name"),
    [
        ("mpeg4", "yuv420p", "a.3gp"),
        ("libsvtav1", "yuv420p", "a.mp4"),
        ("png", "rgb24", "a.mov"),
        ("mjpeg", "yuvj420p", "a.avi"),
        ("libx264", "yuv420p", "a.ts"),
    ],
)
def test_pixel_shapes_of_every_container(tmp_path, codec, layout, name):
    movie(tmp_path / name, [ramp()] * 9, codec=codec, layout=layout, aspect="2/1")
    with pytest.warns(UserWarning, match="its pixels are 2 times as wide as high"):
        assert Movie(tmp_path / name).read(1).shape == (64, 128, 3)


def test_pixels_of_a_turned_movie_are_as_high_as_they_were_wide(tmp_path):
    path = tmp_path / "a.mp4"
    movie(path, [ramp()] * 2, codec="libx264", layout="yuv444p", aspect="2/1", options={"qp": "0"})
    with pytest.warns(UserWarning, match="square pixels"):
        lying = Movie(path).read(1)
    identity = struct.pack(">9i", 65536, 0, 0, 0, 65536, 0, 0, 0, 1 << 30)
    quarter = struct.pack(">9i", 0, 65536, 0, -65536, 0, 0, 0, 0, 1 << 30)
    head, track, tail = path.read_bytes().partition(b"tkhd")
    path.write_bytes(head + track + tail.replace(identity, quarter, 1))
    turned = Movie(path)
    np.testing.assert_array_equal(turned.read(1), np.rot90(lying, -1))
    assert turned.upright_aspect() == 0.5


def test_hlg_of_a_phone_is_light_and_a_camera_log_can_be_said(tmp_path):
    grey = np.full((64, 64, 3), 32768, np.uint16)
    # Without B-frames, since x265 gives a movie of two frames undefined decoding times with them.
    movie(
        tmp_path / "a.mp4", [grey] * 2, codec="libx265", layout="yuv420p10le", colour=(9, 18, 9),
        options={"x265-params": "log-level=none:crf=4:bframes=0"},
    )  # fmt: skip
    np.testing.assert_allclose(Movie(tmp_path / "a.mp4").read(1)[32, 32], 0.3144, atol=0.01)
    log = Movie(tmp_path / "a.mp4", colour_space="ARRI LogC4").read(1)[32, 32]
    np.testing.assert_allclose(log, 2.2, rtol=0.04)  # what is said replaces what the stream says
