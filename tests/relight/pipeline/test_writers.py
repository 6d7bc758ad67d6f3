"""Several jobs that write into one folder: every frame is whole, and of one of them."""

import time

import numpy as np
import OpenImageIO as oiio
import pytest
from helpers.forked import started
from helpers.half_written import half, without_layers

import relight
from relight.media import images
from relight.media.content_hash import HASH_ATTRIBUTE

JOB = """
import sys
import numpy as np
import relight
folder, red, green = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
picture = np.zeros((180, 320, 4), np.float32)
picture[...] = (red, green, 0, 1)
picture[..., :3] *= np.random.default_rng(0).uniform(0.5, 1, (180, 320, 1))
for turn in range(3):
    for number in range(4):
        path = f"{folder}/r.{number}.exr"
        relight.write(path, picture, layers={"C_key": picture}, metadata={"job": sys.argv[2]})
"""


def test_two_jobs_at_once_leave_whole_frames_of_one_of_them(tmp_path):
    folder = tmp_path / "relit"
    folder.mkdir()
    with started(JOB, folder, 1, 0) as (red, _), started(JOB, folder, 0, 1) as (green, _):
        while red.is_alive() or green.is_alive():  # a reader in between finds whole frames too
            time.sleep(0.01)
            for path in folder.glob("r.*.exr"):
                check_of_one_job(path, tmp_path)
    assert [red.exitcode, green.exitcode] == [0, 0]
    assert sorted(path.name for path in folder.iterdir()) == [f"r.{n}.exr" for n in range(4)]
    for path in folder.iterdir():
        check_of_one_job(path, tmp_path)


def check_of_one_job(path, desk):
    """All of a frame's pixels and layers are red, or all are green."""
    copy = desk / "copy.exr"
    copy.write_bytes(path.read_bytes())
    picture, layer = relight.read(copy), relight.read_layers(copy)["C_key"]
    np.testing.assert_array_equal(picture, layer)
    colour = 0 if picture[0, 0, 0] > 0 else 1
    assert (picture[..., colour] > 0).all()
    assert not picture[..., 1 - colour].any()


@pytest.fixture
def frame(tmp_path):
    picture = np.random.default_rng(0).uniform(0, 1, (90, 160, 4)).astype(np.float32)
    path = tmp_path / "r.exr"
    images.write(path, picture, layers={"C_key": picture}, metadata={HASH_ATTRIBUTE: "a" * 32})
    assert images.read_content_hash(path) == "a" * 32
    return path


@pytest.mark.parametrize("share", [0, 0.01, 0.5, 0.98])
def test_a_truncated_frame_is_not_there(frame, share):
    whole = frame.read_bytes()
    frame.write_bytes(whole[: int(len(whole) * share)])
    assert images.read_content_hash(frame) is None


def test_a_frame_that_another_program_made_smaller_or_took_layers_from_is_not_there(frame):
    whole = frame.read_bytes()
    for change in (half, without_layers):
        frame.write_bytes(whole)
        change(oiio.ImageBuf(str(frame))).write(str(frame))
        assert oiio.ImageBuf(str(frame)).spec().get_string_attribute(HASH_ATTRIBUTE) == "a" * 32
        assert images.read_content_hash(frame) is None


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif"])
def test_png_jpeg_and_tiff_keep_the_hash_and_truncated_ones_have_none(tmp_path, suffix):
    path = tmp_path / f"r{suffix}"
    picture = np.random.default_rng(0).uniform(0, 1, (90, 160, 3)).astype(np.float32)
    images.write(path, picture, metadata={HASH_ATTRIBUTE: "b" * 32})
    assert images.read_content_hash(path) == "b" * 32
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert images.read_content_hash(path) is None
