"""What several tests begin with; and no test is skipped in silence."""

import contextlib
import errno
import importlib
import os
import sys

import numpy as np
import pytest
import torch
from helpers import ROOT, browsing, damage, standins
from helpers.sphere import sphere

import relight

os.environ["RELIGHT_CACHE"] = os.devnull  # tests find nothing that their user has fetched
if "PYTEST_XDIST_WORKER" in os.environ:  # a process for each core: their threads would wait for each other
    torch.set_num_threads(1)
    os.environ["OMP_NUM_THREADS"] = "1"  # of the processes that tests start
    # numba sets the number of threads of OpenMP, which torch uses too, when its first kernel is compiled.
    os.environ["NUMBA_NUM_THREADS"] = "1"


@pytest.fixture
def ball():
    return sphere()


@pytest.fixture
def person():
    """A linear image (H, W, 3) and a mask (H, W) of a figure that is two boxes: enough to run networks."""
    rgb = np.random.default_rng(0).uniform(0.05, 0.6, (200, 160, 3)).astype(np.float32)
    mask = np.zeros((200, 160), np.float32)
    mask[20:180, 60:100] = 1
    mask[60:80, 30:130] = 1
    return rgb, mask


@pytest.fixture
def here(tmp_path):
    """A folder of the test's own, in which it works."""
    with contextlib.chdir(tmp_path):
        yield tmp_path


@pytest.fixture
def missing(monkeypatch):
    """Lets packages be as if they were not installed."""
    return lambda *packages: [monkeypatch.setitem(sys.modules, name, None) for name in packages]


@pytest.fixture
def full_disk(monkeypatch):
    """A context in which no file can be flushed to the disk, once a condition holds."""
    flush = os.fsync

    @contextlib.contextmanager
    def full(begun=lambda: True):
        def refuse(descriptor):
            if begun():
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            flush(descriptor)

        with monkeypatch.context() as disk:
            disk.setattr(os, "fsync", refuse)
            yield

    return full


@pytest.fixture
def benchmark_module(monkeypatch):
    """Imports a program of benchmarks/ by its name."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return importlib.import_module


@pytest.fixture
def no_networks(monkeypatch):
    """Whoever loads a network fails."""
    monkeypatch.setattr("shadow.networks.checkpoints.load", None)


@pytest.fixture(scope="session")
def finder(tmp_path_factory):
    """Finds people who are red discs."""
    pytest.importorskip("openvino")
    from helpers.finders import small_finder

    return small_finder(tmp_path_factory.mktemp("networks"))


@pytest.fixture
def fetched(finder, monkeypatch):
    """The networks that find people are there: they find red discs, whose masks need no mending."""
    monkeypatch.setattr("relight.matting.people.finder.load", lambda: finder)
    monkeypatch.setattr("relight.matting.cutout_network.load", lambda: lambda crop, mask: mask)


@pytest.fixture(scope="session", autouse=True)
def small_canvas():
    """The networks on a small canvas, in tests of all but their maps: see `damage.small_canvas`."""
    with damage.small_canvas():
        yield


@pytest.fixture
def full_canvas(small_canvas):
    """The networks on their own canvas."""
    with damage.small_canvas(damage.SHIPPED_CANVAS):
        yield


@pytest.fixture
def stub():
    """Shots analysed by no network."""
    return standins.FlatShots()


@pytest.fixture
def plates(tmp_path):
    """Five frames, 101 to 105, of somebody who walks and grows brighter."""
    (tmp_path / "plates").mkdir()
    for number in range(101, 106):
        relight.write(
            tmp_path / "plates" / f"p.{number:04d}.exr", standins.somebody(number - 99, 0.1 * (number - 100))
        )
    return tmp_path / "plates" / "p.####.exr"


@pytest.fixture(scope="module")
def browser():
    with browsing.browser() as found:
        yield found


@pytest.fixture(scope="session")
def viewed():
    """The bundled person, small, as a Subject."""
    person = relight.read(ROOT / "examples" / "person.png")
    with damage.small_canvas(256):
        return relight.Subject(np.ascontiguousarray(person[::2, ::2]))


@pytest.fixture(scope="session")
def page_file(viewed, tmp_path_factory):
    """Their page, which names whatever it can with text that is hostile."""
    lights = [
        relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2, temperature=4500, name="key"),
        relight.DirectionalLight(azimuth=140, elevation=20, colour=(0.5, 0.7, 1), name=browsing.HOSTILE[:80]),
    ]
    file, command = tmp_path_factory.mktemp("page") / "person.html", ["relight", "apply", "it's.png"]
    return browsing.policed(viewed.view(file, lights, title=browsing.HOSTILE, command=command))


@pytest.fixture(scope="module")
def kept_page(browser, page_file):
    """That page in a window that the tests of a file share, and the state that it began with."""
    found = browsing.opened(browser, page_file)
    yield found, browsing.begun(found)
    found.context.close()


@pytest.fixture
def page(kept_page):
    """That page as it was opened; it complains of nothing."""
    found, begun = kept_page
    found.complaints.clear()
    browsing.reset(found, begun)
    yield found
    assert not found.complaints


# What takes long, the longest first: a file that came last would keep one process busy while the others wait.
LONG = (
    "relight/app/", "relight/viewer/", "test_documents", "relight/distributed/",
    "relight/comfyui/test_extension", "shadow/lightstage/", "relight/cli/", "test_types", "test_docstrings",
    "test_shipped", "shadow/training/", "relight/pipeline/test_kill", "relight/pipeline/test_cache",
)  # fmt: skip


def _start(item):
    """The place of a test's file in LONG, or its end."""
    path = item.path.relative_to(ROOT / "tests").as_posix()
    return next((place for place, start in enumerate(LONG) if path.startswith(start)), len(LONG))


def pytest_collection_modifyitems(items):
    """Let processes that share the tests begin with the files that take long."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        items.sort(key=_start)


def _fail_if_skipped_in_ci(report):
    """Turn a skip into a failure in continuous integration, unless it is for want of a GPU."""
    if report.skipped and os.environ.get("CI") and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        if "GPU" not in reason:
            report.outcome, report.longrepr = "failed", f"skipped in continuous integration: {reason}"
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    return _fail_if_skipped_in_ci((yield))


# `pytest.importorskip` at the top of a module skips the module while it is collected: none of its tests
# exist then, so the hook above sees no report of them.
@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    return _fail_if_skipped_in_ci((yield))
