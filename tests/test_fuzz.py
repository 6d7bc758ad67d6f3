"""Inputs that nobody meant well: each is refused in one line or answered as the invariants want.

`python benchmarks/fuzz.py` runs the same for longer.
"""

import pytest
from fuzzing import KINDS, outcome
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

EXAMPLES = {
    "light text": 150,
    "lamp text": 40,
    "lights file": 100,
    "damaged image": 150,
    "damaged mask": 100,
    "containers": 10,
    "damaged movie": 60,
    "damaged weights": 15,
    "damaged analysis": 40,
    "apply": 8,
    "command line": 12,
}


@pytest.mark.parametrize("kind", KINDS)
def test_whatever_comes(kind, tmp_path):
    @settings(
        max_examples=EXAMPLES[kind],
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(random=st.randoms(use_true_random=False))
    def run(random):
        outcome(kind, random, tmp_path)

    run()
