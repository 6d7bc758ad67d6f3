"""The caller's torch: dtype, device, autocast and inference mode change no result, and stay."""

import contextlib
import subprocess
import sys
import threading

import numpy as np
import pytest
import torch

import relight
import shading
import shadow
from shadow.torch_settings import isolated, isolated_class, own_settings

LIGHT = relight.DirectionalLight(azimuth=-40, elevation=30)


@contextlib.contextmanager
def default_dtype(dtype):
    torch.set_default_dtype(dtype)
    try:
        yield
    finally:
        torch.set_default_dtype(torch.float32)


@contextlib.contextmanager
def default_device(name):
    torch.set_default_device(name)
    try:
        yield
    finally:
        torch.set_default_device(None)


STATES = {
    "float64": lambda: default_dtype(torch.float64),
    "bfloat16": lambda: default_dtype(torch.bfloat16),
    "meta": lambda: default_device("meta"),
    "with meta": lambda: torch.device("meta"),
    "autocast": lambda: torch.autocast("cpu", dtype=torch.bfloat16),
    "inference": torch.inference_mode,
    "no gradients": torch.no_grad,
}


@pytest.fixture(scope="module")
def figure():
    rgb = np.random.default_rng(0).uniform(0.05, 0.6, (100, 80, 3)).astype(np.float32)
    mask = np.zeros((100, 80), np.float32)
    mask[8:92, 25:55] = 1
    return rgb, mask


def everything(rgb, mask):
    """Pictures by all packages, and lights of all kinds."""
    subject = relight.Subject(rgb, mask)
    near = relight.PointLight((0.4, 0.3, 1.0), radius=0.05)
    sky = relight.EnvironmentLight(np.ones((8, 16, 3), np.float32))
    analysis = shading.analyse(rgb, mask)
    return [
        subject.relit([LIGHT, near, sky], gloss=0.3),
        *subject.layers([LIGHT]).values(),
        subject.albedo, subject.normals, subject.depth, subject.position,
        subject.visibility([[0.0, 0.6, 0.8]]), subject.shading([[0.0, 0.6, 0.8]]),
        *subject.shadows(LIGHT, relight.Floor(height=1.6))[0].values(),
        relight.render(rgb, LIGHT, mask=mask)[0],
        shadow.infer(rgb, mask, [[0.0, 0.6, 0.8]]), shadow.infer_normals(rgb, mask),
        analysis.shading([[0.0, 0.6, 0.8]]), analysis.albedo, analysis.normals,
        shadow.baseline(analysis.normals, [[0.0, 0.6, 0.8]]),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def usual(figure):
    return everything(*figure)


def state():
    return (
        torch.get_default_dtype(), torch.get_default_device(), torch.is_autocast_enabled("cpu"),
        torch.is_inference_mode_enabled(), torch.is_grad_enabled(), torch.get_num_threads(),
    )  # fmt: skip


@pytest.mark.parametrize("name", STATES)
def test_settings_of_the_caller_change_nothing_and_stay(figure, usual, name):
    with STATES[name]():
        before = state()
        found = everything(*figure)
        assert state() == before
    assert state()[:2] == (torch.float32, torch.device("cpu"))
    for one, other in zip(found, usual, strict=True):
        assert np.asarray(one).dtype == np.asarray(other).dtype
        np.testing.assert_allclose(one, other, atol=1e-5)


@pytest.mark.slow
def test_packages_that_are_imported_later_are_whole():
    program = (
        "import torch; torch.set_default_dtype(torch.float64); torch.set_default_device('meta')\n"
        "import numpy as np, shading, relight\n"
        "rgb, mask = np.full((64, 48, 3), 0.3, np.float32), np.zeros((64, 48), np.float32)\n"
        "mask[8:56, 12:36] = 1\n"
        "assert shading.infer(rgb, mask, [[0, 0, 1.0]]).max() > 0.3\n"
        "assert relight.apply(rgb, relight.DirectionalLight(), mask=mask)[30, 20].min() > 0\n"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr


def test_errors_leave_the_settings_too():
    with default_dtype(torch.float64):
        with pytest.raises(ValueError, match="mask"):
            shadow.analyse(np.zeros((8, 8, 3), np.float32), np.zeros((8, 8), np.float32))
        assert torch.get_default_dtype() == torch.float64


def test_threads_that_overlap_restore_the_callers_dtype():
    inside, go_on, seen = threading.Event(), threading.Event(), []

    @isolated
    def long():
        inside.set()
        go_on.wait(10)
        seen.append(torch.zeros(1).dtype)

    with default_dtype(torch.float64):
        thread = threading.Thread(target=long)
        thread.start()
        inside.wait(10)
        with own_settings():
            seen.append(torch.zeros(1).dtype)
        seen.append(torch.get_default_dtype())  # float32 while the other thread computes
        go_on.set()
        thread.join()
        assert torch.get_default_dtype() == torch.float64
    assert seen == [torch.float32] * 3


def test_a_class_keeps_its_kinds_of_members():
    @isolated_class
    class Example:
        """A class."""

        def __init__(self, value):
            self.value = torch.tensor(value)

        @classmethod
        def of(cls):
            return cls(0.5)

        @property
        def dtype(self):
            """The dtype."""
            return self.value.dtype

        def several(self):
            yield self.value

    with default_dtype(torch.float64):
        assert Example.of().dtype == torch.float32
    assert Example.dtype.__doc__ == "The dtype."
    assert list(Example(1.0).several()) == [1]


@pytest.mark.parametrize("value", ["meta", torch.device("meta")])
def test_a_device_without_values_is_named(figure, value):
    with pytest.raises(
        ValueError, match=r"device: 'meta' holds no values; expected a device of this machine, cpu"
    ):
        relight.Subject(*figure, device=value)


@pytest.mark.parametrize("value", ["hpu", "xla", "cuda:99", "mps"])
def test_a_device_that_is_not_there_is_said_to_be_unavailable(figure, value):
    with pytest.raises(ValueError, match=r"device: '.*' is not available: .* has no such device; use cpu"):
        relight.Subject(*figure, device=value)


@pytest.mark.parametrize("ask", ["visibility", "shading"])
def test_directions_that_require_a_gradient_are_refused_in_words(figure, ask):
    directions = torch.tensor([[0.0, 0.6, 0.8]], requires_grad=True)
    analysis, subject = shading.analyse(*figure), relight.Subject(*figure)
    for asked in (analysis, subject):
        with pytest.raises(ValueError, match=r"directions: requires a gradient, which is not computed here"):
            getattr(asked, ask)(directions)
        assert getattr(asked, ask)(directions.detach()).max() > 0
    for wrong, name in (
        (lambda value: relight.DirectionalLight(azimuth=-40, intensity=value), "intensity"),
        (lambda value: relight.PointLight((0, 0, value)), "position"),
        (lambda value: subject.relit([], amount=value), "amount"),
        (lambda value: relight.EnvironmentLight(value.expand(8, 16, 3)), "image"),
    ):
        with pytest.raises(ValueError, match=f"{name}: requires a gradient"):
            wrong(torch.tensor(0.5, requires_grad=True))
