"""What movies state of their pictures and times: mirrors, matrices, Dolby Vision, cover art, joined parts."""

import io
import struct
import warnings
from fractions import Fraction

import av
import numpy as np
import pytest
from helpers.apertures import aperture, clip_movie
from helpers.foreign_files import movie, ramp
from PIL import Image

from relight.media import video_frames
from relight.media.movies import MatteMovie, Movie
from relight.pipeline.plate_metadata import PlateMetadataReader

ONE = 1 << 16
CORNERS = np.zeros((64, 96, 3), np.uint8)  # red, green / blue, white
CORNERS[:32, :48, 0] = CORNERS[:32, 48:, 1] = CORNERS[32:, :48, 2] = 255
CORNERS[32:, 48:] = 255
CODES = np.array([200, 100, 50]) / 255
LIGHT = ((CODES + 0.099) / 1.099) ** (1 / 0.45)  # BT.709's curve


def with_display_matrix(path, a, b, c, d):
    head, track, tail = path.read_bytes().partition(b"tkhd")
    identity = struct.pack(">9i", ONE, 0, 0, 0, ONE, 0, 0, 0, 1 << 30)
    assert identity in tail[:120]
    stated = struct.pack(">9i", *(round(x * ONE) for x in (a, b, 0, c, d, 0, 0, 0)), 1 << 30)
    path.write_bytes(head + track + tail.replace(identity, stated, 1))


@pytest.mark.parametrize(
    ("matrix", "shown"),
    [
        ((-1, 0, 0, 1), CORNERS[:, ::-1]),
        ((1, 0, 0, -1), CORNERS[::-1]),
        ((-1, 0, 0, -1), CORNERS[::-1, ::-1]),
        ((0, 1, 1, 0), CORNERS.transpose(1, 0, 2)),
        ((0, 1, -1, 0), np.rot90(CORNERS, -1)),
        ((0, -1, -1, 0), np.rot90(CORNERS.transpose(1, 0, 2), 2)),
        ((0, -1, 1, 0), np.rot90(CORNERS)),
    ],
)
@pytest.mark.parametrize(
    ("codec", "layout", "name", "field"),
    [
        ("libx264", "yuv444p", "a.mp4", None),
        ("qtrle", "rgb24", "a.mov", None),
        ("prores_ks", "yuv422p10le", "b.mov", "tff"),
    ],
)
@pytest.mark.states("Movies", "a display matrix that mirrors or turns by quarters of a circle", "honoured")
def test_mirrored_and_turned_movies_stand_as_their_matrix_says(
    tmp_path, codec, layout, name, field, matrix, shown
):
    movie(tmp_path / name, [CORNERS] * 3, codec=codec, layout=layout, field=field)
    with_display_matrix(tmp_path / name, *matrix)
    found = Movie(tmp_path / name).read(2)
    np.testing.assert_array_equal(found[16::32, 16::32] > 0.5, shown[16::32, 16::32] > 127)


@pytest.mark.parametrize(
    ("matrix", "shown"), [((0, 1, -1, 0), np.rot90(CORNERS, -1)), ((-1, 0, 0, 1), CORNERS[:, ::-1])]
)
@pytest.mark.parametrize("name", ["b.mkv", "b.mp4"])
def test_the_matrix_counts_in_other_containers(tmp_path, name, matrix, shown):
    """Matroska states the angle and mirror of a projection; a fragmented .mp4 has its tracks in front."""
    movie(tmp_path / "a.mp4", [CORNERS] * 3, codec="libx264", layout="yuv444p")
    with_display_matrix(tmp_path / "a.mp4", *matrix)
    options = {"movflags": "frag_keyframe+empty_moov"} if name == "b.mp4" else {}
    with (
        av.open(str(tmp_path / "a.mp4")) as source,
        av.open(str(tmp_path / name), "w", options=options) as file,
    ):
        stream = file.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                file.mux(packet)
    found = Movie(tmp_path / name).read(2)
    np.testing.assert_array_equal(found[16::32, 16::32] > 0.5, shown[16::32, 16::32] > 127)


