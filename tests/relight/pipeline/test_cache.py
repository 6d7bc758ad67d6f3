"""A shot's analysis on the disk: kept, read, resumed, and noticed where it is stale."""

import contextlib
import errno
import json
import os
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT, shots, standins
from helpers.clothed import clothed
from helpers.killing import kill
from helpers.standins import somebody
from safetensors import safe_open
from safetensors.numpy import save_file

import relight
from relight.analysis import storage
from relight.cli.commands import app
from relight.media.content_hash import FileRecord
from relight.pipeline import cache
from relight.pipeline.cache import AnalysisCache

KEY = relight.DirectionalLight(azimuth=-40, elevation=30, name="key")
FRAMES = range(101, 105)


@pytest.fixture(scope="module")
def analysed(tmp_path_factory):
    """Four frames of somebody who drifts, nobody in the last of them, and what was kept of them."""
    folder = tmp_path_factory.mktemp("analysed")
    for number in FRAMES:
        plate, matte = clothed(seed=1)
        moved = [np.roll(image, number - 101, axis=1) for image in (plate, matte * (number < 104))]
        relight.write(folder / f"plate.{number:04d}.exr", moved[0])
        relight.write_mask(folder / f"matte.{number:04d}.png", moved[1])
    assert shots.analyse(folder / "plate.%04d.exr", folder / "shot.relight", **mattes(folder)) == {}
    return folder


@pytest.fixture
def desk(analysed, tmp_path):
    """A copy to spoil."""
    shutil.copytree(analysed, tmp_path / "desk", copy_function=shutil.copy2)
    return tmp_path / "desk"


def mattes(folder):
    return {"mask": folder / "matte.%04d.png", "threads": 1}


def relit(desk, name="relit", **settings):
    outputs = desk / f"{name}.%04d.exr"
    return shots.render(desk / "shot.relight", KEY, outputs, **settings)


def files(desk):
    """{name: inode} of the kept frames: a frame that is written again has another."""
    return {path.name: path.stat().st_ino for path in sorted((desk / "shot.relight").iterdir())}


def test_frames_are_those_of_the_plates_and_no_network_runs(desk):
    assert list(files(desk)) == [f"{number:06d}.safetensors" for number in FRAMES]
    with standins.no_network():
        assert relit(desk) == {}
    direct = desk / "direct.%04d.exr"
    assert shots.render(desk / "plate.%04d.exr", KEY, direct, **mattes(desk)) == {}
    for number in FRAMES:
        kept, made = (relight.read(desk / f"{name}.{number:04d}.exr") for name in ("relit", "direct"))
        inside = made[..., 3] > 0
        assert inside.any() == (number < 104)
        assert np.sqrt(((kept - made)[inside] ** 2).mean()) < 0.002 if inside.any() else not kept.any()
        carried = {
            relight.media.images.read_content_hash(desk / f"{name}.{number:04d}.exr")
            for name in ("relit", "direct")
        }
        assert len(carried) == 2  # each says what made it


def test_a_file_says_what_it_was_made_of(desk):
    with safe_open(desk / "shot.relight" / "000102.safetensors", "np") as file:
        provenance = json.loads(file.metadata()["relight"])["provenance"]
    plates = [source for source in provenance["sources"] if "plate" in source["path"]]
    assert [source["path"] for source in plates] == [f"../plate.{n:04d}.exr" for n in FRAMES]
    assert plates[1]["size"] == (desk / "plate.0102.exr").stat().st_size
    assert len(plates[1]["sha256"]) == 64
    assert provenance["precision"] in ("bfloat16", "float32")
    assert len(provenance["weights"]) == 2


def test_what_is_whole_and_fresh_is_kept(desk):
    before = files(desk)
    damaged = desk / "shot.relight" / "000102.safetensors"
    damaged.write_bytes(damaged.read_bytes()[:-100])
    (desk / "shot.relight" / "000103.safetensors").unlink()
    with pytest.warns(UserWarning, match="1 of 4 frames were damaged, or made from other plates"):
        shots.analyse(desk / "plate.%04d.exr", desk / "shot.relight", **mattes(desk))
    after = files(desk)
    assert [name for name in before if before[name] != after[name]] != []
    assert before["000101.safetensors"] == after["000101.safetensors"]

    def refuse(*arguments, **settings):
        raise AssertionError("a frame was analysed again")

    shots.analyse(desk / "plate.%04d.exr", desk / "shot.relight", analyse=refuse, **mattes(desk))
    assert files(desk) == after


class Saved:
    """Stands in for a Subject of which nothing but its being analysed counts."""

    is_empty = False
    old_light = None

    def __init__(self, *arguments, **settings):
        pass

    def temporally_filtered(self, around):
        return self

    def save(self, path, provenance):
        relight.Subject.nobody((4, 4)).save(path, provenance=provenance)


