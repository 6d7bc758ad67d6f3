"""What tests of training photographs begin with."""

import pytest

from shadow.data import photographs


@pytest.fixture
def clean(monkeypatch):
    """Photographs without noise, blur and other flaws."""
    monkeypatch.setattr(photographs.Flaws, "__call__", lambda _, rgb, mask: (rgb, mask))
