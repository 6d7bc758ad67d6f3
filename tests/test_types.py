"""A user's program is accepted by strict type checkers: public names, their arguments and results."""

import subprocess
import sys

from helpers import ROOT

import relight
import shading
import shadow

SAMPLE = ROOT / "tests" / "data" / "typed_program.py"


def test_a_typed_program_is_accepted(tmp_path):
    """By mypy here; by pyright in `.ci/javascript`, since it is a program of Node."""
    program = tmp_path / "program.py"
    program.write_text(SAMPLE.read_text())
    command = [sys.executable, "-m", "mypy", "--strict", str(program)]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout


def test_wrong_types_are_seen(tmp_path):
    """Or the check above would pass whatever is exported."""
    program = tmp_path / "program.py"
    program.write_text(
        "import relight\nrelight.DirectionalLight(azimuth='left')\nrelight.Lighting(light=3)\n"
    )
    command = [sys.executable, "-m", "mypy", "--strict", str(program)]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert "program.py:3: error" in ran.stdout


def test_public_names_stand_literally_in_all():
    assert sorted(relight.__all__) == sorted(relight._EXPORTS)
    assert {"errors", "__version__", "Light"} <= set(dir(relight))
    assert issubclass(relight.DirectionalLight, relight.Light)
    for package in (relight, shading, shadow):
        assert all(hasattr(package, name) for name in package.__all__)
