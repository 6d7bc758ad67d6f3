"""Inputs that nobody meant well: each is refused in one line or answered as the invariants want.

`python benchmarks/fuzz.py` runs the same for longer.
"""

import pytest
from helpers.fuzzing import KINDS, outcome
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

EXAMPLES = {
    "light text": 150,
    "lamp text": 40,
    "lights file": 100,
    "damaged image": 150,
    "damaged mask": 100,
    "foreign image": 100,
    "scene": 60,
    "USD crate": 20,
    "analysed shot": 60,
    "app request": 40,
    "containers": 10,
    "damaged movie": 60,
    "damaged weights": 15,
    "damaged analysis": 40,
    "ICC bytes": 60,
    "Exif bytes": 60,
    "container tags": 120,
    "ONNX model": 40,
    "kept shapes": 60,
    "page fragment": 20,
    "apply": 8,
    "command line": 12,
}


SLOW = {"USD crate"}


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow) if kind in SLOW else kind for kind in KINDS]
)
def test_random_and_damaged_inputs_give_a_valid_result_or_a_named_error(kind, tmp_path):
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
