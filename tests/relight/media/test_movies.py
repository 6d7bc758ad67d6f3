import os
import subprocess
import sys
from fractions import Fraction

import av
import numpy as np
import pytest
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc
from helpers import ROOT

from relight.media import colour
from relight.media.movies import Movie, is_movie, read_comment, write_movie

RNG = np.random.default_rng(0)
HEIGHT, WIDTH = 48, 64


def tiles(channels=3):
    """Even squares of 16 pixels: no chroma subsampling crosses their middles."""
    return np.kron(RNG.uniform(0.02, 0.9, (3, 4, channels)), np.ones((16, 16, 1))).astype(np.float32)


def middles(image):
    return image[8::16, 8::16]


def tags(path):
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        context = stream.codec_context
        frame = next(file.decode(stream))
        declared = (context.color_primaries, context.color_trc, context.colorspace, context.color_range)
        assert declared == (frame.color_primaries, frame.color_trc, frame.colorspace, frame.color_range)
        return stream.codec.name, context.pix_fmt, declared


@pytest.mark.parametrize(
    ("name", "channels", "expected", "tolerance"),
    [
        ("a.mp4", 3, ("h264", "yuv420p"), 0.05),
        ("a.mov", 3, ("prores", "yuv422p10le"), 0.01),
        ("a.mov", 4, ("prores", "yuva444p12le"), 0.01),
    ],
)
def test_light_comes_back_through_the_declared_colours(tmp_path, name, channels, expected, tolerance):
    picture = tiles(channels)
    if channels == 4:
        picture[..., :3] *= picture[..., 3:]
    write_movie(tmp_path / name, (picture * [*[gain] * 3, 1][:channels] for gain in (1, 0.5)), white=1)
    codec, layout, declared = tags(tmp_path / name)
    assert (codec, layout) == expected
    assert declared == (ColorPrimaries.BT709, ColorTrc.BT709, Colorspace.ITU709, ColorRange.MPEG)
    movie = Movie(tmp_path / name)
    assert list(movie.numbers) == [1, 2]
    for number, gain in ((1, 1), (2, 0.5), (1, 1)):  # and back to the first
        frame = movie.read(number)
        assert frame.dtype == np.float32
        assert frame.shape == picture.shape
        wanted = middles(picture * [*[gain] * 3, 1][:channels])
        np.testing.assert_allclose(middles(frame), wanted, atol=tolerance)


def test_the_middle_grey_is_bt709s_code(tmp_path):
    write_movie(tmp_path / "a.mp4", [np.full((HEIGHT, WIDTH, 3), 0.18, np.float32)], white=1)
    with av.open(str(tmp_path / "a.mp4")) as file:
        luma = next(file.decode(video=0)).to_ndarray()[:HEIGHT]
    assert abs(luma - (16 + 219 * (1.099 * 0.18**0.45 - 0.099))).max() <= 1


def test_highlights_roll_off_alike_in_every_frame(tmp_path):
    grey = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    lamp = grey.copy()
    lamp[16:32, 16:32] = 3.5
    write_movie(tmp_path / "a.mov", [grey, lamp])
    movie = Movie(tmp_path / "a.mov")
    first, second = movie.read(1), movie.read(2)
    np.testing.assert_allclose(second[0, 0], first[0, 0], atol=5e-3)
    assert 0.9 < second[24, 24, 0] < 1


@pytest.mark.parametrize(
    ("rate", "exact"),
    [
        (24, 24),
        (23.976, Fraction(24000, 1001)),
        (29.97, Fraction(30000, 1001)),
        (12.5, 12.5),
        (0.01, Fraction(1, 100)),
    ],
)
def test_frame_rates_are_written_exactly(tmp_path, rate, exact):
    write_movie(tmp_path / "a.mp4", [tiles()] * 3, rate=rate)
    assert Movie(tmp_path / "a.mp4").rate == exact


ENCODE = """
import hashlib, os, sys
from pathlib import Path
import numpy as np
import torch
from scipy.ndimage import gaussian_filter
from relight.media.movies import write_movie
if sys.argv[1] == "one core" and hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
torch.set_num_threads(1 if sys.argv[1] == "one core" else 3)
noise = gaussian_filter(np.random.default_rng(0).random((270, 480, 3), np.float32), (4, 4, 0))
for name in ("a.mp4", "a.mov"):
    write_movie(name, [np.roll(noise, 3 * number, axis=1) for number in range(12)])
    print(name, hashlib.sha256(Path(name).read_bytes()).hexdigest())
"""


