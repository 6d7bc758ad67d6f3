import errno
import gc
import os
import tracemalloc
import warnings

import numpy as np
import OpenImageIO as oiio
import pytest
import torch
from killing import differences
from test_writers import half, without_layers

import relight
from relight import people, video
from relight.lights.light import by_name
from relight.media.movies import Movie, write_movie

RISING = relight.MovingLight(intensity={1: 0.1, 5: 0.5}, name="key")
STILL = relight.DirectionalLight(intensity=0.5, name="key")
HEIGHT, WIDTH = 12, 16


def person(column=4, value=1.0):
    """Somebody four pixels wide, (H, W, 4)."""
    image = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    image[2:10, column : column + 4] = (value, value, value, 1)
    return image


class Stub:
    """Stands in for Subject: as bright as the image times the lights' intensities."""

    made, steadied_by = [], []

    def __init__(self, image, mask=None, normals=None, device=None, **room):
        alpha = image[..., 3] if mask is None else mask
        self.image = np.concatenate([image[..., :3] * alpha[..., None], alpha[..., None]], axis=-1)
        self.albedo = self.normals = image[..., :3]
        self.size, self.matte = alpha.shape, alpha
        Stub.made.append(self)

    def relit(self, light):
        return self.image * np.float32([light.intensity] * 3 + [1])

    def pixels_in_each(self, lights):
        for name, light in by_name(lights).items():
            yield name, torch.from_numpy(self.relit(light)).flatten(0, 1)

    def on_plate(self, pixels):
        return pixels.numpy().reshape(*self.size, -1)

    def lighting(self, lights):
        return self.albedo

    def unshadowed(self, light):
        return self.image[..., 3]

    def steadied(self, around):
        Stub.steadied_by.append(len(around))
        return self


@pytest.fixture
def stub(monkeypatch):
    monkeypatch.setattr(people, "Subject", Stub)
    Stub.made, Stub.steadied_by = [], []
    return Stub


@pytest.fixture
def plates(tmp_path):
    """Five frames, 101 to 105, of somebody who walks and grows brighter."""
    (tmp_path / "plates").mkdir()
    for number in range(101, 106):
        relight.write(tmp_path / "plates" / f"p.{number:04d}.exr", person(number - 99, 0.1 * (number - 100)))
    return tmp_path / "plates" / "p.####.exr"


def brightness(path):
    picture = relight.read(path)
    return float(picture[..., 0].max())


# What moves


def test_a_moving_light_on_a_still(stub, tmp_path):
    steps = []
    problems = video.render_video(
        person(), RISING, tmp_path / "r.%03d.exr", progress=lambda *step: steps.append(step)
    )
    assert problems == {}
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"r.{n:03d}.exr" for n in range(1, 6)]
    found = [brightness(tmp_path / f"r.{n:03d}.exr") for n in range(1, 6)]
    np.testing.assert_allclose(found, [0.1, 0.2, 0.3, 0.4, 0.5], rtol=1e-3)
    assert len(stub.made) == 1
    assert steps == [(n, 5, "Relighting") for n in range(1, 6)]
    assert set(relight.read_layers(tmp_path / "r.002.exr")) == {"C_key"}


def test_a_still_light_on_somebody_who_moves(stub, plates, tmp_path):
    video.render_video(plates, STILL, tmp_path / "r.%04d.exr", passes=["N", "visibility"])
    for number in range(101, 106):
        picture = relight.read(tmp_path / f"r.{number:04d}.exr")
        np.testing.assert_allclose(picture, person(number - 99, 0.05 * (number - 100)), atol=1e-3)
    assert len(stub.made) == 5
    assert stub.steadied_by == [2, 3, 4, 3, 2]
    assert set(relight.read_layers(tmp_path / "r.0101.exr")) == {"C_key", "N", "visibility_key"}


def test_both_move_and_nothing_is_steadied_unless_asked(stub, plates, tmp_path):
    light = relight.MovingLight(intensity={101: 1, 105: 5})
    video.render_video(plates, light, tmp_path / "r.%04d.png", steady=False, frames=(102, 104), white=1)
    assert stub.steadied_by == []
    found = [brightness(tmp_path / f"r.{n:04d}.png") for n in (102, 103, 104)]
    np.testing.assert_allclose(found, [0.4, 0.9, 1.0], atol=0.01)
    assert len(list(tmp_path.glob("r.*"))) == 3


