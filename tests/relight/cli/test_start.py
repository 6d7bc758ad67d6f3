"""What `relight apply` imports: libraries that are slow to load are loaded where they are used."""

import subprocess
import sys

import numpy as np
import pytest

import relight

SLOW_TO_LOAD = {"colour", "kornia", "matplotlib", "numba", "onnxruntime", "scipy.optimize", "scipy.sparse"}
LOADED_BY_COLOUR = {"matplotlib", "scipy.optimize", "scipy.sparse"}  # colour-science itself imports these
RUN = """
import sys
from relight.cli.commands import app
app(sys.argv[1:], standalone_mode=False)
print(*sys.modules)
"""


@pytest.fixture
def person(tmp_path):
    """A photograph of 64 x 48 pixels whose alpha is the matte."""
    pixels = np.zeros((64, 48, 4), np.float32)
    pixels[8:56, 12:36] = 0.3, 0.3, 0.3, 1
    relight.write(tmp_path / "person.png", pixels)
    return tmp_path / "person.png"


@pytest.mark.parametrize(
    ("light", "loaded"),
    [
        ("azimuth=-40,elevation=30", set()),
        pytest.param("azimuth=-40,elevation=30,temperature=3200", {"colour"}, marks=pytest.mark.slow),
        # The depth is integrated from the normals.
        pytest.param("position=1/1/2", {"scipy.sparse"}, marks=pytest.mark.slow),
    ],
)
def test_apply_loads_only_what_its_light_needs(person, light, loaded):
    command = ["apply", str(person), "-o", str(person.with_name("relit.png")), "--light", light]
    run = subprocess.run(
        [sys.executable, "-c", RUN, *command], capture_output=True, text=True, check=False, cwd=person.parent
    )
    assert run.returncode == 0, run.stderr
    found = SLOW_TO_LOAD & set(run.stdout.splitlines()[-1].split())
    assert found - (LOADED_BY_COLOUR if "colour" in loaded else set()) == loaded
