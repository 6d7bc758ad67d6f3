import gc
import tracemalloc

import numpy as np
import OpenImageIO as oiio
import pytest
from helpers import shots, standins
from helpers.killing import differences
from helpers.rising import RISING, STILL
from helpers.standins import HEIGHT, WIDTH, brightness, somebody

import relight
from relight.media.movies import Movie, write_movie
from relight.pipeline.frame import FrameReader
from relight.pipeline.shot import Shot


def test_a_moving_light_on_a_still(stub, tmp_path):
    steps = []
    problems = stub.render(
        somebody(), RISING, tmp_path / "r.%03d.exr", progress=lambda *step: steps.append(step)
    )
    assert problems == {}
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"r.{n:03d}.exr" for n in range(1, 6)]
    found = [brightness(tmp_path / f"r.{n:03d}.exr") for n in range(1, 6)]
    np.testing.assert_allclose(found, [0.1, 0.2, 0.3, 0.4, 0.5], rtol=1e-3)
    assert len(stub.made) == 1
    assert steps == [(n, 5, "Relighting") for n in range(1, 6)]
    assert set(relight.read_layers(tmp_path / "r.002.exr")) == {"C_key"}


@pytest.mark.parametrize("installed", [False, True])
def test_a_picture_with_alpha_needs_no_pymatting(stub, tmp_path, monkeypatch, missing, installed):
    """A core installation has no PyMatting; where there is one, it is not compiled for nothing."""
    if not installed:
        missing("pymatting")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "empty"))  # as if it had never been compiled
    stub.render(somebody(), STILL, tmp_path / "out.png")
    assert (tmp_path / "out.png").exists()
    assert not (tmp_path / "empty").exists()


def test_a_still_light_on_somebody_who_moves(stub, plates, tmp_path):
    stub.render(plates, STILL, tmp_path / "r.%04d.exr", passes=["N", "visibility"])
    for number in range(101, 106):
        picture = relight.read(tmp_path / f"r.{number:04d}.exr")
        np.testing.assert_allclose(picture, somebody(number - 99, 0.05 * (number - 100)), atol=1e-3)
    assert len(stub.made) == 5
    assert stub.filtered_by == [2, 3, 4, 3, 2]
    assert set(relight.read_layers(tmp_path / "r.0101.exr")) == {"C_key", "N", "visibility_key"}


def test_both_move_and_nothing_is_filtered_unless_asked(stub, plates, tmp_path):
    light = relight.MovingLight(intensity={101: 1, 105: 5})
    stub.render(plates, light, tmp_path / "r.%04d.png", temporal_filter=False, frames=(102, 104), white=1)
    assert stub.filtered_by == []
    found = [brightness(tmp_path / f"r.{n:04d}.png") for n in (102, 103, 104)]
    np.testing.assert_allclose(found, [0.4, 0.9, 1.0], atol=0.01)
    assert len(list(tmp_path.glob("r.*"))) == 3


