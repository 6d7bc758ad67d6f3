"""A shot on a Dask cluster whose workers, and scheduler, are killed."""

import os
import socket
import subprocess
import sys
import time
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import pytest
from helpers import ROOT, shots
from helpers.killing import differences
from helpers.rising import STILL
from helpers.standins import FlatSubject, ball, image_of, somebody

import relight
from relight.media.movies import Movie
from relight.media.sequences import FrameRange
from relight.subject import weights

dask = pytest.importorskip("dask")
pytest.importorskip("distributed")  # before its configuration is changed
psutil = pytest.importorskip("psutil")
cluster = pytest.importorskip("relight.distributed.dask_cluster")

PRELOAD = str(ROOT / "tests" / "helpers" / "worker.py")


@pytest.fixture(autouse=True)
def stub():
    """In workers."""
    with dask.config.set({"distributed.worker.preload": [PRELOAD]}):
        yield


@pytest.fixture
def plates(tmp_path):
    """Sixteen frames of somebody who walks."""
    (tmp_path / "plates").mkdir()
    for number in range(1, 17):
        relight.write(tmp_path / "plates" / f"p.{number:02d}.exr", somebody(number % 10, 0.05 * number))
    return tmp_path / "plates" / "p.%02d.exr"


def outputs(folder):
    folder.mkdir(exist_ok=True)
    return [folder / name for name in ("r.%02d.exr", "r.nk", "r.mov")]


def workers():
    """The processes that make frames."""
    return [child for child in psutil.Process().children() if makes_frames(child)]


def makes_frames(process):
    try:
        return process.status() != psutil.STATUS_ZOMBIE and "spawn_main" in " ".join(process.cmdline())
    except psutil.NoSuchProcess:  # it ended while it was looked at
        return False


@pytest.mark.slow
def test_workers_that_are_killed_lose_nothing(plates, tmp_path):
    killed = []

    def kill(done, total, what):
        if what == "Relighting" and len(killed) < 3:
            while not (alive := workers()):  # both were killed, and are being started again
                time.sleep(0.1)
            alive[-1].kill()
            killed.append(alive[-1].pid)

    assert shots.render(plates, STILL, outputs(tmp_path / "one"), threads=1, analyse=FlatSubject) == {}
    found = shots.distribute(plates, STILL, outputs(tmp_path / "many"), workers=2, progress=kill)
    assert found == {}
    assert len(set(killed)) == 3
    assert differences(tmp_path / "many", tmp_path / "one") == []
    assert workers() == []


@pytest.mark.slow
def test_workers_light_by_a_preset_or_a_scene_as_one_process_does(here):
    """One worker, with the networks on the same canvas, does both."""
    from distributed import LocalCluster

    for number in (1, 2):
        relight.write(f"p.{number:02d}.exr", image_of(ball(60, 50, centre=(0.3 + 0.1 * number, 0.5))[0]))
    shots.write_scene(Path("scene.gltf"))
    settings = {"frames": "1-2", "threads": 1, "precision": "float32"}
    lightings = {"preset": {"lights": (), "preset": "rim"}}
    lightings["scene"] = {"lights": "scene.gltf", "subject_at": (0, 0, -3)}
    with (
        dask.config.set({"distributed.worker.preload": [PRELOAD.replace("worker.py", "small_worker.py")]}),
        LocalCluster(n_workers=1, threads_per_worker=1, memory_limit=0, dashboard_address=None) as one,
    ):
        for name, lighting in lightings.items():
            kept, made = Path(f"one-{name}"), Path(f"many-{name}")
            kept.mkdir()
            made.mkdir()
            assert shots.render("p.%02d.exr", outputs=kept / "r.%02d.exr", **settings, **lighting) == {}
            spread = {"scheduler": one.scheduler_address, **settings, **lighting}
            assert shots.distribute("p.%02d.exr", outputs=made / "r.%02d.exr", **spread) == {}
            assert differences(made, kept) == [], name


@pytest.mark.slow
def test_frames_that_fail_are_named_and_the_rest_is_made(plates, tmp_path):
    broken, deadly = (plates.with_name(f"p.{number:02d}.exr") for number in (3, 6))
    broken.write_bytes(broken.read_bytes()[:300])
    relight.write(deadly, somebody(value=3))
    folder = tmp_path / "made"
    arguments = {"frames": "1-8", "workers": 1, "chunk": 2, "temporal_filter": False}
    problems = shots.distribute(plates, STILL, outputs(folder), **arguments)
    assert list(problems) == [3, 6]
    assert "p.03.exr: " in problems[3]
    assert "the worker died" in problems[6]
    assert [path.name for path in sorted(folder.glob("*.exr"))] == [
        f"r.{n:02d}.exr" for n in (1, 2, 4, 5, 7, 8)
    ]
    assert len(Movie(folder / "r.mov").numbers) == 8


