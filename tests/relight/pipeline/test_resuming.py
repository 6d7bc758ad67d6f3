"""Shots that are interrupted, broken or asked for again: what is kept, made again, and reported."""

import warnings

import numpy as np
import OpenImageIO as oiio
import pytest
from helpers import shots
from helpers.half_written import half, without_layers
from helpers.rising import STILL
from helpers.standins import HEIGHT, WIDTH, somebody

import relight
from relight.media.movies import Movie


def test_a_broken_frame_is_reported_and_the_rest_is_done(stub, plates, tmp_path):
    broken = plates.with_name("p.0103.exr")
    whole = broken.read_bytes()
    broken.write_bytes(whole[: len(whole) // 2])
    plates.with_name("p.0105.exr").unlink()
    relight.write(plates.with_name("p.0106.exr"), somebody(value=0.6))
    outputs = [tmp_path / "r.%04d.exr", tmp_path / "r.mov"]
    problems = stub.render(plates, STILL, outputs)
    assert list(problems) == [103, 105]
    assert "p.0103.exr: " in problems[103]
    assert "p.0105.exr: no such file" in problems[105]
    assert sorted(path.name for path in tmp_path.glob("r.0*")) == [
        f"r.{n:04d}.exr" for n in (101, 102, 104, 106)
    ]
    movie = Movie(tmp_path / "r.mov")
    assert len(movie.numbers) == 6
    np.testing.assert_array_equal(movie.read(3), movie.read(2))  # held

    broken.write_bytes(whole)
    relight.write(plates.with_name("p.0105.exr"), somebody(value=0.5))
    stub.made.clear()
    assert stub.render(plates, STILL, outputs, resume=True) == {}
    assert len(stub.made) == 6  # those around, to steady it
    np.testing.assert_allclose(Movie(tmp_path / "r.mov").read(3)[5, 5, 0], 0.15, atol=0.02)
    assert not (tmp_path / "r.mov.frames").exists()
    assert (tmp_path / "r.0103.exr").exists()


def test_a_first_frame_that_cannot_be_read_is_named_with_the_one_in_its_place(stub, plates, tmp_path):
    first = plates.with_name("p.0101.exr")
    first.write_bytes(first.read_bytes()[:-20])
    relight.write(plates.with_name("p.0102.exr"), somebody() * 0)  # nobody is there, which is no mistake
    with pytest.warns(UserWarning, match=r"frame 101: .*p\.0101\.exr.*; so positions .* of frame 105"):
        problems = stub.render(plates, STILL, tmp_path / "r.%04d.exr")
    assert list(problems) == [101]
    assert {person.old_light for person in stub.made} == {stub.made[0].old_light}


@pytest.mark.parametrize("output", ["r.%04d.exr", "r.mov"])
def test_an_interruption_loses_nothing(stub, plates, tmp_path, output):
    stub.render(plates, STILL, tmp_path / f"whole_{output}")

    def interrupt(done, total, what):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stub.render(plates, STILL, tmp_path / output, progress=interrupt)
    stub.made.clear()
    steps = []
    stub.render(plates, STILL, tmp_path / output, resume=True, progress=lambda *step: steps.append(step))
    assert len(stub.made) == 5  # 104, 105, 102, 103 to steady them, and 101 for the old light
    assert steps[0] == (1, 5, "Checking")
    assert (1, 5, "Relighting") in steps
    if output.endswith("mov"):
        movies = [Movie(tmp_path / name) for name in (output, f"whole_{output}")]
        for number in range(1, 6):
            np.testing.assert_array_equal(*(movie.read(number) for movie in movies))
        assert not (tmp_path / "r.mov.frames").exists()
    else:
        for number in range(101, 106):
            pictures = [relight.read(tmp_path / f"{start}r.{number:04d}.exr") for start in ("", "whole_")]
            np.testing.assert_array_equal(*pictures)
    stub.made.clear()
    stub.render(plates, STILL, tmp_path / output, resume=True)
    assert stub.made == []  # nothing is missing
    stub.render(plates, STILL, tmp_path / output, temporal_filter=False)
    assert len(stub.made) == 5  # not asked to resume


@pytest.mark.parametrize(
    "other",
    [
        {"lights": relight.DirectionalLight(intensity=0.5, azimuth=10, name="key")},
        {"lights": [STILL, relight.DirectionalLight(name="rim")]},
        {"passes": ["albedo"]},
        {"exr_type": "float"},
        {"mask": np.ones((HEIGHT, WIDTH), np.float32)},
        {"field_of_view": 50},
    ],
)
def test_frames_made_with_something_else_are_made_anew(stub, plates, tmp_path, other):
    path = tmp_path / "r.%04d.exr"
    stub.render(plates, STILL, path)
    stub.made.clear()
    with pytest.warns(UserWarning, match="resume: 5 of 5 frames were made with other lights"):
        stub.render(plates, **{"lights": STILL, "outputs": path} | other, resume=True)
    assert len(stub.made) == 5
    stub.made.clear()
    stub.render(plates, **{"lights": STILL, "outputs": path} | other, resume=True)
    assert stub.made == []


def test_backgrounds_read_in_another_colour_space_are_composited_anew(stub, plates, tmp_path):
    for number in range(101, 106):
        relight.write(tmp_path / f"bg.{number:04d}.png", np.full((HEIGHT, WIDTH, 3), 0.3, np.float32))
    arguments = {"background": tmp_path / "bg.%04d.png"}
    stub.render(plates, STILL, tmp_path / "r.%04d.exr", **arguments)
    with pytest.warns(UserWarning, match="resume: 5 of 5 frames"):
        stub.render(
            plates, STILL, tmp_path / "r.%04d.exr", **arguments, background_colour_space="ACEScg", resume=True
        )


def test_a_chunk_that_runs_again_leaves_a_finished_movie_alone(stub, plates, tmp_path):
    path = tmp_path / "r.mov"
    chunks = (101, 102), (103, 105)
    for chunk in chunks:
        stub.render(plates, STILL, path, frames=chunk, phase="frames", resume=True)
    stub.render(plates, STILL, path, frames=(101, 105), phase="finalize", resume=True)
    before = path.read_bytes()
    stub.render(plates, STILL, path, frames=chunks[1], phase="frames", resume=True)
    stub.render(plates, STILL, path, frames=(101, 105), phase="finalize", resume=True)
    assert path.read_bytes() == before
    assert not (tmp_path / "r.mov.frames").exists()


@pytest.mark.parametrize("name", ["r.%04d.exr", "r.%04d.png", "r.%04d.tif", "r.%04d.jpg"])
def test_one_plate_that_changed_is_made_anew(stub, plates, tmp_path, name):
    arguments = {
        "background": (0.1, 0.1, 0.1),
        "temporal_filter": False,
        "save_matte": tmp_path / "m.%04d.png",
    }
    stub.render(plates, STILL, tmp_path / name, **arguments)
    relight.write(plates.with_name("p.0102.exr"), somebody(value=0.9))
    kept = (tmp_path / "m.0103.png").stat().st_ino
    changed = (tmp_path / "m.0102.png").stat().st_ino
    stub.made.clear()
    with pytest.warns(UserWarning, match="resume: 1 of 5 frames"):
        stub.render(plates, STILL, tmp_path / name, resume=True, **arguments)
    assert len(stub.made) == 2  # with 101, for the old light
    assert (tmp_path / "m.0103.png").stat().st_ino == kept
    assert (tmp_path / "m.0102.png").stat().st_ino != changed


def test_what_is_filtered_by_a_plate_that_changed_is_made_anew(stub, plates, tmp_path):
    stub.render(plates, STILL, tmp_path / "r.%04d.exr")
    relight.write(plates.with_name("p.0105.exr"), somebody(value=0.9))
    with pytest.warns(UserWarning, match="resume: 3 of 5 frames"):
        stub.render(plates, STILL, tmp_path / "r.%04d.exr", resume=True)


def test_a_first_frame_that_changed_is_another_old_light_for_all(stub, plates, tmp_path):
    arguments = {"temporal_filter": False}
    stub.render(plates, STILL, tmp_path / "r.%04d.exr", **arguments)
    relight.write(plates.with_name("p.0101.exr"), somebody(value=0.9))
    with pytest.warns(UserWarning, match="resume: 5 of 5 frames"):
        stub.render(plates, STILL, tmp_path / "r.%04d.exr", resume=True, **arguments)


def test_display_is_no_part_of_scene_linear_frames(stub, plates, tmp_path):
    outputs = [tmp_path / "r.%04d.exr", tmp_path / "r.%04d.png"]
    stub.render(plates, STILL, outputs)
    before = [(tmp_path / name).stat().st_ino for name in ("r.0101.exr", "r.0101.png")]
    with pytest.warns(UserWarning, match="resume: 5 of 5 frames"):
        stub.render(plates, STILL, outputs, exposure=1, resume=True)
    after = [(tmp_path / name).stat().st_ino for name in ("r.0101.exr", "r.0101.png")]
    assert before[0] == after[0]
    assert before[1] != after[1]


@pytest.mark.parametrize("other", [{"frames": (101, 105)}, {"rate": 25}, {"exposure": 1}])
def test_a_finished_movie_that_is_asked_to_be_another_is_made_anew(stub, plates, tmp_path, other):
    arguments = {"frames": (101, 103), "rate": 24, "exposure": 0}
    stub.render(plates, STILL, tmp_path / "r.mov", **arguments)
    with pytest.warns(UserWarning, match="frames were made with other"):
        stub.render(plates, STILL, tmp_path / "r.mov", **arguments | other, resume=True)
    movie = Movie(tmp_path / "r.mov")
    assert len(movie.numbers) == len(range(*(arguments | other)["frames"])) + 1
    assert movie.rate == (arguments | other)["rate"]
    assert not (tmp_path / "r.mov.frames").exists()


def test_an_environment_counts_by_its_pixels(stub, plates, tmp_path):
    path = tmp_path / "r.%04d.exr"
    sky = np.full((2, 4, 3), 0.5, np.float32)
    for name, pixels, others in (("a", sky, 0), ("b", sky, 0), ("b", sky * 2, 5)):
        relight.write(tmp_path / f"{name}.exr", pixels)
        light = relight.EnvironmentLight(tmp_path / f"{name}.exr", intensity=0.5, name="sky")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            stub.render(plates, light, path, resume=True)
        assert [str(one.message)[:12] for one in caught] == ([f"resume: {others} of"] if others else [])


@pytest.mark.slow
def test_one_frame_that_cannot_be_made_leaves_the_rest(tmp_path):
    """With networks and filter: a sliver of a person in one frame, light beyond half floats in another."""
    plate = np.zeros((540, 60, 4), np.float32)
    plate[100:300, 10:50] = (0.4, 0.3, 0.2, 1)
    sliver = np.zeros_like(plate)
    sliver[:, 20] = 1
    (tmp_path / "plates").mkdir()
    for number, image in enumerate((plate, sliver, plate, plate, plate), 1):
        relight.write(tmp_path / "plates" / f"p.{number}.exr", image)
    light = relight.MovingLight(intensity={3: 0.5, 4: 1e6, 5: 0.5})
    arguments = {
        "source": tmp_path / "plates" / "p.%d.exr",
        "lights": light,
        "outputs": tmp_path / "r.%d.exr",
    }
    assert list(shots.render(**arguments)) == [2, 4]
    assert sorted(path.name for path in tmp_path.glob("r.*")) == ["r.1.exr", "r.3.exr", "r.5.exr"]
    with pytest.warns(UserWarning, match="resume: 3 of 5 frames"):
        assert list(shots.render(**arguments, exr_type="float", resume=True)) == [2]
    assert relight.read(tmp_path / "r.4.exr").max() > 65504


def test_frames_that_another_program_changed_are_made_anew(stub, plates, tmp_path):
    """Their size, or layers; or they are cut short. All still say what made them."""
    stub.render(plates, STILL, tmp_path / "r.%04d.exr")
    first, second, third = (tmp_path / f"r.{number:04d}.exr" for number in (101, 102, 103))
    half(oiio.ImageBuf(str(first))).write(str(first))
    without_layers(oiio.ImageBuf(str(second))).write(str(second))
    third.write_bytes(third.read_bytes()[:-100])
    kept = [(tmp_path / f"r.{number:04d}.exr").stat().st_ino for number in (104, 105)]
    with pytest.warns(UserWarning, match="resume: 3 of 5 frames"):
        assert stub.render(plates, STILL, tmp_path / "r.%04d.exr", resume=True) == {}
    assert kept == [(tmp_path / f"r.{number:04d}.exr").stat().st_ino for number in (104, 105)]
    for path in (first, second, third):
        assert relight.read(path).shape == (HEIGHT, WIDTH, 4)
        assert set(relight.read_layers(path)) == {"C_key"}


def test_frames_of_another_precision_or_other_threads_are_made_anew(stub, plates, tmp_path):
    path = tmp_path / "r.%04d.exr"
    stub.render(plates, STILL, path, precision="float32", threads=1)
    for precision, threads in (("bfloat16", 1), ("bfloat16", 2)):
        with pytest.warns(UserWarning, match="resume: 5 of 5 frames"):
            stub.render(plates, STILL, path, precision=precision, threads=threads, resume=True)


def test_a_full_disk_keeps_what_is_finished(stub, plates, tmp_path, full_disk):
    with full_disk(lambda: len(list(tmp_path.glob("r.*.exr"))) >= 3):
        problems = stub.render(plates, STILL, tmp_path / "r.%04d.exr")
    assert list(problems) == [104, 105]
    assert "No space left on device" in problems[104]
    there = {path: path.stat().st_ino for path in tmp_path.glob("r.*")}
    assert len(there) == 3
    assert stub.render(plates, STILL, tmp_path / "r.%04d.exr", resume=True) == {}
    assert all(path.stat().st_ino == inode for path, inode in there.items())
    assert len(list(tmp_path.glob("r.*.exr"))) == 5
