"""Packages that some tests need."""

from importlib.util import find_spec

import pytest

# Not by `pytest.importorskip`: where PyMatting is imported first, numba compiles all of it for half a minute.
NEEDS_PYMATTING = pytest.mark.skipif(find_spec("pymatting") is None, reason="no PyMatting")