@pytest.mark.slow
def test_a_scheduler_that_goes_away(plates, tmp_path):
    started = [sys.executable, "-m", "dask"]
    address = f"tcp://127.0.0.1:{free_port()}"
    scheduler = subprocess.Popen(
        [*started, "scheduler", "--port", address.rpartition(":")[2], "--no-dashboard"]
    )
    settings = {"cwd": ROOT, "env": os.environ | {"PYTHONPATH": str(ROOT / "tests")}}
    worker = subprocess.Popen(
        [*started, "worker", address, "--nthreads", "1", "--preload", PRELOAD], **settings
    )

    def stop(done, total, what):
        if what == "Relighting":
            scheduler.kill()

    try:
        with pytest.raises(ConnectionError, match=f"{address}: the scheduler went away"):
            shots.distribute(plates, STILL, outputs(tmp_path / "made"), scheduler=address, progress=stop)
    finally:
        for process in (scheduler, worker):
            process.kill()
            process.wait()
    there = {path: path.stat().st_mtime_ns for path in (tmp_path / "made").glob("*.exr")}
    assert there
    arguments = {"workers": 1, "resume": True}
    assert shots.distribute(plates, STILL, outputs(tmp_path / "made"), **arguments) == {}
    assert all(path.stat().st_mtime_ns == time for path, time in there.items())
    assert len(list((tmp_path / "made").glob("*.exr"))) == 16


def test_a_scheduler_that_went_away_is_named_also_when_the_client_has_given_up():
    address = "tcp://192.0.2.1:8786"
    client = SimpleNamespace(scheduler=SimpleNamespace(addr=address))
    run, cancelled = cluster._Run(client, (), False), Future()
    client.scheduler = None
    cancelled.cancel()
    with pytest.raises(ConnectionError, match=f"{address}: the scheduler went away"):
        run.failures(cancelled, FrameRange([1, 2]))


@pytest.mark.slow
def test_a_full_disk_keeps_what_is_finished(plates, tmp_path, monkeypatch):
    monkeypatch.setenv("WRONG", "full disk")
    output, settings = tmp_path / "r.%02d.exr", {"workers": 1, "chunk": 4, "temporal_filter": False}
    problems = shots.distribute(plates, STILL, output, frames="1-8", **settings)
    there = {path: path.stat().st_ino for path in tmp_path.glob("*.exr")}
    assert list(problems) == [6, 7, 8]
    assert all("No space left on device" in reason for reason in problems.values())
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "plates",
        *(f"r.{n:02d}.exr" for n in range(1, 6)),
    ]
    monkeypatch.delenv("WRONG")
    assert shots.distribute(plates, STILL, output, frames="1-8", resume=True, **settings) == {}
    assert all(path.stat().st_ino == inode for path, inode in there.items())
    assert len(list(tmp_path.glob("*.exr"))) == 8


@pytest.mark.slow
def test_workers_without_the_weights_or_with_others_leave_frames_to_the_rest(plates, tmp_path):
    from distributed import Nanny, Scheduler, SpecCluster

    def worker(wrong):
        return {"cls": Nanny, "options": {"nthreads": 1, "env": {"WRONG": wrong}}}

    scheduler = {"cls": Scheduler, "options": {"dashboard": False, "host": "127.0.0.1"}}
    kinds = {wrong: worker(wrong) for wrong in ("no weights", "other weights", "")}
    with SpecCluster(kinds, scheduler, silence_logs="CRITICAL") as several:
        several.wait_for_workers(len(kinds))  # a frame goes to another one if there is one
        settings = {"scheduler": several.scheduler_address, "chunk": 2, "temporal_filter": False}
        output = tmp_path / "r.%02d.exr"
        assert shots.distribute(plates, STILL, output, frames="1-8", **settings) == {}
    assert len(list(tmp_path.glob("r.*.exr"))) == 8


@pytest.mark.parametrize("number", [0, 1])
def test_a_worker_of_another_version_or_other_weights_names_itself(number, monkeypatch):
    expected = [relight.__version__, *weights()]
    expected[number] = "another"
    monkeypatch.setattr("distributed.get_worker", lambda: SimpleNamespace(address="tcp://w:1"))
    address, failed = cluster.make_frames((), FrameRange([3, 4]), False, tuple(expected))
    assert address == "tcp://w:1"
    assert list(failed) == [3, 4]
    kind = ("version of relight", "weights")[number]
    assert failed[3].startswith(f"tcp://w:1: has another {kind}, expected ('")


def test_invalid_arguments_and_a_silent_scheduler_are_refused(plates, tmp_path, monkeypatch, missing):
    one = tmp_path / "r.%02d.exr"
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 1)
    for arguments, message in [
        ({}, "scheduler: expected either"),
        ({"scheduler": "tcp://127.0.0.1:9", "workers": 2}, "scheduler: expected either"),
        ({"scheduler": ""}, r"scheduler: expected an address, such as tcp://farm:8786, got ''"),
        ({"workers": 1, "passes": ["depths"]}, "passes: expected several values, each one of"),
        ({"workers": 1, "frames": "2-1"}, "frames: expected"),
    ]:
        with pytest.raises(ValueError, match=message):
            shots.distribute(plates, STILL, one, **arguments)
    with pytest.raises(ConnectionError, match=r"tcp://127\.0\.0\.1:9: no Dask scheduler answers there"):
        shots.distribute(plates, STILL, one, scheduler="tcp://127.0.0.1:9")
    missing("distributed")
    with pytest.raises(ImportError, match=r"pip install '.*\[farm\]'"):
        shots.distribute(plates, STILL, one, workers=1)


def test_a_scheduler_that_accepts_and_says_nothing_is_given_up(plates, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 1)
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen(8)  # the system accepts; nobody ever answers
        address = f"tcp://127.0.0.1:{listening.getsockname()[1]}"
        with pytest.raises(ConnectionError, match=f"{address}: no Dask scheduler answers there within 1 s"):
            shots.distribute(plates, STILL, tmp_path / "r.%02d.exr", scheduler=address)


def free_port():
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        return listening.getsockname()[1]
