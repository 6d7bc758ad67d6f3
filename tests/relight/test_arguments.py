"""What an argument is stands in its annotation; wrong ones end in one line that names them."""

import pickle
import subprocess
import sys
from random import Random
from typing import Annotated, Literal, get_args

import numpy as np
import pytest
import torch
from annotated_types import Gt, Interval
from helpers import ROOT
from helpers.argument_fuzz import Calls

import relight
from relight import quantities
from relight.arguments import About, Converts, checked, checks_arguments, described, limits, meant, read

CALLS = 150  # benchmarks/fuzz_arguments.py makes thousands


def test_calls_with_a_wrong_argument_are_answered_or_refused_in_one_line_that_names_it(here):
    calls = Calls(here)
    wrong = [problem for seed in range(CALLS) if (problem := calls.attempt(Random(seed)))]
    assert not wrong


@pytest.mark.parametrize(
    ("kind", "value", "held"),
    [
        (float, np.float32(0.5), 0.5),
        (float, torch.tensor(2), 2.0),
        (int, np.int64(3), 3),
        (bool, np.bool_(True), True),
        (Annotated[tuple[float, float, float], Converts()], np.arange(3.0), (0.0, 1.0, 2.0)),
        (Annotated[tuple[float, float, float], Converts()], [1, 2, 3], (1.0, 2.0, 3.0)),
        (quantities.GivenColour, "orange", (1.0, 0.376262, 0.0)),
        (quantities.GivenColour, "#ffffff", (1.0, 1.0, 1.0)),
        (quantities.GivenColour, "1/0.5/0", (1.0, 0.5, 0.0)),
    ],
)
def test_values_are_converted(kind, value, held):
    result = checked("x", value, kind)
    assert result == held
    assert type(result) is type(held)


@pytest.mark.parametrize(
    ("kind", "value", "error", "message"),
    [
        (quantities.Gloss, "1", TypeError, "x: expected a number from 0 to 1, got '1'"),
        (quantities.Gloss, True, TypeError, "x: expected a number from 0 to 1, got True"),
        (quantities.Gloss, 2, ValueError, "x: expected a number from 0 to 1, got 2"),
        (quantities.Gloss, 10**400, TypeError, "x: expected a number from 0 to 1, got 1000000000.*0000"),
        (quantities.Exposure, np.nan, ValueError, "x: expected a finite number of stops from -64 to"),
        (Annotated[float, Gt(0)], 0, ValueError, "x: expected a number above 0, got 0"),
        (Literal["fit", "fill"], "fil", ValueError, "x: expected one of fit, fill, .*; did you mean fill"),
        (quantities.GivenColour, "oragne", ValueError, "x: expected linear red.*; did you mean orange"),
        (int, 1.5, TypeError, "x: expected a whole number, got 1.5"),
        (str, np.zeros((2, 3)), TypeError, r"x: expected a text, got ndarray of shape \(2, 3\)"),
    ],
)  # fmt: skip
def test_what_is_expected_and_what_was_given_stand_in_one_line(kind, value, error, message):
    with pytest.raises(error, match=f"^{message}"):
        checked("x", value, kind)


def test_texts_have_units_and_slashes():
    assert read("x", "3200K", quantities.Temperature) == 3200
    assert read("x", "-40deg", quantities.Azimuth) == -40
    assert read("x", "1/2/3", quantities.GivenDirection) == (1, 2, 3)
    assert read("x", "left", quantities.Azimuth) == -90
    assert read("x", "Overhead", quantities.Elevation) == 90
    with pytest.raises(ValueError, match=r"or front, .* got '3m'"):
        read("x", "3m", quantities.Azimuth)


def test_a_linear_colour_above_one_in_a_text_is_warned_of():
    with pytest.warns(UserWarning, match="colour: 255/128/0 is linear and brighter than white.*#ff8000"):
        relight.DirectionalLight.parse("key:colour=255/128/0")


def test_near_names_are_suggested():
    assert meant("color", ["colour", "cone"]) == "colour"
    assert meant("az", ["azimuth", "angle"]) == "azimuth"
    assert meant("Golden Hour", ["golden-hour"]) == "golden-hour"
    assert meant("speed", ["colour", "cone"]) is None
    with pytest.raises(TypeError, match=r"color: not known; did you mean colour\? \(PointLight\)"):
        relight.PointLight((0, 0, 1), color=(1, 0, 0))


def test_a_function_checks_what_its_annotations_say():
    @checks_arguments
    def mixed(share: quantities.Amount, words: str = "a", *, rest: object = None) -> float:
        return share

    assert mixed(1) == 1.0
    with pytest.raises(ValueError, match="share: expected a number from 0 to 1, got 3"):
        mixed(share=3)
    with pytest.raises(TypeError, match="words: expected a text, got 3"):
        mixed(1, 3)
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'share'"):
        mixed()


def test_ranges_narrow_for_a_slider():
    kind = Annotated[quantities.Intensity, Interval(le=1000), About("Of a slider.")]
    assert limits(kind) == (0, 1000)
    assert described(kind) == "a number from 0 to 1000"


def test_the_ranges_in_docstrings_are_those_that_are_checked():
    text = " ".join((relight.DirectionalLight.__doc__ or "").split())
    assert f"Stops, in [{limits(quantities.Exposure)[0]}, {limits(quantities.Exposure)[1]}]" in text
    assert f"Angular diameter in degrees, in [{limits(quantities.Diameter)[0]}, 180]" in text
    assert all(f'"{word}"' in text for word in get_args(quantities.Locus.__origin__))


def test_lights_and_options_can_be_sent_to_other_processes():
    for sent in (
        relight.RectLight((0, 1, 1), (0, 0, 0), 1, 2),
        relight.Lighting("rim"),
        relight.Floor(height=1),
    ):
        assert pickle.loads(pickle.dumps(sent)) == sent


def test_help_needs_no_pydantic():
    program = (
        "import sys; sys.argv = ['relight', '--help']; from relight.cli.commands import app\ntry: app()\n"
    )
    program += "except SystemExit: print(*sys.modules, file=sys.stderr)"
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert not {"pydantic", "pydantic_core", "torch", "numpy"} & set(run.stderr.split())
