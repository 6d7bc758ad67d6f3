"""What tests of the nodes begin with."""

import pytest

from relight.comfyui import host


@pytest.fixture
def comfyui(monkeypatch, tmp_path):
    """ComfyUI's folders: they are one."""
    monkeypatch.setattr(host, "folder", lambda kind: tmp_path)
    return tmp_path