@pytest.mark.parametrize("other", [{"threads": 2}, {"precision": "float32"}, {"precision": "bfloat16"}])
def test_an_analysis_of_other_threads_or_precision_is_another(desk, other):
    made = storage.read_header(desk / "shot.relight" / "000101.safetensors")["provenance"]
    settings = mattes(desk) | {"precision": made["precision"], "analyse": Saved} | other
    if all(made[name] == value for name, value in other.items()):
        shots.analyse(desk / "plate.%04d.exr", desk / "shot.relight", **settings)
        return
    before = files(desk)
    with pytest.warns(UserWarning, match="4 of 4 frames were damaged, or made from other plates, with other"):
        shots.analyse(desk / "plate.%04d.exr", desk / "shot.relight", **settings)
    assert all(files(desk)[name] != inode for name, inode in before.items())


def test_frames_of_another_precision_are_said(desk):
    path = desk / "shot.relight" / "000102.safetensors"
    with safe_open(path, "np") as file:
        about = json.loads(file.metadata()["relight"])
        tensors = {name: file.get_tensor(name) for name in about["arrays"]}
    about["provenance"]["precision"] = "float8"
    save_file(tensors, path, {"relight": json.dumps(about)})
    with pytest.warns(UserWarning, match=r"000102\.safetensors was analysed in float8, 000101"):
        assert relit(desk) == {}


def test_a_plate_that_is_missing_in_the_middle_is_named_and_the_rest_analysed(desk):
    (desk / "plate.0102.exr").unlink()
    problems = shots.analyse(desk / "plate.%04d.exr", desk / "parts.relight", analyse=Saved, **mattes(desk))
    assert list(problems) == [102]
    assert "plate.0102.exr: no such file" in problems[102]
    assert len(list((desk / "parts.relight").iterdir())) == 3


def test_a_full_disk_keeps_what_is_analysed(desk, monkeypatch):
    flush, folder = os.fsync, desk / "full.relight"

    def full(descriptor):
        if len(list(folder.glob("[!.]*"))) >= 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        flush(descriptor)

    with monkeypatch.context() as disk:
        disk.setattr(os, "fsync", full)
        problems = shots.analyse(desk / "plate.%04d.exr", folder, analyse=Saved, **mattes(desk))
    assert list(problems) == [103, 104]
    assert "No space left on device" in problems[103]
    there = {path: path.stat().st_ino for path in folder.iterdir()}
    assert len(there) == 2
    assert shots.analyse(desk / "plate.%04d.exr", folder, analyse=Saved, **mattes(desk)) == {}
    assert all(path.stat().st_ino == inode for path, inode in there.items())
    assert len(list(folder.iterdir())) == 4


def test_a_plate_that_changed_is_named_and_analysed_anew(desk):
    relight.write(desk / "plate.0104.exr", clothed(seed=2)[0])
    problems = relit(desk)
    assert list(problems) == [102, 103, 104]
    assert "000104.safetensors: is stale, " in problems[104]
    assert "plate.0104.exr has changed since; run `relight analyse` again" in problems[104]


def test_a_first_plate_that_changed_makes_all_frames_stale(desk):
    """The old light of all frames is that of the first."""
    relight.write(desk / "plate.0101.exr", clothed(seed=2)[0])
    with pytest.raises(ValueError, match="none of 4 frames could be made"):
        relit(desk)


def test_a_plate_that_was_only_touched_or_copied_is_the_same(desk):
    os.utime(desk / "plate.0101.exr")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert relit(desk) == {}


def test_plates_that_are_not_there_are_said_once(desk):
    for number in (101, 102):
        (desk / f"plate.{number:04d}.exr").unlink()
    with pytest.warns(UserWarning, match=r"plate\.0101\.exr is not there to compare with") as caught:
        assert relit(desk) == {}
    assert len(caught) == 1


def test_other_weights_are_named(desk):
    for number in FRAMES:
        path = desk / "shot.relight" / f"{number:06d}.safetensors"
        subject = relight.Subject.load(path, may_be_empty=True)
        subject.save(path, provenance={"weights": ["other", "weights"]})
    with pytest.raises(
        ValueError, match=r"none of 4 frames .*000101\.safetensors: was analysed with other weights"
    ):
        relit(desk)


def test_frames_of_other_options_do_not_mix(desk):
    shots.analyse(
        desk / "plate.%04d.exr",
        desk / "other.relight",
        frames=(102, 102),
        temporal_filter=False,
        **mattes(desk),
    )
    shutil.copy2(desk / "other.relight" / "000102.safetensors", desk / "shot.relight")
    problems = relit(desk)
    assert list(problems) == [102]
    assert "was analysed with other options than 000101.safetensors" in problems[102]