def test_mattes_and_backgrounds_move_too(stub, plates, tmp_path):
    for number in range(101, 106):
        relight.write_mask(tmp_path / f"m.{number:04d}.png", somebody(number - 99)[..., 3])
        relight.write(tmp_path / f"b.{number:04d}.exr", np.full((HEIGHT, WIDTH, 3), number - 100, np.float32))
    stub.render(
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


def test_the_frame_that_defines_the_world_is_read_once(stub, plates, tmp_path, monkeypatch):
    read, frame = [], FrameReader.read
    monkeypatch.setattr(
        FrameReader, "read", lambda inputs, number: read.append(number) or frame(inputs, number)
    )
    lamp = relight.PointLight((0, 0, 2))
    stub.render(plates, lamp, tmp_path / "r.%04d.exr", frames=(101, 103), temporal_filter=False)
    assert read == [101, 102, 103]
    read.clear()
    stub.render(plates, lamp, tmp_path / "c.%04d.exr", frames=(103, 103), temporal_filter=False)
    assert read == [101, 103]


def test_a_movie_in_and_a_movie_out(stub, tmp_path):
    write_movie(tmp_path / "in.mov", [somebody(n, 0.5) for n in (2, 4, 6)], rate=25, white=1)
    write_movie(tmp_path / "matte.mp4", [somebody(n)[..., 3:].repeat(3, -1) for n in (2, 4, 6)], white=1)
    outputs = [tmp_path / "out.mp4", tmp_path / "out.mov"]
    stub.render(tmp_path / "in.mov", STILL, outputs[1], white=1)
    stub.render(
        tmp_path / "in.mov",
        STILL,
        outputs[0],
        mask=tmp_path / "matte.mp4",
        background=(0.1, 0.1, 0.1),
        white=1,
    )
    clear, filled = map(Movie, reversed(outputs))
    assert clear.rate == filled.rate == 25
    np.testing.assert_allclose(clear.read(2), somebody(4, 0.25), atol=0.02)
    assert filled.read(3).shape == (HEIGHT, WIDTH, 3)
    np.testing.assert_allclose(filled.read(3)[5, 8], 0.25, atol=0.05)
    np.testing.assert_allclose(filled.read(3)[0, 0], 0.1, atol=0.02)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.mov", "matte.mp4", "out.mov", "out.mp4"]


def test_an_environment_turns_behind(stub, tmp_path):
    sky = np.zeros((16, 32, 3), np.float32)
    sky[:, :4] = 1  # behind, to the right of the seam
    light = relight.MovingLight(relight.EnvironmentLight, image=sky, rotation={1: 0, 2: 90}, name="sky")
    stub.render(somebody(), light, tmp_path / "r.%d.exr", background=light)
    assert relight.read(tmp_path / "r.1.exr")[0].max() > 0.5
    assert relight.read(tmp_path / "r.2.exr")[0].max() < 0.1


def test_nobody_there_is_an_empty_frame(stub, plates, tmp_path):
    relight.write(plates.with_name("p.0103.exr"), somebody() * 0)
    problems = stub.render(plates, STILL, tmp_path / "r.%04d.exr", passes=("albedo", "shading"))
    assert problems == {}
    assert (relight.read(tmp_path / "r.0103.exr") == 0).all()
    layers = [set(relight.read_layers(tmp_path / f"r.{n}.exr")) for n in ("0102", "0103")]
    assert layers[0] == layers[1]


def test_a_nuke_script_reads_the_frames(stub, plates, tmp_path):
    stub.render(plates, STILL, [tmp_path / "r.%04d.exr", tmp_path / "r.nk"], background=(0, 0, 1), rate=25)
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
    stub.render(plates, STILL, whole)
    for frames in ("104-105", "101"):
        assert stub.render(plates, STILL, parts, frames=frames, phase="frames") == {}
    assert not any(path.exists() for path in parts[1:])
    stub.made.clear()
    problems = stub.render(plates, STILL, parts, phase="finalize")
    assert list(problems) == [102, 103]
    assert "r.%04d.exr: the frame is not there" in problems[102]
    assert stub.render(plates, STILL, parts, frames="102-103", phase="frames") == {}
    stub.made.clear()
    assert stub.render(plates, STILL, parts, phase="finalize") == {}
    assert stub.made == []
    assert differences(tmp_path / "b", tmp_path / "a") == []
    other = relight.DirectionalLight(intensity=0.4, name="key")
    with pytest.raises(ValueError, match=r"none of 5 .*r\.%04d\.exr: the frame is made with other lights"):
        stub.render(plates, other, parts, phase="finalize")


def test_the_old_light_is_that_of_the_first_frame(stub, plates, tmp_path):
    """On each machine of a farm, so that the colour of a shot neither flickers nor jumps."""
    for frames in ((101, 103), (104, 104), (105, 105)):
        stub.render(plates, STILL, [tmp_path / "r.%04d.exr"], frames=frames, temporal_filter=False)
    first, *others = stub.made
    assert {subject.old_light for subject in others} == {first.old_light}
    assert len(others) == 6  # the first frame again for each of the last two runs


def test_every_second_frame(stub, plates, tmp_path):
    stub.render(plates, STILL, [tmp_path / "r.%04d.exr", tmp_path / "r.mov"], frames="101-105x2")
    assert sorted(path.name for path in tmp_path.glob("r.*.exr")) == [f"r.010{n}.exr" for n in (1, 3, 5)]
    assert len(Movie(tmp_path / "r.mov").numbers) == 3


def test_a_plate_that_changes_size_is_named_by_the_movie(stub, plates, tmp_path):
    relight.write(plates.with_name("p.0103.exr"), somebody()[:, :-2])
    with pytest.raises(ValueError, match=r"r\.mov: frame 103 has another size than the first, \(12, 14\)"):
        stub.render(plates, STILL, [tmp_path / "r.%04d.exr", tmp_path / "r.mov"])
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
        shots.render(tmp_path / "p.%d.exr", light, tmp_path / f"{steady}.%d.exr", temporal_filter=steady)
    first, second = map(relight.Subject, frames)
    for name, subject in (("False.2", second), ("True.2", second.temporally_filtered([first]))):
        np.testing.assert_allclose(
            relight.read(tmp_path / f"{name}.exr"), subject.relit(light), rtol=2e-3, atol=1e-5
        )


@pytest.mark.slow
def test_memory_is_flat_over_a_thousand_frames(stub, tmp_path):
    (tmp_path / "plates").mkdir()
    plate = tmp_path / "plates" / "p.0001.png"
    relight.write(plate, somebody().repeat(4, axis=0).repeat(4, axis=1))  # 48 KiB as floats
    for number in range(2, 1001):
        (plate.with_name(f"p.{number:04d}.png")).hardlink_to(plate)
    used = {}

    def measure(done, total, what):
        stub.made.clear()  # the test's own list
        if done in (100, 1000):
            gc.collect()
            used[done] = tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    stub.render(plate.with_name("p.%04d.png"), STILL, tmp_path / "r.%04d.png", progress=measure)
    tracemalloc.stop()
    assert used[1000] - used[100] < 5e6  # a picture kept for each frame would be 44 MB


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({}, ValueError, r"frames: expected \(first, last\), as neither"),
        ({"frames": (5, 3)}, ValueError, "frames: expected -?[0-9]+ <= first <= last"),
        (
            {"frames": "1-2", "phase": "middle"},
            ValueError,
            "phase: expected one of all, frames, finalize, got 'middle'",
        ),
        ({"source": "gone.%04d.exr"}, FileNotFoundError, r"gone\.%04d\.exr: no such frames"),
        ({"source": "gone.mov"}, FileNotFoundError, r"gone\.mov: no such file"),
        ({"outputs": "r.mp4"}, ValueError, r"r\.mp4: \.mp4 holds no alpha; give a background"),
        ({"outputs": "r.exr"}, ValueError, r"r\.exr: expected a movie, or a frame number in the name"),
        ({"outputs": "r.%04d.gif"}, ValueError, "expected a file name that ends in"),
        ({"outputs": "r.nk"}, ValueError, r"r\.nk: a Nuke script needs an \.exr to read"),
        ({"outputs": "none/r.%04d.exr"}, FileNotFoundError, "the folder none does not exist"),
        ({"outputs": "none/r.mov"}, FileNotFoundError, "the folder none does not exist"),
        ({"passes": ["depth"]}, ValueError, "passes: expected several values, each one of"),
        ({"lights": [STILL, STILL]}, ValueError, "lights: expected different names"),
        ({"lights": []}, ValueError, "lights: expected at least one"),
        ({"source": somebody() * 0}, ValueError, "none of 2 frames could be made; frame 1: .* is empty"),
        ({"outputs": "r.%04d.png", "source": "r.%04d.png"}, ValueError, "is read as well"),
    ],
)
def test_a_shot_with_invalid_arguments_is_refused_and_writes_nothing(
    tmp_path, here, arguments, error, message
):
    if arguments.get("outputs") == "r.%04d.png":
        relight.write("r.0001.png", somebody())
    before = list(tmp_path.iterdir())
    frames = {} if not arguments else {"frames": (1, 2)}
    arguments = {"source": somebody(), "lights": STILL, "outputs": "r.%04d.exr"} | frames | arguments
    with pytest.raises(error, match=message):
        shots.render(**arguments)
    assert list(tmp_path.iterdir()) == before


