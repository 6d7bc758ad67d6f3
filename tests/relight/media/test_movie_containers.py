"""What containers of movies say of alpha, white, fields, colour and pixel shape is honoured or refused."""

import struct

import av
import numpy as np
import pytest
from helpers.foreign_files import RED_OF_BT2020, decode_srgb, disc, movie, ramp

from relight.media.movies import MatteMovie, Movie, is_movie

MATTE = disc() / 255
CUT = np.dstack([ramp(), disc()])
OPAQUE = np.dstack([disc(), disc(), disc(), np.full_like(disc(), 255)])
PRORES = {"codec": "prores_ks", "layout": "yuva444p10le"}


@pytest.mark.parametrize(
    ("codec", "options"), [("libvpx-vp9", {"lossless": "1"}), ("libvpx", {"auto-alt-ref": "0", "crf": "4"})]
)
@pytest.mark.parametrize("suffix", [".webm", ".mkv"])
@pytest.mark.states("Movies", "alpha of VP8 and VP9", "honoured")
def test_alpha_of_vp8_and_vp9_is_read(tmp_path, codec, options, suffix):
    path = tmp_path / f"a{suffix}"
    movie(path, [CUT] * 3, codec=codec, layout="yuva420p", options=options)
    source = Movie(path)
    for number in (2, 1, 3):
        found = source.read(number)
        assert found.shape == (64, 64, 4)
        np.testing.assert_allclose(found[..., 3], MATTE, atol=0.06)
    inside = MATTE > 0
    light = decode_srgb(ramp() / 255)[inside].mean()
    assert found[inside][:, :3].mean() == pytest.approx(light, abs=0.05)
    np.testing.assert_allclose(MatteMovie(path).read(2), MATTE, atol=0.06)


@pytest.mark.states("Movies", "alpha that FFmpeg lacks the decoder for", "refused")
def test_alpha_that_cannot_be_decoded_is_refused(tmp_path, monkeypatch):
    movie(tmp_path / "a.webm", [CUT], codec="libvpx-vp9", layout="yuva420p")
    monkeypatch.setattr(av, "codecs_available", av.codecs_available - {"libvpx-vp9"})
    with pytest.raises(ValueError, match=r"a\.webm: has alpha that this FFmpeg does not decode"):
        Movie(tmp_path / "a.webm")


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("a.mov", PRORES),
        ("b.mov", {"codec": "qtrle", "layout": "argb"}),
        ("a.mkv", {"codec": "ffv1", "layout": "bgra"}),
        ("c.mov", {"codec": "png", "layout": "rgba"}),
    ],
)
def test_a_grey_matte_with_opaque_alpha_is_its_grey(tmp_path, name, settings):
    movie(tmp_path / name, [OPAQUE] * 2, **settings)
    np.testing.assert_allclose(MatteMovie(tmp_path / name).read(2), MATTE, atol=0.01)
    movie(tmp_path / name, [CUT] * 2, **settings)
    np.testing.assert_allclose(MatteMovie(tmp_path / name).read(1), MATTE, atol=0.01)


@pytest.mark.states("Movies", "opaque colour, as a matte", "refused")
def test_opaque_colour_is_no_matte(tmp_path):
    movie(tmp_path / "a.mp4", [ramp()] * 2, codec="libx264", layout="yuv420p")
    with pytest.raises(ValueError, match=r"a\.mp4: expected mattes .* got opaque colour in frame 1"):
        MatteMovie(tmp_path / "a.mp4").read(1)


def test_a_frame_that_the_person_fills_stays_alpha(tmp_path):
    full = CUT.copy()
    full[..., 3] = 255
    movie(tmp_path / "a.mov", [CUT, full], **PRORES)
    np.testing.assert_allclose(MatteMovie(tmp_path / "a.mov").read(2), 1, atol=1e-3)


GREY = ["gray", "gray10le", "gray16le"]
COLOUR = ["yuv420p", "yuv422p10le", "yuv444p", "yuva444p", "bgr0", "gbrp10le", "gbrp16le"]


