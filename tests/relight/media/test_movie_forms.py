"""Codecs of movies, and light beyond a display's white."""

import av
import numpy as np
import pytest
from av.video.reformatter import ColorPrimaries, Colorspace, ColorTrc
from helpers.rising import STILL

from relight.media.encodings import decode_hlg, decode_pq, encode_hlg, encode_pq
from relight.media.movies import Form, Movie, write_movie

LIGHT = np.array([0.01, 0.18, 0.5, 1, 3], np.float32)  # 3 is 609 cd/m² in PQ; HLG ends at 3.77
BT2020 = (ColorPrimaries.BT2020, Colorspace.BT2020)


def bars(size=(120, 260)):
    """Grey bars of these lights, linear Rec.709."""
    rows = np.repeat(LIGHT, size[1] // len(LIGHT))
    return np.broadcast_to(rows[None, :, None], (*size, 3)).astype(np.float32)


def middles(frame):
    width = frame.shape[1] // len(LIGHT)
    return frame[10, width // 2 :: width]


def stream_of(path):
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        context = stream.codec_context
        return stream.codec_context.name, context.pix_fmt, context.codec_tag, next(file.decode(stream))


@pytest.mark.parametrize(("encode", "decode"), [(encode_hlg, decode_hlg), (encode_pq, decode_pq)])
def test_codes_of_light_come_back(encode, decode):
    np.testing.assert_allclose(decode(encode(LIGHT)), LIGHT, rtol=1e-5)


@pytest.mark.parametrize("hdr", ["hlg", "pq"])
@pytest.mark.parametrize(
    ("name", "codec", "layout"),
    [("m.mp4", "hevc", "yuv420p10le"), ("m.mov", "prores", "yuv422p10le")],
)
def test_light_beyond_white_is_delivered_with_its_tags(tmp_path, name, codec, layout, hdr):
    path = tmp_path / name
    write_movie(path, [bars()], form=Form(codec, hdr))
    kind, stored, tag, frame = stream_of(path)
    assert (kind, stored) == (codec, layout)
    transfer = ColorTrc.ARIB_STD_B67 if hdr == "hlg" else ColorTrc.SMPTE2084
    assert (frame.color_primaries, frame.colorspace, frame.color_trc) == (*BT2020, transfer)
    assert codec != "hevc" or tag == "hvc1"
    np.testing.assert_allclose(middles(Movie(path).read(1)), LIGHT[:, None].repeat(3, 1), rtol=0.04)


def test_dnxhr_in_bt709(tmp_path):
    write_movie(tmp_path / "m.mov", [bars()], white=1, form=Form("dnxhr"))
    np.testing.assert_allclose(middles(Movie(tmp_path / "m.mov").read(1))[:4, 0], LIGHT[:4], rtol=0.04)


@pytest.fixture
def clip(tmp_path):
    """A frame in HLG with a bright sky, and a matte."""
    write_movie(tmp_path / "clip.mov", [bars()], form=Form(hdr="hlg"))
    matte = np.zeros((120, 260), np.float32)
    matte[40:110, 100:150] = 1
    return tmp_path / "clip.mov", matte


def test_a_clip_in_hlg_keeps_its_background_in_hlg(clip, stub, tmp_path):
    source, matte = clip
    stub.render(source, STILL, tmp_path / "r.mp4", mask=matte, hdr="hlg")
    np.testing.assert_allclose(middles(Movie(tmp_path / "r.mp4").read(1))[3:, 0], LIGHT[3:], rtol=0.04)


def test_conversion_to_bt709_is_said(clip, stub, tmp_path):
    source, matte = clip
    with pytest.warns(
        UserWarning, match=r"clip\.mov: HLG is converted to BT\.709, unless it is kept in movies \(hdr=hlg\)"
    ):
        stub.render(source, STILL, tmp_path / "r.mp4", mask=matte)
    assert Movie(tmp_path / "r.mp4").hdr_name() is None


def hdr10(path):
    """Write a grey movie in PQ, with the metadata of HDR10: the mastering display and light levels."""
    display = "G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)L(10000000,1)"
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx265", 24)
        stream.width, stream.height, stream.pix_fmt = 260, 120, "yuv420p10le"
        context = stream.codec_context
        context.color_primaries, context.colorspace, context.color_trc = *BT2020, ColorTrc.SMPTE2084
        stated = f"hdr10=1:master-display={display}:max-cll=1000,400"
        context.options = {"x265-params": f"log-level=none:bframes=0:{stated}"}
        frame = av.VideoFrame.from_ndarray(np.full((120, 260, 3), 30000, np.uint16), format="rgb48le")
        frame = frame.reformat(format="yuv420p10le")
        frame.pts = 0
        file.mux(stream.encode(frame))
        file.mux(stream.encode())


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
def test_the_metadata_of_hdr10_is_said_to_be_lost(clip, stub, tmp_path, suffix):
    source, (_, matte) = tmp_path / f"pq{suffix}", clip
    hdr10(source)
    assert Movie(source).hdr_name() == "PQ"
    with pytest.warns(UserWarning, match=rf"pq\{suffix}: its HDR10 metadata .* is not passed on") as said:
        stub.render(source, STILL, tmp_path / "r.mp4", mask=matte, hdr="pq")
    assert len([each for each in said if "HDR10" in str(each.message)]) == 1
    assert not Movie(tmp_path / "r.mp4").has_mastering_metadata()


def test_a_movie_without_that_metadata_has_no_warning_of_it(clip, stub, tmp_path, recwarn):
    source, matte = clip
    stub.render(source, STILL, tmp_path / "r.mp4", mask=matte, hdr="hlg")
    assert not [each for each in recwarn if "HDR10" in str(each.message)]


def test_resume_makes_frames_of_another_form_again(clip, stub, tmp_path):
    source, matte = clip
    for hdr in ("hlg", "pq"):
        stub.render(source, STILL, tmp_path / "r.mp4", mask=matte, hdr=hdr, resume=True)
        assert Movie(tmp_path / "r.mp4").hdr_name() == hdr.upper()


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("r.mp4", {"codec": "prores"}, r"codec: expected h264 or hevc for .*r\.mp4, got prores"),
        ("r.mov", {"codec": "hevc"}, r"codec: expected prores or dnxhr for .*r\.mov, got hevc"),
        ("r.mp4", {"codec": "h264", "hdr": "pq"}, r"codec: expected hevc .* H.264 has 8 bits"),
        ("r.mov", {"codec": "dnxhr", "hdr": "pq"}, r"codec: expected .* prores .* states the matrix"),
        ("r.mov", {"codec": "dnxhr", "background": "none"}, r"r\.mov: dnxhr holds no alpha"),
        ("r.mov", {"codec": "dnxhr", "size": (64, 64)}, r"r\.mov: expected at least 256 x 120 pixels"),
        ("r.%d.png", {"hdr": "pq"}, r"hdr: is that of movies; expected one"),
        ("r.mp4", {"hdr": "pq", "view": "aces"}, r"view: expected none with hdr"),
        ("r.mp4", {"hdr": "pq", "white": 2}, r"white: expected none with hdr"),
    ],
)
def test_what_cannot_be_is_refused_at_once(clip, stub, tmp_path, name, options, message):
    source, matte = clip
    with pytest.raises(ValueError, match=message):
        stub.render(source, STILL, tmp_path / name, mask=matte, **{"background": (0, 0, 0)} | options)
    assert stub.made == []