def test_mattes_and_backgrounds_move_too(stub, plates, tmp_path):
    for number in range(101, 106):
        relight.write_mask(tmp_path / f"m.{number:04d}.png", person(number - 99)[..., 3])
        relight.write(tmp_path / f"b.{number:04d}.exr", np.full((HEIGHT, WIDTH, 3), number - 100, np.float32))
    video.render_video(
        plates,
        STILL,
        tmp_path / "r.%04d.exr",
        mask=tmp_path / "m.%04d.png",
        background=tmp_path / "b.%04d.exr",
    )
    for number in (101, 105):
        picture = relight.read(tmp_path / f"r.{number:04d}.exr")
        assert picture.shape == (HEIGHT, WIDTH, 3)
        np.testing.assert_allclose(picture[0, 0], number - 100, rtol=1e-3)
        np.testing.assert_allclose(picture[5, number - 98], 0.05 * (number - 100), rtol=1e-2)


def test_a_movie_in_and_a_movie_out(stub, tmp_path):
    write_movie(tmp_path / "in.mov", [person(n, 0.5) for n in (2, 4, 6)], rate=25, white=1)
    write_movie(tmp_path / "matte.mp4", [person(n)[..., 3:].repeat(3, -1) for n in (2, 4, 6)], white=1)
    outputs = [tmp_path / "out.mp4", tmp_path / "out.mov"]
    video.render_video(tmp_path / "in.mov", STILL, outputs[1], white=1)
    video.render_video(
        tmp_path / "in.mov",
        STILL,
        outputs[0],
        mask=tmp_path / "matte.mp4",
        background=(0.1, 0.1, 0.1),
        white=1,
    )
    clear, filled = map(Movie, reversed(outputs))
    assert clear.rate == filled.rate == 25
    np.testing.assert_allclose(clear.read(2), person(4, 0.25), atol=0.02)
    assert filled.read(3).shape == (HEIGHT, WIDTH, 3)
    np.testing.assert_allclose(filled.read(3)[5, 8], 0.25, atol=0.05)
    np.testing.assert_allclose(filled.read(3)[0, 0], 0.1, atol=0.02)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.mov", "matte.mp4", "out.mov", "out.mp4"]


def test_an_environment_turns_behind(stub, tmp_path):
    sky = np.zeros((16, 32, 3), np.float32)
    sky[:, :4] = 1  # behind, to the right of the seam
    light = relight.MovingLight(relight.EnvironmentLight, image=sky, rotation={1: 0, 2: 90}, name="sky")
    video.render_video(person(), light, tmp_path / "r.%d.exr", background=light)
    assert relight.read(tmp_path / "r.1.exr")[0].max() > 0.5
    assert relight.read(tmp_path / "r.2.exr")[0].max() < 0.1


def test_nobody_there_is_an_empty_frame(stub, plates, tmp_path):
    relight.write(plates.with_name("p.0103.exr"), person() * 0)
    problems = video.render_video(plates, STILL, tmp_path / "r.%04d.exr", passes=("albedo", "shading"))
    assert problems == {}
    assert (relight.read(tmp_path / "r.0103.exr") == 0).all()
    layers = [set(relight.read_layers(tmp_path / f"r.{n}.exr")) for n in ("0102", "0103")]
    assert layers[0] == layers[1]


def test_a_nuke_script_reads_the_frames(stub, plates, tmp_path):
    video.render_video(
        plates, STILL, [tmp_path / "r.%04d.exr", tmp_path / "r.nk"], background=(0, 0, 1), rate=25
    )
    script = (tmp_path / "r.nk").read_text()
    assert ' file "r.%04d.exr"\n first 101\n last 105\n' in script
    assert "name Multiply_key" in script
    assert "name Multiply_background" in script
    assert " fps 25\n" in script