def test_two_runs_that_write_one_movie_do_not_mix(stub, plates, tmp_path):
    """Here the second is over when the first begins to encode."""
    other = relight.DirectionalLight(intensity=1, name="key")

    def meanwhile(done, total, what):
        if done == total:
            stub.render(plates, other, tmp_path / "r.mov", white=1)

    with pytest.raises(ValueError, match=r"r\.mov: frame 101 is not there as this run made it; does another"):
        stub.render(plates, STILL, tmp_path / "r.mov", white=1, progress=meanwhile)
    np.testing.assert_allclose(Movie(tmp_path / "r.mov").read(5)[5, 8], (0.5, 0.5, 0.5, 1), atol=0.02)
    assert not (tmp_path / "r.mov.frames").exists()


def test_autocropped_frames_are_the_same_picture(stub, plates, tmp_path):
    for name, autocrop in (("whole", False), ("box", True)):
        stub.render(plates, STILL, tmp_path / f"{name}.%04d.exr", autocrop=autocrop)
    for number in range(101, 106):
        paths = [tmp_path / f"{name}.{number:04d}.exr" for name in ("whole", "box")]
        np.testing.assert_array_equal(*map(relight.read, paths))
        np.testing.assert_array_equal(*(relight.read_layers(path)["C_key"] for path in paths))
        spec = oiio.ImageInput.open(str(paths[1])).spec()
        assert (spec.x, spec.y, spec.width, spec.height) == (number - 99, 2, 4, 8)
    stub.made.clear()
    assert stub.render(plates, STILL, tmp_path / "box.%04d.exr", resume=True) == {}
    assert stub.made == []


