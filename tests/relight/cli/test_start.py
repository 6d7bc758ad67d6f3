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
for light in sys.argv[3:]:
    app(["apply", sys.argv[1], "-o", sys.argv[2], "--light", light], standalone_mode=False)
    print("loaded", *sys.modules)
"""
# What each light loads after those before it. The depth that a lamp needs is integrated from the normals.
LIGHTS = {
    "azimuth=-40,elevation=30": set(),
    "position=1/1/2": {"scipy.sparse"},
    "azimuth=-40,elevation=30,temperature=3200": {"colour"},
}


@pytest.fixture
def person(tmp_path):
    """A photograph of 64 x 48 pixels whose alpha is the matte."""
    pixels = np.zeros((64, 48, 4), np.float32)
    pixels[8:56, 12:36] = 0.3, 0.3, 0.3, 1
    relight.write(tmp_path / "person.png", pixels)
    return tmp_path / "person.png"


@pytest.mark.slow
def test_apply_loads_only_what_its_light_needs(person):
    command = [sys.executable, "-c", RUN, str(person), str(person.with_name("relit.png")), *LIGHTS]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=person.parent)
    assert run.returncode == 0, run.stderr
    said = [line.split() for line in run.stdout.splitlines() if line.startswith("loaded ")]
    before = set()
    for modules, loaded in zip(said, LIGHTS.values(), strict=True):
        found = SLOW_TO_LOAD & set(modules) - before
        before |= found
        assert found - (LOADED_BY_COLOUR if "colour" in loaded else set()) == loaded