def test_a_shot_in_chunks_is_what_one_run_makes(stub, plates, tmp_path):
    """In any order, and with a chunk that nobody made: it is reported, and made by the run that follows."""
    whole, parts = ([tmp_path / where / name for name in ("r.%04d.exr", "r.nk", "r.mov")] for where in "ab")
    for outputs in (whole, parts):
        outputs[0].parent.mkdir()
    video.render_video(plates, STILL, whole)
    for frames in ("104-105", "101"):
        assert video.render_video(plates, STILL, parts, frames=frames, part="frames") == {}
    assert not any(path.exists() for path in parts[1:])
    stub.made.clear()
    problems = video.render_video(plates, STILL, parts, part="end")
    assert list(problems) == [102, 103]
    assert "r.%04d.exr: the frame is not there" in problems[102]
    assert video.render_video(plates, STILL, parts, frames="102-103", part="frames") == {}
    stub.made.clear()
    assert video.render_video(plates, STILL, parts, part="end") == {}
    assert stub.made == []
    assert differences(tmp_path / "b", tmp_path / "a") == []
    other = relight.DirectionalLight(intensity=0.4, name="key")
    with pytest.raises(ValueError, match=r"none of 5 .*r\.%04d\.exr: the frame is made with other lights"):
        video.render_video(plates, other, parts, part="end")


def test_every_second_frame(stub, plates, tmp_path):
    video.render_video(plates, STILL, [tmp_path / "r.%04d.exr", tmp_path / "r.mov"], frames="101-105x2")
    assert sorted(path.name for path in tmp_path.glob("r.*.exr")) == [f"r.010{n}.exr" for n in (1, 3, 5)]
    assert len(Movie(tmp_path / "r.mov").numbers) == 3


def test_a_plate_that_changes_size_is_named_by_the_movie(stub, plates, tmp_path):
    relight.write(plates.with_name("p.0103.exr"), person()[:, :-2])
    with pytest.raises(ValueError, match=r"r\.mov: frame 103 has another size than the first, \(12, 14\)"):
        video.render_video(plates, STILL, [tmp_path / "r.%04d.exr", tmp_path / "r.mov"])
    assert len(list(tmp_path.glob("r.*.exr"))) == 5


@pytest.mark.slow
def test_frames_are_the_same_as_one_by_one(tmp_path):
    """With the networks: what is written is what Subject makes of each frame."""
    y, x = np.mgrid[:60, :50]
    frames = []
    for number in (1, 2):
        alpha = (np.hypot(x - 20 - 3 * number, y - 30) < 18).astype(np.float32)[..., None]
        # Half floats hold these values as they are: the networks see the same from the file.
        frames.append(np.concatenate([alpha * (0.5, 0.375, 0.25), alpha], axis=-1).astype(np.float32))
        relight.write(tmp_path / f"p.{number}.exr", frames[-1])
    light = relight.DirectionalLight(azimuth=-40, elevation=20, name="key")
    for steady in (False, True):
        video.render_video(tmp_path / "p.%d.exr", light, tmp_path / f"{steady}.%d.exr", steady=steady)
    first, second = map(relight.Subject, frames)
    for name, subject in (("False.2", second), ("True.2", second.steadied([first]))):
        np.testing.assert_allclose(
            relight.read(tmp_path / f"{name}.exr"), subject.relit(light), rtol=2e-3, atol=1e-5
        )


# What goes wrong


