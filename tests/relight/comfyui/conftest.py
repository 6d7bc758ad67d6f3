"""What tests of the nodes begin with."""

import pytest

from relight.comfyui import host


@pytest.fixture(scope="module", autouse=True)
def small(small_canvas_of_module):
    """The networks on a small canvas: nodes do what the library does, on whatever canvas."""


@pytest.fixture
def comfyui(monkeypatch, tmp_path):
    """ComfyUI's folders: they are one."""
    monkeypatch.setattr(host, "folder", lambda kind: tmp_path)
    return tmp_path