def test_the_same_frames_give_the_same_file(tmp_path):
    """On any number of cores and threads, whatever the memory held before, which glibc fills as told."""
    made = set()
    for cores, filling in (("all cores", "0"), ("one core", "170")):
        environment = {
            **os.environ,
            "MALLOC_PERTURB_": filling,
            "PYTHONPATH": str(ROOT),
        }
        command = [sys.executable, "-c", ENCODE, cores]
        made.add(
            subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=True).stdout
        )
    assert len(made) == 1


@pytest.mark.parametrize("name", ["a.avi", "a.mkv"])
@pytest.mark.parametrize("codec", ["libx264", "mpeg4"])
def test_frames_stored_out_of_order_come_in_the_order_they_are_shown(tmp_path, name, codec):
    with av.open(str(tmp_path / name), "w") as file:
        stream = file.add_stream(codec, 25, options={"bf": "2"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for number in range(12):
            frame = av.VideoFrame.from_ndarray(np.full((HEIGHT, WIDTH, 3), 20 * number, np.uint8))
            frame.pts = number
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
        assert stream.codec_context.has_b_frames
    movie = Movie(tmp_path / name, colour_space="lin_rec709")
    for number in (*movie.numbers, 3):
        np.testing.assert_allclose(movie.read(number)[8, 8], 20 * (number - 1) / 255, atol=0.02)


def test_odd_sizes_are_made_even(tmp_path):
    write_movie(tmp_path / "a.mp4", [tiles()[:47, :61]], white=1)
    assert Movie(tmp_path / "a.mp4").read(1).shape == (48, 62, 3)


def encode(path, primaries, transfer, matrix, full, rotation=None):
    """A movie of another program: a grey of code 128 on the left, brighter on the right."""
    codes = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    codes[:, WIDTH // 2 :] = (200, 40, 40)
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", 25, options={"crf": "1"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv444p"
        context = stream.codec_context
        context.color_primaries, context.color_trc, context.colorspace = primaries, transfer, matrix
        context.color_range = ColorRange.JPEG if full else ColorRange.MPEG
        frame = av.VideoFrame.from_ndarray(codes).reformat(
            format="yuv444p",
            src_color_range=ColorRange.JPEG,
            dst_color_range=context.color_range,
            dst_colorspace=matrix if matrix in list(Colorspace) else Colorspace.ITU601,
        )
        file.mux(stream.encode(frame))
        file.mux(stream.encode())


@pytest.mark.parametrize(
    ("primaries", "transfer", "matrix", "full", "space"),
    [
        (1, 13, 1, False, "sRGB"),
        (1, 13, 6, True, "sRGB"),
        (1, 4, 1, True, "g22_rec709_scene"),
        (1, 8, 1, False, "lin_rec709"),
        (2, 2, 2, False, None),
        (9, 14, 9, False, None),
    ],
)
def test_declared_colours_are_honoured(tmp_path, primaries, transfer, matrix, full, space):
    encode(tmp_path / "a.mp4", primaries, transfer, matrix, full)
    frame = Movie(tmp_path / "a.mp4").read(1)
    codes = np.array([[[128] * 3, [200, 40, 40]]], np.float32) / 255
    if space is not None:
        expected = colour.decode(codes, space)[0]
    else:
        light = np.where(codes < 0.081, codes / 4.5, ((codes + 0.099) / 1.099) ** (1 / 0.45))
        expected = colour.decode(light.astype(np.float32), "lin_rec2020" if primaries == 9 else "lin_rec709")[
            0
        ]
    np.testing.assert_allclose(frame[8, 8], expected[0], atol=0.012)
    np.testing.assert_allclose(frame[8, -8], expected[1], atol=0.02)


def test_a_colour_space_can_be_said(tmp_path):
    encode(tmp_path / "a.mp4", 1, 1, 1, False)
    frame = Movie(tmp_path / "a.mp4", colour_space="sRGB").read(1)
    np.testing.assert_allclose(frame[8, 8], 0.2158, atol=0.01)


def test_unknown_colours_are_named(tmp_path):
    encode(tmp_path / "a.mp4", 1, 9, 1, False)  # logarithmic, of no known white
    with pytest.raises(ValueError, match=r"a\.mp4: has the transfer function 9 of ITU-T H\.273; convert it"):
        Movie(tmp_path / "a.mp4").read(1)


def test_damage_is_named_by_frame(tmp_path):
    write_movie(tmp_path / "a.mov", [tiles() for _ in range(9)])
    data = bytearray((tmp_path / "a.mov").read_bytes())
    with av.open(str(tmp_path / "a.mov")) as file:
        fourth = [packet for packet in file.demux(video=0) if packet.size][3]
        data[fourth.pos + 8 : fourth.pos + fourth.size] = bytes(fourth.size - 8)
    (tmp_path / "b.mov").write_bytes(data)
    movie, whole = Movie(tmp_path / "b.mov"), Movie(tmp_path / "a.mov")
    assert list(movie.numbers) == list(range(1, 10))
    for number in movie.numbers:
        if number == 4:
            with pytest.raises(ValueError, match=r"b\.mov: frame 4 is damaged"):
                movie.read(4)
        else:
            np.testing.assert_array_equal(movie.read(number), whole.read(number))
    with pytest.raises(ValueError, match="expected a frame of 1 to 9, got 10"):
        movie.read(10)


def test_a_missing_movie_and_a_file_that_is_no_movie_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"gone\.mp4: no such file"):
        Movie(tmp_path / "gone.mp4")
    (tmp_path / "text.mp4").write_text("not a movie")
    with pytest.raises(ValueError, match=r"text\.mp4: cannot be read as a movie"):
        Movie(tmp_path / "text.mp4")


@pytest.mark.parametrize(
    ("name", "frames", "arguments", "error", "message"),
    [
        ("a.avi", [tiles()], {}, ValueError, "expected a file name that ends in .mov, .mp4"),
        ("none/a.mp4", [tiles()], {}, FileNotFoundError, "the folder .*none does not exist"),
        ("a.mp4", [], {}, ValueError, "there are no frames"),
        ("a.mp4", [tiles(), tiles()[:16]], {}, ValueError, "frame 2 has another size"),
        ("a.mp4", [tiles(4) * 0.5], {}, ValueError, "holds no alpha; give a background, or write a .mov"),
        ("a.mp4", [tiles()], {"rate": 0}, ValueError, "rate: expected 0.01 to 1000 frames a second, got 0"),
        ("a.mp4", [tiles()], {"rate": 0.0001}, ValueError, "rate: expected 0.01 to 1000 frames a second"),
        ("a.mp4", [tiles()], {"rate": float("nan")}, ValueError, "rate: expected 0.01 to 1000"),
        ("a.mp4", [tiles()[..., 0]], {}, ValueError, "frames: expected shape"),
    ],
)
def test_write_errors_leave_nothing(tmp_path, name, frames, arguments, error, message):
    with pytest.raises(error, match=message):
        write_movie(tmp_path / name, frames, **arguments)
    assert list(tmp_path.iterdir()) == []


def test_names_of_movies():
    for suffix in (".MOV", ".mp4", ".mts", ".m2ts", ".mpg", ".mxf", ".webm", ".mkv", ".avi", ".wmv", ".3gp"):
        assert is_movie(f"a/plate{suffix}")
    assert not is_movie("plate.%04d.exr")


@pytest.mark.parametrize("suffix", [".mov", ".mp4"])
def test_tags_need_not_be_utf8(tmp_path, suffix):
    """As those of an old recorder: Latin-1."""
    path = tmp_path / f"a{suffix}"
    write_movie(path, [tiles()], comment="Zoë, Köln")
    content = path.read_bytes()
    assert "Zoë, Köln".encode() in content
    path.write_bytes(content.replace("Zoë, Köln".encode(), b"Zo\xeb, K\xf6ln  "))
    assert Movie(path).read(1).shape == (HEIGHT, WIDTH, 3)
    assert read_comment(path).startswith("Zo")


def test_an_unknown_codec_is_named(tmp_path):
    path = tmp_path / "a.mov"
    write_movie(path, [tiles()])
    content = path.read_bytes()
    assert content.count(b"apch") == 1
    path.write_bytes(content.replace(b"apch", b"zzzz"))
    with pytest.raises(ValueError, match=r"a\.mov: is in a codec that FFmpeg does not decode"):
        Movie(path).read(1)
