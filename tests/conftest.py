"""What several tests begin with; and no test is skipped in silence."""

import os
from pathlib import Path

import browsing
import numpy as np
import pytest
import standins
import torch

import relight
from relight import people
from shadow import directions
from shadow.data.records import Record

if "PYTEST_XDIST_WORKER" in os.environ:  # a process for each core: their threads would wait for each other
    torch.set_num_threads(1)
    os.environ["OMP_NUM_THREADS"] = "1"  # of the processes that tests start


def sphere(size=96, radius=0.8, behind=True):
    """A white-to-red unit sphere seen along -z without perspective: it casts no shadow on itself."""
    step = (np.arange(size) + 0.5) * 2 / size - 1
    x, y = np.meshgrid(step / radius, -step / radius)
    mask = x**2 + y**2 < 0.98
    normals = np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))], axis=-1)[mask]
    albedo = np.stack(
        [np.full(len(normals), 0.8), normals[:, 2] * 0.5 + 0.3, np.full(len(normals), 0.4)], axis=1
    )
    lights = directions.olat(behind)
    depth = -normals[:, 2:] / 2  # a sphere is twice its radius high
    lit = normals @ lights.T > 0
    about = {"figure": "sphere"}
    return Record.of(mask, normals, albedo, lit, lights, about, depth=depth - depth.mean())


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
def stub(monkeypatch):
    """Shots analysed by no network: their Subjects are `standins.FlatSubject`."""
    monkeypatch.setattr(people, "Subject", standins.FlatSubject)
    standins.FlatSubject.made, standins.FlatSubject.steadied_by = [], []
    return standins.FlatSubject


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


@pytest.fixture(scope="module")
def viewed():
    """The bundled person, small, as a Subject."""
    person = relight.read(Path(__file__).parent.parent / "examples" / "person.png")
    return relight.Subject(np.ascontiguousarray(person[::2, ::2]))


@pytest.fixture(scope="module")
def page_file(viewed, tmp_path_factory):
    """Their page, which names whatever it can with text that is hostile."""
    lights = [
        relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2, temperature=4500, name="key"),
        relight.DirectionalLight(azimuth=140, elevation=20, colour=(0.5, 0.7, 1), name=browsing.HOSTILE[:80]),
    ]
    file, command = tmp_path_factory.mktemp("page") / "person.html", ["relight", "apply", "it's.png"]
    return browsing.policed(viewed.view(file, lights, title=browsing.HOSTILE, command=command))


@pytest.fixture
def page(browser, page_file):
    """That page in a window of its own; it complains of nothing."""
    found = browsing.opened(browser, page_file)
    yield found
    assert not found.complaints
    found.context.close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """In continuous integration a skipped test has failed, unless it is for want of a GPU."""
    report = yield
    if report.skipped and os.environ.get("CI") and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        if "GPU" not in reason:
            report.outcome, report.longrepr = "failed", f"skipped in continuous integration: {reason}"
    return report