def test_a_broken_frame_is_reported_and_the_rest_is_done(stub, plates, tmp_path):
    broken = plates.with_name("p.0103.exr")
    whole = broken.read_bytes()
    broken.write_bytes(whole[: len(whole) // 2])
    plates.with_name("p.0105.exr").unlink()
    relight.write(plates.with_name("p.0106.exr"), person(value=0.6))
    outputs = [tmp_path / "r.%04d.exr", tmp_path / "r.mov"]
    problems = video.render_video(plates, STILL, outputs)
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
    relight.write(plates.with_name("p.0105.exr"), person(value=0.5))
    stub.made.clear()
    assert video.render_video(plates, STILL, outputs, resume=True) == {}
    assert len(stub.made) == 6  # those around, to steady it
    np.testing.assert_allclose(Movie(tmp_path / "r.mov").read(3)[5, 5, 0], 0.15, atol=0.02)
    assert not (tmp_path / "r.mov.frames").exists()
    assert (tmp_path / "r.0103.exr").exists()


@pytest.mark.parametrize("output", ["r.%04d.exr", "r.mov"])
def test_an_interruption_loses_nothing(stub, plates, tmp_path, output):
    video.render_video(plates, STILL, tmp_path / f"whole_{output}")

    def interrupt(done, total, what):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        video.render_video(plates, STILL, tmp_path / output, progress=interrupt)
    stub.made.clear()
    steps = []
    video.render_video(
        plates, STILL, tmp_path / output, resume=True, progress=lambda *step: steps.append(step)
    )
    assert len(stub.made) == 4  # 104, 105, and 102, 103 to steady them
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
    video.render_video(plates, STILL, tmp_path / output, resume=True)
    assert stub.made == []  # nothing is missing
    video.render_video(plates, STILL, tmp_path / output, steady=False)
    assert len(stub.made) == 5  # not asked to resume


@pytest.mark.slow
def test_memory_is_flat_over_a_thousand_frames(stub, tmp_path):
    (tmp_path / "plates").mkdir()
    plate = tmp_path / "plates" / "p.0001.png"
    relight.write(plate, person().repeat(4, axis=0).repeat(4, axis=1))  # 48 KiB as floats
    for number in range(2, 1001):
        (plate.with_name(f"p.{number:04d}.png")).hardlink_to(plate)
    used = {}

    def measure(done, total, what):
        stub.made.clear()  # the test's own list
        stub.steadied_by.clear()
        if done in (100, 1000):
            gc.collect()
            used[done] = tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    video.render_video(plate.with_name("p.%04d.png"), STILL, tmp_path / "r.%04d.png", progress=measure)
    tracemalloc.stop()
    assert used[1000] - used[100] < 5e6  # a picture kept for each frame would be 44 MB


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({}, ValueError, r"frames: expected \(first, last\), as neither"),
        ({"frames": (5, 3)}, ValueError, "frames: expected 0 <= first <= last"),
        (
            {"frames": "1-2", "part": "middle"},
            ValueError,
            "part: expected one of all, frames, end, got 'middle'",
        ),
        ({"source": "gone.%04d.exr"}, FileNotFoundError, r"gone\.%04d\.exr: no such frames"),
        ({"source": "gone.mov"}, FileNotFoundError, r"gone\.mov: no such file"),
        ({"outputs": "r.mp4"}, ValueError, r"r\.mp4: \.mp4 holds no alpha; give a background"),
        ({"outputs": "r.exr"}, ValueError, r"r\.exr: expected a movie, or a frame number in the name"),
        ({"outputs": "r.%04d.gif"}, ValueError, "expected a file name that ends in"),
        ({"outputs": "r.nk"}, ValueError, r"r\.nk: a Nuke script needs an \.exr to read"),
        ({"outputs": "none/r.%04d.exr"}, FileNotFoundError, "the folder none does not exist"),
        ({"outputs": "none/r.mov"}, FileNotFoundError, "the folder none does not exist"),
        ({"passes": ["depth"]}, ValueError, "passes: expected any of"),
        ({"lights": [STILL, STILL]}, ValueError, "lights: expected different names"),
        ({"lights": []}, ValueError, "lights: expected at least one"),
        ({"source": person() * 0}, ValueError, "none of 2 frames could be made; frame 1: .* is empty"),
        ({"outputs": "r.%04d.png", "source": "r.%04d.png"}, ValueError, "is read as well"),
    ],
)
def test_bad_arguments_are_named(tmp_path, monkeypatch, arguments, error, message):
    monkeypatch.chdir(tmp_path)
    if arguments.get("outputs") == "r.%04d.png":
        relight.write("r.0001.png", person())
    before = list(tmp_path.iterdir())
    frames = {} if not arguments else {"frames": (1, 2)}
    arguments = {"source": person(), "lights": STILL, "outputs": "r.%04d.exr"} | frames | arguments
    with pytest.raises(error, match=message):
        video.render_video(**arguments)
    assert list(tmp_path.iterdir()) == before


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
    video.render_video(plates, STILL, path)
    stub.made.clear()
    with pytest.warns(UserWarning, match="resume: 5 of 5 frames were made with other lights"):
        video.render_video(plates, **{"lights": STILL, "outputs": path} | other, resume=True)
    assert len(stub.made) == 5
    stub.made.clear()
    video.render_video(plates, **{"lights": STILL, "outputs": path} | other, resume=True)
    assert stub.made == []