@pytest.mark.parametrize("layout", [*GREY, *COLOUR])
def test_white_is_one_and_black_zero(tmp_path, layout):
    full = 2 if layout in GREY or layout.startswith(("gbr", "bgr")) else 1
    kind = np.uint16 if "1" in layout else np.uint8
    white, black = (np.full((64, 64, 3), code, kind) for code in (np.iinfo(kind).max, 0))
    colour = (1, 1, 0) if full == 2 else (1, 1, 1)
    movie(tmp_path / "a.mkv", [white, black], codec="ffv1", layout=layout, range_=full, colour=colour)
    np.testing.assert_allclose(Movie(tmp_path / "a.mkv").read(1)[..., :3], 1, atol=2e-4)
    np.testing.assert_allclose(Movie(tmp_path / "a.mkv").read(2)[..., :3], 0, atol=2e-4)
    np.testing.assert_allclose(MatteMovie(tmp_path / "a.mkv").read(1), 1, atol=2e-4)


@pytest.mark.parametrize(
    ("name", "codec", "layout", "range_"),
    [
        ("a.mp4", "libx264", "yuv420p", 1),
        ("a.mov", "prores_ks", "yuv422p10le", 1),
        ("a.avi", "mpeg4", "yuv420p", 1),
        ("a.webm", "libvpx-vp9", "yuv420p", 1),
        ("a.mts", "libx264", "yuv420p", 1),
    ],
)
def test_white_of_lossy_codecs_is_one(tmp_path, name, codec, layout, range_):
    options = {"qp": "0"} if codec == "libx264" else {}
    white = np.full((64, 64, 3), 255, np.uint8)
    movie(tmp_path / name, [white] * 8, codec=codec, layout=layout, range_=range_, options=options)
    assert is_movie(tmp_path / name)
    np.testing.assert_allclose(Movie(tmp_path / name).read(2), 1, atol=2e-3)


def test_white_of_the_full_range_is_one(tmp_path):
    planes = np.full((96, 64), 128, np.uint8)  # 4:2:0: luma, then both chromas at a quarter of its size
    planes[:64] = 255
    with av.open(str(tmp_path / "a.mp4"), "w") as file:
        stream = file.add_stream("libx264", 25, options={"qp": "0"})
        stream.height, stream.width, stream.pix_fmt = 64, 64, "yuvj420p"
        frame = av.VideoFrame.from_ndarray(planes, format="yuvj420p")
        file.mux(stream.encode(frame))
        file.mux(stream.encode())
    np.testing.assert_allclose(Movie(tmp_path / "a.mp4").read(1), 1, atol=2e-4)


def combed(field):
    """Frames of a disc that moves, the second field later than the first."""
    frames = []
    for number in range(3):
        early, late = (np.roll(CUT, 8 * number + step, axis=1) for step in (0, 4))
        frame = (early if field == "tff" else late).copy()
        frame[1::2] = (late if field == "tff" else early)[1::2]
        frames.append(frame)
    return frames


@pytest.mark.parametrize("field", ["tff", "bff"])
@pytest.mark.parametrize(
    ("name", "codec", "layout"),
    [
        ("a.mov", "prores_ks", "yuva444p10le"),
        ("a.mp4", "libx264", "yuv420p"),
        ("a.mts", "libx264", "yuv420p"),
        ("a.mpg", "mpeg2video", "yuv420p"),
        ("b.mov", "qtrle", "argb"),  # the container says it, and no frame
        ("c.mov", "png", "rgb24"),
        ("a.mkv", "ffv1", "bgra"),
        ("a.mxf", "mpeg2video", "yuv420p"),
    ],
)
@pytest.mark.states("Movies", "two fields a frame", "honoured")
def test_fields_are_taken_apart(tmp_path, name, codec, layout, field):
    frames = combed(field)
    alpha = layout in ("yuva444p10le", "argb", "bgra")
    shown = frames if alpha else [np.ascontiguousarray(frame[..., [3, 3, 3]]) for frame in frames]
    movie(tmp_path / name, shown, codec=codec, layout=layout, field=field)
    source = Movie(tmp_path / name)
    assert len(source.numbers) == 3
    for number in (1, 2, 3, 1):
        matte = source.read(number)[..., -1]
        neighbours, same_field = np.abs(np.diff(matte, axis=0)).mean(), np.abs(matte[2:] - matte[:-2]).mean()
        assert neighbours < 0.8 * same_field  # combed: about the same, or more
        early, late = (np.roll(MATTE, 8 * number - 8 + step, axis=1) for step in (0, 4))
        assert np.abs(matte - early).mean() < 0.5 * np.abs(matte - late).mean()  # of the field shown first


