import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT

import relight
from shadow import files
from shadow.files import replacing


def without_unnamed_files(monkeypatch):
    monkeypatch.setattr(files, "unnamed_file", lambda folder: None)


@pytest.fixture(params=[True, False], ids=["unnamed", "named"])
def folder(request, tmp_path, monkeypatch):
    if not request.param:
        without_unnamed_files(monkeypatch)
    return tmp_path


def test_the_file_is_there_when_it_is_whole(folder):
    target = folder / "a.txt"
    target.write_text("old")
    with replacing(target) as path:
        path.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert os.listdir(folder) == ["a.txt"]
    assert target.stat().st_mode & 0o777 == 0o666 & ~umask()


def umask():
    current = os.umask(0)
    os.umask(current)
    return current


def test_an_error_leaves_what_was_there(folder):
    target = folder / "a.txt"
    target.write_text("old")

    def fail():
        with replacing(target) as path:
            path.write_text("half")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        fail()
    assert target.read_text() == "old"
    assert os.listdir(folder) == ["a.txt"]


def test_no_descriptor_is_left_open(folder):
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        with replacing(folder / "a.txt") as path:
            path.write_text("new")
    assert len(os.listdir("/proc/self/fd")) == before


def writes(process):
    """Whether a process has a file without a name open."""
    with contextlib.suppress(FileNotFoundError):  # closed while we look
        return any("(deleted)" in os.readlink(link) for link in Path(f"/proc/{process}/fd").iterdir())
    return False


WRITER = """
import sys, numpy as np, relight
from relight.media import images, movies
noise = np.random.default_rng(0).random((1500, 1500, 3), np.float32)
images.scene_linear("warm", noise[:2, :2])
print("writing", flush=True)
while True:
    if sys.argv[1].endswith(".mp4"):
        movies.write_movie(sys.argv[1], [noise] * 50)
    else:
        relight.write(sys.argv[1], noise)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="unnamed files are Linux's")
@pytest.mark.parametrize("name", ["a.exr", "a.mp4"])
def test_a_kill_in_the_middle_of_a_write_leaves_nothing_half_written(tmp_path, name):
    old = np.full((4, 6, 3), 0.5, np.float32)
    if name == "a.exr":
        relight.write(tmp_path / name, old)
    else:
        (tmp_path / name).write_text("old")
    before = (tmp_path / name).read_bytes()
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, tmp_path / name],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert writer.stdout.readline() == b"writing\n"
    while not writes(writer.pid):
        time.sleep(0.001)
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    assert os.listdir(tmp_path) == [name]
    after = (tmp_path / name).read_bytes()
    assert after == before or relight.read(tmp_path / name).shape == (1500, 1500, 3)


FILL = """
import json, resource, sys
from pathlib import Path
import numpy as np, relight
from relight.media import movies
from relight.scene import nuke
folder, limit, names = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]
noise = np.random.default_rng(0).random((320, 320, 3), np.float32)

def write(name, pixels):
    path = folder / name
    if name.startswith("mask"):
        relight.write_mask(path, pixels[..., 0])
    elif path.suffix in (".mp4", ".mov"):
        movies.write_movie(path, [pixels] * 8)
    elif path.suffix in (".yaml", ".json"):
        relight.write_lights(path, [relight.DirectionalLight(azimuth=i) for i in range(len(pixels) * 8)])
    elif path.suffix == ".nk":
        nuke.write_script(path, {f"light{i}": ("a.exr", f"C_{i}") for i in range(len(pixels) * 8)}, (4, 4))
    else:
        relight.write(path, pixels)

relight.write(folder / "warm.jpg", noise[:2, :2])  # what Pillow imports is imported
(folder / "warm.jpg").unlink()
for name in names:
    write(name, noise[:8, :8])
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
for name in names:
    before = (folder / name).read_bytes()
    try:
        write(name, noise)
        problem = None
    except Exception as error:
        problem = [isinstance(error, OSError), str(error)]
    kept = (folder / name).read_bytes() == before
    print(json.dumps([name, problem, kept, sorted(path.name for path in folder.iterdir())]), flush=True)