@pytest.mark.parametrize("name", ["r.%04d.exr", "r.%04d.png", "r.%04d.tif", "r.%04d.jpg"])
def test_one_plate_that_changed_is_made_anew(stub, plates, tmp_path, name):
    arguments = {"background": (0.1, 0.1, 0.1), "steady": False, "save_matte": tmp_path / "m.%04d.png"}
    video.render_video(plates, STILL, tmp_path / name, **arguments)
    relight.write(plates.with_name("p.0102.exr"), person(value=0.9))
    kept = (tmp_path / "m.0103.png").stat().st_ino
    changed = (tmp_path / "m.0102.png").stat().st_ino
    stub.made.clear()
    with pytest.warns(UserWarning, match="resume: 1 of 5 frames"):
        video.render_video(plates, STILL, tmp_path / name, resume=True, **arguments)
    assert len(stub.made) == 1
    assert (tmp_path / "m.0103.png").stat().st_ino == kept
    assert (tmp_path / "m.0102.png").stat().st_ino != changed


def test_what_is_steadied_by_a_plate_that_changed_is_made_anew(stub, plates, tmp_path):
    video.render_video(plates, STILL, tmp_path / "r.%04d.exr")
    relight.write(plates.with_name("p.0101.exr"), person(value=0.9))
    with pytest.warns(UserWarning, match="resume: 3 of 5 frames"):
        video.render_video(plates, STILL, tmp_path / "r.%04d.exr", resume=True)


def test_display_is_no_part_of_scene_linear_frames(stub, plates, tmp_path):
    outputs = [tmp_path / "r.%04d.exr", tmp_path / "r.%04d.png"]
    video.render_video(plates, STILL, outputs)
    before = [(tmp_path / name).stat().st_ino for name in ("r.0101.exr", "r.0101.png")]
    with pytest.warns(UserWarning, match="resume: 5 of 5 frames"):
        video.render_video(plates, STILL, outputs, exposure=1, resume=True)
    after = [(tmp_path / name).stat().st_ino for name in ("r.0101.exr", "r.0101.png")]
    assert before[0] == after[0]
    assert before[1] != after[1]


@pytest.mark.parametrize("other", [{"frames": (101, 105)}, {"rate": 25}, {"exposure": 1}])
def test_a_finished_movie_that_is_asked_to_be_another_is_made_anew(stub, plates, tmp_path, other):
    arguments = {"frames": (101, 103), "rate": 24, "exposure": 0}
    video.render_video(plates, STILL, tmp_path / "r.mov", **arguments)
    with pytest.warns(UserWarning, match="frames were made with other"):
        video.render_video(plates, STILL, tmp_path / "r.mov", **arguments | other, resume=True)
    movie = Movie(tmp_path / "r.mov")
    assert len(movie.numbers) == len(range(*(arguments | other)["frames"])) + 1
    assert movie.rate == (arguments | other)["rate"]
    assert not (tmp_path / "r.mov.frames").exists()


def test_frames_that_another_program_changed_are_made_anew(stub, plates, tmp_path):
    """Their size, or layers; or they are cut short. All still say what made them."""
    video.render_video(plates, STILL, tmp_path / "r.%04d.exr")
    first, second, third = (tmp_path / f"r.{number:04d}.exr" for number in (101, 102, 103))
    half(oiio.ImageBuf(str(first))).write(str(first))
    without_layers(oiio.ImageBuf(str(second))).write(str(second))
    third.write_bytes(third.read_bytes()[:-100])
    kept = [(tmp_path / f"r.{number:04d}.exr").stat().st_ino for number in (104, 105)]
    with pytest.warns(UserWarning, match="resume: 3 of 5 frames"):
        assert video.render_video(plates, STILL, tmp_path / "r.%04d.exr", resume=True) == {}
    assert kept == [(tmp_path / f"r.{number:04d}.exr").stat().st_ino for number in (104, 105)]
    for path in (first, second, third):
        assert relight.read(path).shape == (HEIGHT, WIDTH, 4)
        assert set(relight.read_layers(path)) == {"C_key"}


