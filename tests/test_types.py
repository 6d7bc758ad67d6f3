"""A user's program is accepted by strict type checkers: public names, their arguments and results."""

import subprocess
import sys

import pytest
from helpers import ROOT

import relight
import shading
import shadow

SAMPLE = ROOT / "tests" / "data" / "typed_program.py"
# To follow all that is imported takes mypy most of its time. The types of public names never lead to these
# parts of torch, nor to these libraries.
PARTS = (
    "_dynamo", "_export", "_functorch", "_higher_order_ops", "_inductor", "ao", "distributed",
    "distributions", "export", "fx", "jit", "onnx", "optim", "package",
)  # fmt: skip
SKIPPED = (
    *(f"torch.{part}" for part in PARTS),
    *("colour", "dask", "distributed", "filelock", "IPython", "matplotlib", "onnx", "prompt_toolkit", "rich"),
)
SETTINGS = f"""
[mypy]
[mypy-{",".join(f"{name}.*" for name in SKIPPED)}]
follow_imports = skip
"""


@pytest.mark.slow
def test_a_typed_program_is_accepted_and_wrong_types_are_seen(tmp_path):
    """By mypy here, which begins without a cache; by pyright in `.ci/javascript`, a program of Node.

    That wrong types are seen shows that the first program does not pass whatever is exported.
    """
    right, wrong = tmp_path / "right.py", tmp_path / "wrong.py"
    right.write_text(SAMPLE.read_text())
    wrong.write_text("import relight\nrelight.DirectionalLight(azimuth='left')\nrelight.Lighting(light=3)\n")
    (tmp_path / "mypy.ini").write_text(SETTINGS)
    command = [sys.executable, "-m", "mypy", "--strict", right.name, wrong.name]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    errors = [line.split(": error")[0] for line in ran.stdout.splitlines() if ": error" in line]
    assert set(errors) <= {"wrong.py:2", "wrong.py:3"}, ran.stdout
    assert "wrong.py:3" in errors


def test_public_names_stand_literally_in_all():
    assert sorted(relight.__all__) == sorted(relight._EXPORTS)
    assert {"errors", "__version__", "Light"} <= set(dir(relight))
    assert issubclass(relight.DirectionalLight, relight.Light)
    for package in (relight, shading, shadow):
        assert all(hasattr(package, name) for name in package.__all__)