def test_frames_that_are_missing_or_damaged_are_named_and_the_rest_is_made(desk):
    (desk / "shot.relight" / "000102.safetensors").unlink()
    damaged = desk / "shot.relight" / "000103.safetensors"
    damaged.write_bytes(damaged.read_bytes()[:5000])
    problems = relit(desk)
    assert list(problems) == [102, 103]
    assert "000102.safetensors: no such file" in problems[102]
    assert "000103.safetensors: is damaged or truncated" in problems[103]
    assert (desk / "relit.0101.exr").exists()


@pytest.mark.slow
def test_lit_again_after_another_analysis(desk):
    relit(desk, frames=(101, 102))
    kept = (desk / "relit.0101.exr").stat().st_ino
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        relit(desk, frames=(101, 102), resume=True)
    assert (desk / "relit.0101.exr").stat().st_ino == kept
    (desk / "shot.relight" / "000102.safetensors").write_bytes(b"")
    with pytest.warns(UserWarning, match="1 of 2 frames were damaged"):
        shots.analyse(desk / "plate.%04d.exr", desk / "shot.relight", frames="101-102", **mattes(desk))
    with warnings.catch_warnings():  # it is the same analysis as before
        warnings.simplefilter("error")
        relit(desk, frames=(101, 102), resume=True)


def test_a_still_is_kept_too(tmp_path):
    plate, matte = clothed()
    relight.write(tmp_path / "photo.exr", plate)
    assert shots.analyse(tmp_path / "photo.exr", tmp_path / "p.relight", mask=matte) == {}
    assert [path.name for path in (tmp_path / "p.relight").iterdir()] == ["still.safetensors"]
    light = relight.MovingLight(azimuth={1: -40, 2: 40}, name="key")
    with standins.no_network():
        assert shots.render(tmp_path / "p.relight", light, tmp_path / "r.%d.exr") == {}
    assert np.abs(relight.read(tmp_path / "r.1.exr") - relight.read(tmp_path / "r.2.exr")).max() > 0.1


def test_a_still_and_a_shot_do_not_share_a_folder(desk):
    plate, matte = clothed()
    relight.write(desk / "photo.exr", plate)
    with pytest.raises(
        ValueError, match=r"shot\.relight: expected a folder for a still, and this holds a shot"
    ):
        shots.analyse(desk / "photo.exr", desk / "shot.relight", mask=matte)
    (desk / "p.relight").mkdir()
    (desk / "p.relight" / "still.safetensors").touch()
    with pytest.raises(ValueError, match=r"p\.relight: expected a folder for a shot, and this holds a still"):
        shots.analyse(desk / "plate.%04d.exr", desk / "p.relight", **mattes(desk))
    (desk / "shot.relight" / "still.safetensors").touch()
    with pytest.raises(ValueError, match=r"still\.safetensors: a still among the frames of a shot"):
        relit(desk)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mask", "m.png"),
        ("key", "green"),
        ("colour_space", "sRGB"),
        ("temporal_filter", False),
        ("field_of_view", 40),
        ("precision", "float32"),
    ],
)
def test_what_the_analysis_decided_is_not_decided_again(desk, name, value):
    with pytest.raises(
        ValueError, match=f"{name}: .*shot.relight is analysed already; give it to `relight analyse`"
    ):
        relit(desk, **{name: value})
    assert not list(desk.glob("relit*"))


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"output": "shot"}, ValueError, r"shot: expected the name of a folder that ends in \.relight"),
        ({"source": "s.relight"}, ValueError, r"s\.relight: is analysed already"),
        ({"source": "gone.%04d.exr"}, FileNotFoundError, "no such frames"),
        ({"precision": "half"}, ValueError, "precision: expected one of bfloat16, float32, got 'half'"),
        ({"threads": 0}, ValueError, "threads: expected a whole number from 1 to 1024, got 0"),
        ({"frames": (1, 2)}, ValueError, "frames: a still has none"),
        (
            {"mask": np.zeros((200, 160), np.float32)},
            ValueError,
            "none of 1 frames could be analysed; .*mask: is empty",
        ),
    ],
)
def test_an_analysis_with_invalid_arguments_is_refused_and_saves_none(
    tmp_path, here, arguments, error, message
):
    plate, matte = clothed()
    settings = {"source": plate, "output": "shot.relight", "mask": matte} | arguments
    with pytest.raises(error, match=message):
        shots.analyse(**settings)
    assert not list(tmp_path.rglob("*.safetensors"))


def test_a_folder_without_frames_is_named(tmp_path):
    with pytest.raises(
        FileNotFoundError, match=r"s\.relight: no analysed frames; `relight analyse` makes them"
    ):
        shots.render(tmp_path / "s.relight", KEY, tmp_path / "r.%d.exr")