@pytest.mark.parametrize("matrix", [(0.8, 0.6, -0.6, 0.8), (1, 0, 0.5, 1)])
@pytest.mark.filterwarnings("ignore:.*times as wide as high")
@pytest.mark.states("Movies", "a display matrix of another angle, or that shears", "refused")
def test_a_matrix_of_another_angle_is_refused(tmp_path, matrix):
    movie(tmp_path / "a.mov", [CORNERS] * 2, codec="qtrle", layout="rgb24")
    with_display_matrix(tmp_path / "a.mov", *matrix)
    with pytest.raises(ValueError, match=r"a\.mov: has a display matrix"):
        Movie(tmp_path / "a.mov").read(1)


def ycgco(layout, full):
    """A frame of CODES in YCgCo in a planar layout, by ITU-T H.273's equations."""
    red, green, blue = CODES
    values = (green / 2 + (red + blue) / 4, green / 2 - (red + blue) / 4, (red - blue) / 2)
    frame = av.VideoFrame(64, 64, layout)
    for component, value in zip(frame.format.components, values, strict=False):
        bits, is_luma = component.bits, component.is_luma
        scale = (2**bits - 1) if full else (219 if is_luma else 224) << (bits - 8)
        zero = (0 if full else 16 << (bits - 8)) if is_luma else 1 << (bits - 1)
        plane, kind = frame.planes[component.plane], "u1" if bits == 8 else "<u2"
        plane.update(np.full(plane.buffer_size // np.dtype(kind).itemsize, round(zero + scale * value), kind))
    frame.colorspace, frame.color_range = 8, 2 if full else 1
    return frame


@pytest.mark.parametrize("full", [True, False])
@pytest.mark.parametrize("layout", ["yuv444p", "yuv420p", "yuv422p10le", "yuv444p12le"])
@pytest.mark.states("Movies", "the matrix YCgCo", "honoured")
def test_ycgco_is_decoded_in_every_layout(layout, full):
    found = video_frames.read_codes(ycgco(layout, full), "h264")
    np.testing.assert_allclose(found[5, 5] / 65535, CODES, atol=0.006)


@pytest.mark.parametrize("matrix", [10, 11, 13, 14, 15, 16])
@pytest.mark.states("Movies", "ICtCp, constant luminance, other matrices that are not undone", "refused")
def test_matrices_that_cannot_be_undone_are_refused(tmp_path, matrix):
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as file:
        stream = file.add_stream("ffv1", 25)
        stream.width = stream.height = 64
        stream.pix_fmt = "yuv444p"
        stream.codec_context.colorspace = matrix
        frame = ycgco("yuv444p", False)
        frame.colorspace, frame.pts, frame.time_base = matrix, 0, Fraction(1, 25)
        file.mux(stream.encode(frame))
        file.mux(stream.encode())
    with pytest.raises(ValueError, match=rf"a\.mkv: has the matrix coefficients {matrix}"):
        Movie(path).read(1)


@pytest.mark.parametrize("stated", [5, 6])
def test_the_matrix_of_small_pictures_counts_in_large_ones_too(stated):
    frame = av.VideoFrame.from_ndarray(np.full((720, 64, 3), (200, 100, 50), np.uint8), format="rgb24")
    frame = frame.reformat(format="yuv444p", dst_colorspace=5, src_color_range=2, dst_color_range=1)
    frame.colorspace, frame.color_range = stated, 1
    np.testing.assert_allclose(video_frames.read_codes(frame, "h264")[5, 5] / 65535, CODES, atol=0.006)


def with_dolby_vision(path, codec, profile, compatibility):
    """Add Dolby Vision's configuration to the only track of an .mp4."""
    data = bytearray(path.read_bytes())
    record = struct.pack(">5B19x", 1, 0, profile << 1, 6 << 3 | 5, compatibility << 4)
    box = struct.pack(">I4s", 8 + len(record), b"dvcC" if profile < 8 else b"dvvC") + record
    start, end, chain = 0, len(data), []
    for kind, skipped in (
        *((name, 0) for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl")),
        (b"stsd", 8),
        (codec, 0),
    ):
        while data[start + 4 : start + 8] != kind:
            start += struct.unpack_from(">I", data, start)[0]
        chain.append(start)
        start, end = start + 8 + skipped, start + struct.unpack_from(">I", data, start)[0]
    data[end:end] = box
    for at in chain:
        struct.pack_into(">I", data, at, struct.unpack_from(">I", data, at)[0] + len(box))
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("codec", "box", "profile", "compatibility", "refused"),
    [
        ("libx265", b"hev1", 5, 0, True),
        ("libsvtav1", b"av01", 10, 0, True),
        ("libx264", b"avc1", 9, 0, True),
        ("libx265", b"hev1", 8, 4, False),
        ("libsvtav1", b"av01", 10, 1, False),
    ],
)
@pytest.mark.states("Movies", "Dolby Vision without a compatible base (profile 5)", "refused")
def test_dolby_vision_with_colours_of_its_own_is_refused(
    tmp_path, codec, box, profile, compatibility, refused
):
    options = {"x265-params": "log-level=none:bframes=0"} if codec == "libx265" else None
    movie(tmp_path / "a.mp4", [ramp()] * 2, codec=codec, layout="yuv420p", options=options)
    with_dolby_vision(tmp_path / "a.mp4", box, profile, compatibility)
    if refused:
        with pytest.raises(ValueError, match=rf"a\.mp4: is in Dolby Vision profile {profile}"):
            Movie(tmp_path / "a.mp4")
    else:
        assert Movie(tmp_path / "a.mp4").read(1).shape == (64, 64, 3)


@pytest.mark.parametrize("name", ["a.m4v", "a.mp4", "a.mkv"])
@pytest.mark.states("Movies", "cover art before or after the video stream", "honoured")
def test_cover_art_is_not_the_movie(tmp_path, name):
    frames = [np.full((64, 64, 3), code, np.uint8) for code in (40, 80, 120)]
    movie(tmp_path / "plain.mp4", frames, codec="libx264", layout="yuv420p")
    with av.open(str(tmp_path / name), "w", format="mp4" if name != "a.mkv" else None) as file:
        if name == "a.mkv":
            png = io.BytesIO()
            Image.fromarray(frames[0][:32]).save(png, "PNG")
            file.add_attachment("cover.png", "image/png", png.getvalue())
        else:
            cover = file.add_stream("png", 1)
            cover.width, cover.height, cover.pix_fmt = 64, 32, "rgb24"
            cover.disposition = av.stream.Disposition.attached_pic
            picture = av.VideoFrame.from_ndarray(frames[0][:32], format="rgb24")
            picture.pts = 0
        with av.open(str(tmp_path / "plain.mp4")) as source:
            stream = file.add_stream_from_template(source.streams.video[0])
            for packet in source.demux(video=0):
                if packet.dts is not None:
                    packet.stream = stream
                    file.mux(packet)
        if name != "a.mkv":
            file.mux(cover.encode(picture))
            file.mux(cover.encode())
    found = Movie(tmp_path / name)
    assert list(found.numbers) == [1, 2, 3]
    assert found.read(3).shape == (64, 64, 3)


@pytest.mark.parametrize(
    ("codec", "name"),
    [("libx264", "a.ts"), ("mpeg2video", "a.mpg"), ("libx264", "a.m2ts"), ("mpeg2video", "a.mts")],
)
@pytest.mark.states("Movies", "times that start again in joined transport streams", "warned of")
def test_parts_of_a_joined_stream_are_read_one_after_the_other(tmp_path, codec, name):
    content = b""
    for start in (10, 100, 180):
        frames = [np.full((64, 64, 3), start + 6 * number, np.uint8) for number in range(10)]
        movie(tmp_path / name, frames, codec=codec, layout="yuv420p")
        content += (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(content)
    with pytest.warns(UserWarning, match=rf"{name}: consists of parts whose times start again"):
        found = Movie(tmp_path / name)
    levels = [float(found.read(number)[5, 5, 0]) for number in found.numbers]
    assert len(levels) == 30
    assert levels == sorted(levels)
    assert float(found.read(12)[5, 5, 0]) == levels[11]  # going back starts over


def at_times(path, times):
    """A movie with sound whose frames are shown at some times, in 1/1000 s."""
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", 25, options={"bf": "0"})
        stream.width = stream.height = 64
        stream.pix_fmt, stream.time_base = "yuv420p", Fraction(1, 1000)
        stream.codec_context.time_base = Fraction(1, 1000)
        sound = file.add_stream("aac", 48000)
        for time in times:
            frame = av.VideoFrame.from_ndarray(ramp(), format="rgb24").reformat(format="yuv420p")
            frame.pts, frame.time_base = time, Fraction(1, 1000)
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
        silence = av.AudioFrame.from_ndarray(np.zeros((1, 48000), np.float32), "fltp", "mono")
        silence.sample_rate = 48000
        file.mux(sound.encode(silence))
        file.mux(sound.encode())


@pytest.mark.parametrize(
    ("name", "times"),
    [
        ("a.mkv", [*range(0, 600, 40), *range(600, 1800, 120)]),
        ("a.mp4", [*range(0, 600, 40), *range(600, 1800, 120)]),
        ("a.mov", [*range(0, 1200, 120), *range(1200, 1800, 40)]),  # slower first
        ("a.mp4", [*range(0, 400, 40), 3000]),  # a last frame that stands
        ("a.mkv", [*range(0, 400, 40), *range(1400, 1800, 40)]),  # a gap
    ],
)
@pytest.mark.states("Movies", "a variable frame rate", "warned of")
def test_sound_is_left_out_where_the_frame_rate_varies(tmp_path, name, times):
    at_times(tmp_path / name, times)
    with pytest.warns(UserWarning, match=rf"{name}: has a variable frame rate"):
        found = Movie(tmp_path / name)
    assert PlateMetadataReader(found).at(1).sound is None


@pytest.mark.parametrize("name", ["a.mkv", "a.mp4"])
def test_sound_stays_where_frames_are_a_little_late(tmp_path, name):
    at_times(tmp_path / name, [40 * number + (0, 3, -4, 8)[number % 4] for number in range(20)][1:])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = Movie(tmp_path / name)
    assert PlateMetadataReader(found).at(1).sound == tmp_path / name


@pytest.mark.states("Movies", "the display matrix of a matte", "honoured")
def test_mattes_are_mirrored_as_their_pictures_are(tmp_path):
    matte = np.zeros((64, 64, 3), np.uint8)
    matte[:, 40:] = 255
    movie(tmp_path / "a.mov", [matte] * 2, codec="qtrle", layout="rgb24")
    with_display_matrix(tmp_path / "a.mov", -1, 0, 0, 1)
    np.testing.assert_allclose(MatteMovie(tmp_path / "a.mov").read(1), matte[:, ::-1, 0] / 255, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "codec", "layout"),
    [
        ("a.mov", "qtrle", "rgb24"),
        ("a.mov", "prores_ks", "yuv444p10le"),
        ("a.mp4", "libx264", "yuv444p"),
        ("a.mov", "png", "rgb24"),
    ],
)
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.states("Movies", "the clean aperture (clap), before the display matrix", "honoured")
def test_a_clean_aperture_is_what_is_shown(tmp_path, name, codec, layout, turned):
    path = tmp_path / name
    movie(path, [ramp(64, 96)] * 2, codec=codec, layout=layout)
    whole = Movie(path).read(1)
    clip_movie(path, aperture(64, 40, -4, 2))
    if turned:
        with_display_matrix(path, 0, 1, -1, 0)
    shown = whole[14:54, 12:76]
    found = Movie(path)
    for number in (1, 2, 1):
        np.testing.assert_allclose(found.read(number), np.rot90(shown, -1) if turned else shown, atol=0.02)
    matte = np.full((64, 96, 3), 255, np.uint8)
    matte[:14], matte[:, :12] = 0, 0
    movie(path, [matte] * 2, codec=codec, layout=layout)
    clip_movie(path, aperture(64, 40, -4, 2))
    np.testing.assert_allclose(MatteMovie(path).read(2), np.ones((40, 64)), atol=0.1)


@pytest.mark.parametrize("box", [(0, 0, 0, 0), (1, 1, 60, 0), (200, 40, 0, 0)])
@pytest.mark.states("Movies", "a clean aperture that does not lie in its pictures", "refused")
def test_a_clean_aperture_beyond_the_picture_is_refused(tmp_path, box):
    movie(tmp_path / "a.mov", [ramp(64, 96)], codec="qtrle", layout="rgb24")
    clip_movie(tmp_path / "a.mov", aperture(*box))
    with pytest.raises(ValueError, match=r"a\.mov: (frame 1 )?is damaged"):
        Movie(tmp_path / "a.mov").read(1)
