"""A folder for compiled code where neither the installation nor the home can be written."""

import os
import sys
from pathlib import Path

import pytest

from relight.matting import numba_cache


@pytest.fixture
def closed(monkeypatch, tmp_path):
    """No folder that Numba tries can be written, and the environment is put back."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    (tmp_path / "file").write_text("no folder")
    if "numba" in sys.modules:
        monkeypatch.setattr(sys.modules["numba"].config, "CACHE_DIR", "")
    yield [Path("/proc/none"), tmp_path / "file" / "numba"]
    os.environ.pop("NUMBA_CACHE_DIR", None)


def test_a_temporary_folder_of_this_user_alone_is_made_once(closed):
    numba_cache.ensure_numba_cache(closed)
    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    assert folder.is_dir()
    assert folder.stat().st_mode & 0o077 == 0
    numba_cache.ensure_numba_cache(closed)
    assert os.environ["NUMBA_CACHE_DIR"] == str(folder)


def test_a_folder_that_is_given_or_usual_stays(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/elsewhere")
    numba_cache.ensure_numba_cache()
    assert os.environ["NUMBA_CACHE_DIR"] == "/elsewhere"
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    numba_cache.ensure_numba_cache()
    assert "NUMBA_CACHE_DIR" not in os.environ