@pytest.mark.slow
def test_a_killed_analysis_resumes_with_the_missing_frames_only(desk):
    """The command is killed as it analyses; the next run makes what is missing and nothing else."""
    whole, folder = desk / "whole.relight", desk / "killed.relight"
    folder.mkdir()
    environment = os.environ | {"PYTHONPATH": f"{ROOT / 'tests'}{os.pathsep}{ROOT}"}
    plates = ["plate.%04d.exr", "--mask", "matte.%04d.png", "--threads", "1"]
    program = [sys.executable, "-m", "helpers.small_command", "analyse", *plates, "-o"]
    assert kill([*program, folder.name], folder, 1, 0.0, cwd=desk, env=environment)
    there = {path.name: path.stat().st_ino for path in folder.iterdir()}
    assert 1 <= len(there) < 4
    for name in (folder.name, whole.name):
        subprocess.run([*program, name], check=True, cwd=desk, env=environment)
    assert sorted(path.name for path in folder.iterdir()) == list(files(desk))
    assert all((folder / name).stat().st_ino == inode for name, inode in there.items())
    for name in files(desk):
        made = [storage.read_header(where / name) for where in (folder, whole)]
        assert made[0].pop("provenance")["sources"] == made[1].pop("provenance")["sources"]
        assert made[0] == made[1]


@pytest.mark.slow
def test_a_range_is_analysed_with_the_frames_that_steady_its_ends(desk):
    for span in ("103-104", "101-102"):
        shots.analyse(desk / "plate.%04d.exr", desk / "parts.relight", frames=span, **mattes(desk))
    for name in files(desk):
        parts = [desk / folder / name for folder in ("shot.relight", "parts.relight")]
        first, second = ([storage.read_header(path), path.read_bytes()[-5000:]] for path in parts)
        assert first == second


def test_video_relights_a_cache_and_refuses_another_mask(desk):
    from typer.testing import CliRunner

    words = ["--light", "azimuth=-40", "-o", "r.%04d.exr"]
    (desk / "m.png").touch()
    with contextlib.chdir(desk):
        run = CliRunner().invoke(app, ["video", "shot.relight", *words])
        refused = CliRunner().invoke(app, ["video", "shot.relight", "--mask", "m.png", *words])
    assert run.exit_code == 0, run.output
    assert len(list(desk.glob("r.*.exr"))) == 4
    assert refused.exit_code == 2
    assert "mask: shot.relight is analysed already" in refused.output


@pytest.mark.parametrize("moving", [False, True])
def test_a_plate_replaced_during_the_analysis_is_kept_with_the_hash_of_what_was_read(
    plates, tmp_path, moving
):
    """Whatever a run reads, the next run and the renderer know that the plate has changed since."""
    plate = plates.with_name("p.0102.exr")
    source = plates if moving else plate

    def replaced(picture, *arguments, **options):
        if np.isclose(picture[..., 0].max(), 0.2, atol=0.01):  # frame 102: it is read, and not stored yet
            relight.write(plate, somebody(value=0.9))
        return Saved()

    read = FileRecord.of(plate).sha256
    shots.analyse(source, tmp_path / "s.relight", analyse=replaced, temporal_filter=False)
    kept = storage.read_header(
        tmp_path / "s.relight" / ("000102.safetensors" if moving else "still.safetensors")
    )
    hashes = {Path(source["path"]).name: source["sha256"] for source in kept["provenance"]["sources"]}
    assert hashes["p.0102.exr"] == read
    cache = AnalysisCache(tmp_path / "s.relight")
    with pytest.raises(ValueError, match=r"is stale, .*p\.0102\.exr has changed since"):
        cache.read(102)
    with pytest.warns(UserWarning, match="1 of . frames were damaged, or made from other plates"):
        shots.analyse(source, tmp_path / "s.relight", temporal_filter=False)


@pytest.mark.states("Analysis caches", "a rate, an angle or an aspect that is no positive number", "refused")
@pytest.mark.parametrize("value", [-90, "x", [], "1/0", float("nan"), {"a": 1}])
@pytest.mark.parametrize("name", ["rate", "field_of_view", "pixel_aspect"])
def test_numbers_of_a_hostile_header_are_named(tmp_path, name, value):
    (tmp_path / "shot.relight").mkdir()
    frame = cache.frame_file(tmp_path / "shot.relight", 1)
    relight.Subject.nobody((4, 4)).save(frame, provenance={name: value})
    with pytest.raises(ValueError, match=f"{frame.name}: is damaged: its {name} is") as caught:
        getattr(AnalysisCache(tmp_path / "shot.relight"), name)
    assert "\n" not in str(caught.value)