"""
NAMES = [
    *("a.exr", "a.png", "a.tif", "a.hdr", "mask.png", "mask.tif", "mask.exr", "a.mp4", "a.mov"),
    *("l.yaml", "l.json", "s.nk", "a.jpg"),
]


@pytest.fixture(scope="module", params=["a limit", pytest.param("a small disk", marks=pytest.mark.slow)])
def full_disk(request, tmp_path_factory):
    """{file's name: what came of writing it where there is no room}, in a process of its own.

    Without bytecode (-B): CPython 3.11 keeps what a limit leaves of it, which no process can import later.
    """
    folder = tmp_path_factory.mktemp("full")
    limit = 24000 if request.param == "a limit" else 0
    if not limit:
        mount = ["mount", "-t", "tmpfs", "-o", "size=128k", "tmpfs", folder]
        if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode:
            pytest.skip("needs the right to mount a small disk")
    try:
        writer = subprocess.run(
            [sys.executable, "-B", "-c", FILL, folder, str(limit), *NAMES], capture_output=True, text=True
        )
    finally:
        if not limit:
            subprocess.run(["umount", folder], check=True)
    lines = [json.loads(line) for line in writer.stdout.splitlines()]
    return folder, {name: rest for name, *rest in lines}, writer


@pytest.mark.skipif(sys.platform != "linux", reason="limits and small disks as Linux has them")
@pytest.mark.parametrize("name", NAMES)
def test_a_full_disk_is_an_error_that_keeps_the_old_file(full_disk, name):
    folder, results, writer = full_disk
    assert name in results, f"the process ended: {writer.stderr[-400:]}"
    problem, kept, left = results[name]
    assert problem is not None, "no error"
    assert problem[0], "no OSError"
    assert str(folder / name) in problem[1]
    assert "/proc/" not in problem[1]
    assert f".{Path(name).stem}-" not in problem[1]
    assert "\n" not in problem[1]
    assert kept
    assert left == sorted(NAMES)


CUT = """
import resource, sys
from pathlib import Path
import numpy as np, relight
noise = np.random.default_rng(0).random((48, 48, 3), np.float32)
for name in sys.argv[2:]:
    path = Path(sys.argv[1]) / name
    relight.write(path, noise)
    whole = path.read_bytes()
    for missing in (1, 50, 900):
        limit = (len(whole) - missing, resource.RLIM_INFINITY)
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        try:
            relight.write(path, noise[::-1])
            print(name, missing, "no error")
        except OSError:
            if path.read_bytes() != whole:
                print(name, missing, "the old file is gone")
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
print("done")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits as Linux has them")
def test_the_last_bytes_are_not_lost_either(tmp_path):
    """What a library writes as it closes the file, when there is no room for that."""
    names = ["a.exr", "a.png", "a.tif", "a.hdr", "a.jpg"]
    command = [sys.executable, "-B", "-c", CUT, tmp_path, *names]
    found = subprocess.run(command, capture_output=True, text=True)
    assert found.stdout == "done\n", found.stdout + found.stderr[-400:]


def test_a_symbolic_link_is_written_through(folder):
    (folder / "disk").mkdir()
    (folder / "disk" / "a.txt").write_text("old")
    (folder / "a.txt").symlink_to("disk/a.txt")
    (folder / "new.txt").symlink_to("disk/new.txt")
    for name in ("a.txt", "new.txt"):
        with replacing(folder / name) as path:
            path.write_text("new")
        assert (folder / name).is_symlink()
        assert (folder / "disk" / name).read_text() == "new"
    assert sorted(os.listdir(folder / "disk")) == ["a.txt", "new.txt"]


def test_what_the_system_refuses_names_the_users_path_alone(folder):
    def fail(error):
        with replacing(folder / "a.txt") as path:
            raise error(path)

    target = folder / "a.txt"
    with pytest.raises(PermissionError, match=rf"^{target}: cannot be written: Permission denied$"):
        fail(lambda path: PermissionError(13, "Permission denied", str(path)))
    with pytest.raises(OSError, match=rf"^{target}: cannot be written: No space left on device$") as caught:
        fail(lambda path: OSError(28, "No space left on device"))
    assert caught.value.errno == 28
    with pytest.raises(OSError, match=rf"^encoder: cannot write {target}$"):
        fail(lambda path: RuntimeError(f"encoder: cannot write {path}"))
    with pytest.raises(FileNotFoundError, match=r"No such file or directory: 'plate\.exr'"):  # is another's
        fail(lambda path: FileNotFoundError(2, "No such file or directory", "plate.exr"))


def test_what_cannot_be_written_is_refused_early(tmp_path, monkeypatch):
    (tmp_path / "a.png").mkdir()
    with pytest.raises(IsADirectoryError, match=r"a\.png: is a folder, expected the name of a file"):
        files.check_writable(tmp_path / "a.png", (".png",))
    (tmp_path / "l.png").symlink_to("gone/l.png")
    with pytest.raises(FileNotFoundError, match=r"l\.png: the folder .*gone does not exist"):
        files.check_writable(tmp_path / "l.png", (".png",))
    monkeypatch.setattr(os, "access", lambda folder, mode: False)
    with pytest.raises(PermissionError, match=r"b\.png: the folder .* is not writable"):
        files.check_writable(tmp_path / "b.png", (".png",))
