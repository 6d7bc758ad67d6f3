"""Puts the package of this checkout, and the helpers of its tests, where Python finds them.

>>> from checkout import ROOT
>>> from helpers import browsing
"""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]  # tests/relight would hide the package if it came first