def test_frames_of_another_precision_or_other_threads_are_made_anew(stub, plates, tmp_path):
    path = tmp_path / "r.%04d.exr"
    video.render_video(plates, STILL, path, precision="float32", threads=1)
    for precision, threads in (("bfloat16", 1), ("bfloat16", 2)):
        with pytest.warns(UserWarning, match="resume: 5 of 5 frames"):
            video.render_video(plates, STILL, path, precision=precision, threads=threads, resume=True)


def test_a_full_disk_keeps_what_is_finished(stub, plates, tmp_path, monkeypatch):
    flush = os.fsync

    def full(descriptor):
        if len(list(tmp_path.glob("r.*.exr"))) >= 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        flush(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    problems = video.render_video(plates, STILL, tmp_path / "r.%04d.exr")
    assert list(problems) == [104, 105]
    assert "No space left on device" in problems[104]
    there = {path: path.stat().st_ino for path in tmp_path.glob("r.*")}
    assert len(there) == 3
    monkeypatch.undo()
    monkeypatch.setattr(people, "Subject", Stub)
    assert video.render_video(plates, STILL, tmp_path / "r.%04d.exr", resume=True) == {}
    assert all(path.stat().st_ino == inode for path, inode in there.items())
    assert len(list(tmp_path.glob("r.*.exr"))) == 5


def test_two_runs_that_write_one_movie_do_not_mix(stub, plates, tmp_path):
    """Here the second is over when the first begins to encode."""
    other = relight.DirectionalLight(intensity=1, name="key")

    def meanwhile(done, total, what):
        if done == total:
            video.render_video(plates, other, tmp_path / "r.mov", white=1)

    with pytest.raises(ValueError, match=r"r\.mov: frame 101 is not there as this run made it; does another"):
        video.render_video(plates, STILL, tmp_path / "r.mov", white=1, progress=meanwhile)
    np.testing.assert_allclose(Movie(tmp_path / "r.mov").read(5)[5, 8], (0.5, 0.5, 0.5, 1), atol=0.02)
    assert not (tmp_path / "r.mov.frames").exists()


def test_autocropped_frames_are_the_same_picture(stub, plates, tmp_path):
    for name, autocrop in (("whole", False), ("box", True)):
        video.render_video(plates, STILL, tmp_path / f"{name}.%04d.exr", autocrop=autocrop)
    for number in range(101, 106):
        paths = [tmp_path / f"{name}.{number:04d}.exr" for name in ("whole", "box")]
        np.testing.assert_array_equal(*map(relight.read, paths))
        np.testing.assert_array_equal(*(relight.read_layers(path)["C_key"] for path in paths))
        spec = oiio.ImageInput.open(str(paths[1])).spec()
        assert (spec.x, spec.y, spec.width, spec.height) == (number - 99, 2, 4, 8)
    stub.made.clear()
    assert video.render_video(plates, STILL, tmp_path / "box.%04d.exr", resume=True) == {}
    assert stub.made == []


def test_an_environment_counts_by_its_pixels(stub, plates, tmp_path):
    path = tmp_path / "r.%04d.exr"
    sky = np.full((2, 4, 3), 0.5, np.float32)
    for name, pixels, others in (("a", sky, 0), ("b", sky, 0), ("b", sky * 2, 5)):
        relight.write(tmp_path / f"{name}.exr", pixels)
        light = relight.EnvironmentLight(tmp_path / f"{name}.exr", intensity=0.5, name="sky")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            video.render_video(plates, light, path, resume=True)
        assert [str(one.message)[:12] for one in caught] == ([f"resume: {others} of"] if others else [])


def test_one_frame_that_cannot_be_made_leaves_the_rest(tmp_path):
    """With the networks, steadied: a sliver of a person in one frame, light beyond half floats in another."""
    plate = np.zeros((400, 60, 4), np.float32)
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
    assert list(video.render_video(**arguments)) == [2, 4]
    assert sorted(path.name for path in tmp_path.glob("r.*")) == ["r.1.exr", "r.3.exr", "r.5.exr"]
    with pytest.warns(UserWarning, match="resume: 3 of 5 frames"):
        assert list(video.render_video(**arguments, exr_type="float", resume=True)) == [2]
    assert relight.read(tmp_path / "r.4.exr").max() > 65504