def test_a_frame_of_another_size_has_a_world_of_its_own(tmp_path):
    given = []

    def analyse(*arguments, **options):
        given.append(options["camera"])
        return standins.FlatSubject(*arguments, **options)

    for number, columns in enumerate((40, 40, 38), 1):
        plate = np.full((60, columns, 4), 0.3, np.float32)
        plate[..., 3] = 0
        plate[10:50, 10:30, 3] = 1
        relight.write(tmp_path / f"p.{number:04d}.exr", plate)
    shot = Shot(relight.Source(tmp_path / "p.%04d.exr", temporal_filter=False), analyse=analyse)
    for number in (1, 2, 3):
        shot.person(number)
    assert [camera and camera.size for camera in given] == [(60, 40), (60, 40), None]


def test_a_jpeg_of_a_jpeg_has_the_photograph_behind_the_person(stub, tmp_path):
    photograph = np.full((HEIGHT, WIDTH, 3), 0.2, np.float32)
    photograph[2:10, 4:8] = 0.4
    relight.write(tmp_path / "p.jpg", photograph)
    matte = somebody(4)[..., 3]
    stub.render(tmp_path / "p.jpg", STILL, tmp_path / "r.jpg", mask=matte)
    stub.render(tmp_path / "p.jpg", STILL, tmp_path / "b.jpg", mask=matte, background=tmp_path / "p.jpg")
    np.testing.assert_array_equal(*(relight.read(tmp_path / name) for name in ("r.jpg", "b.jpg")))
    np.testing.assert_allclose(relight.read(tmp_path / "r.jpg")[0, -1], 0.2, atol=0.02)
    with pytest.raises(ValueError, match="holds no alpha; give a background"):
        stub.render(tmp_path / "p.jpg", STILL, tmp_path / "s.jpg", mask=matte, size=(20, 20))