@pytest.mark.parametrize(
    "settings",
    [
        PRORES,
        PRORES | {"options": {"field_order": "tt"}},  # its frames know better
        {"codec": "png", "layout": "rgba", "options": {"flags": "+ildct"}},  # interlaced files: Adam7
    ],
)
def test_progressive_frames_stay_as_they_are(tmp_path, settings):
    movie(tmp_path / "a.mov", combed("tff"), **settings)
    matte = Movie(tmp_path / "a.mov").read(2)[..., 3]
    np.testing.assert_allclose(matte, combed("tff")[1][..., 3] / 255, atol=1e-3)


@pytest.mark.parametrize("aspect", ["2/1", "1/2", "64/45"])
@pytest.mark.parametrize(
    ("name", "codec"), [("a.mov", "prores_ks"), ("a.mp4", "libx264"), ("a.mkv", "libx264")]
)
@pytest.mark.states("Movies", "a sample aspect", "honoured")
def test_pixels_are_made_square(tmp_path, name, codec, aspect):
    layout = {"prores_ks": "yuva444p10le", "libx264": "yuv420p"}[codec]
    movie(tmp_path / name, [CUT] * 2, codec=codec, layout=layout, aspect=aspect)
    with pytest.warns(UserWarning, match=rf"{name}: its pixels are .* times as wide as high; it is read"):
        source = Movie(tmp_path / name)
    height, width = source.read(1).shape[:2]
    numerator, denominator = map(int, aspect.split("/"))
    assert width / height == pytest.approx(numerator / denominator, rel=0.02)


@pytest.mark.parametrize(
    ("colour", "code", "expected"),
    [
        ((9, 16, 9), 38055, (1, 1, 1)),  # white of 203 cd/m² in PQ
        ((9, 18, 9), 49151, (1, 1, 1)),  # the same in HLG
        ((9, 18, 9), 32768, (0.3144,) * 3),  # 1/12 of the camera's range over 0.265
    ],
)
@pytest.mark.states("Movies", "the transfer functions PQ and HLG", "honoured")
def test_pq_and_hlg_are_light(tmp_path, colour, code, expected):
    grey = np.full((64, 64, 3), code, np.uint16)
    movie(tmp_path / "a.mkv", [grey] * 2, codec="ffv1", layout="yuv444p10le", colour=colour)
    np.testing.assert_allclose(Movie(tmp_path / "a.mkv").read(2)[32, 32], expected, atol=0.03)


@pytest.mark.states("Movies", "colour primaries", "honoured")
def test_primaries_of_a_movie_count(tmp_path):
    red = np.tile(np.uint16([65535, 0, 0]), (64, 64, 1))
    movie(tmp_path / "a.mkv", [red] * 2, codec="ffv1", layout="yuv444p10le", colour=(9, 1, 9))
    np.testing.assert_allclose(Movie(tmp_path / "a.mkv").read(1)[32, 32], RED_OF_BT2020, atol=0.02)


def test_premultiplied_alpha_can_be_said(tmp_path):
    codes = np.full((64, 64, 4), 128, np.uint8)
    movie(tmp_path / "a.mov", [codes] * 2, **PRORES)
    straight = Movie(tmp_path / "a.mov").read(1)[32, 32]
    other = Movie(tmp_path / "a.mov", alpha="premultiplied").read(1)[32, 32]
    assert straight[0] == pytest.approx(straight[3] * ((128 / 255 + 0.099) / 1.099) ** (1 / 0.45), abs=2e-3)
    assert other[0] == pytest.approx(other[3], abs=2e-3)


SOFT = np.uint8(np.clip(np.linspace(-20, 280, 64), 0, 255))[None].repeat(64, 0)  # a matte with a wide edge
SOFT_CUT = np.dstack([ramp(), SOFT])
SOFT_GREY = np.dstack([SOFT, SOFT, SOFT, np.full_like(SOFT, 255)])
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
    movie(tmp_path / name, [SOFT_CUT] * 2, codec=codec, layout=layout)
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
    movie(tmp_path / name, [SOFT_GREY] * 2, codec=codec, layout=layout, options=options)
    found = MatteMovie(tmp_path / name).read(2)
    np.testing.assert_allclose(found, SOFT / 255, atol=tolerance)


def test_a_matte_that_begins_with_a_full_frame(tmp_path):
    white = np.full((64, 64, 4), 255, np.uint8)
    for name, frame in (("grey.mov", SOFT_GREY), ("alpha.mov", SOFT_CUT)):
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
