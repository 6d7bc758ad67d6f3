"""What benchmarks/albedo_colour.py measures, on the records of tests/data."""

import numpy as np
import pytest
from helpers import ROOT

import relight
from relight.analysis.old_light import OldLight
from shadow.data.records import Records

pytestmark = pytest.mark.usefixtures("full_canvas")


@pytest.fixture
def benchmark(benchmark_module):
    return benchmark_module("albedo_colour")


def scored(benchmark, record, name, old_light=None):
    """Errors in the key's light, in its shadow, and of the picture in its own lights, whole and inside."""
    seen = benchmark.photograph(record, *benchmark.lightings(record.directions, 0)[name])
    return benchmark.errors(relight.Subject(seen.pixels, seen.mask, old_light=old_light), seen)


@pytest.mark.parametrize(
    ("name", "most", "colour", "worse"),
    [
        ("sun and sky, curve", 0.68, 0.145, 0.01),
        pytest.param("sun and sky", 0.65, 0.12, 0.01, marks=pytest.mark.slow),
        pytest.param("evening", 0.32, 0.14, 0.02, marks=pytest.mark.slow),
    ],
)
def test_the_colour_of_sun_and_sky_leaves_the_albedo_of_a_body(benchmark, name, most, colour, worse):
    record = Records([ROOT / "tests" / "data"])[0]
    left_in, found = (scored(benchmark, record, name, light) for light in (OldLight(), None))
    assert found[1] < most * left_in[1]
    assert found[1] < colour
    assert found[0] < left_in[0] + worse
    assert found[2] < 0.055  # relit by its own lights, it stays itself
    assert found[3] < found[2]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["neutral", "neutral, curve"])
def test_neutral_lights_leave_the_colour_of_a_body(benchmark, name):
    record = Records([ROOT / "tests" / "data"])[0]
    left_in, found = (scored(benchmark, record, name, light) for light in (OldLight(), None))
    assert found[1] < left_in[1] + 0.01
    assert found[0] < left_in[0] + 0.01


def test_a_red_wall_lights_the_side_away_from_the_key(benchmark):
    record = Records([ROOT / "tests" / "data"])[0]
    key, rest, *_ = benchmark.lightings(record.directions, 0)["red wall"]
    side = -np.sign(key.sum(axis=1) @ record.directions[:, 0])
    there, opposite = (rest[side * sign * record.directions[:, 0] > 0.5].sum(axis=0) for sign in (1, -1))
    assert there[0] > 2 * there[2]
    assert there[0] > 2 * opposite[0]
    assert opposite[0] < 1.3 * opposite[2]
