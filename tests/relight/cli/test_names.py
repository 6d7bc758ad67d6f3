"""Names and kinds of files that nobody expects: brackets, pipes, and what a page tells of them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT
from typer.testing import CliRunner

import relight
from relight.cli.commands import app

LIGHT = ["--light", "azimuth=-40"]
FOLDER = "[red] jane doe["  # and with what follows, "[/b]", Rich would take it for markup
COMMANDS = {
    "apply": [*LIGHT, "-o", f"{FOLDER}/b].png"],
    "analyse": ["-o", f"{FOLDER}/b].relight"],
    "view": ["-o", f"{FOLDER}/b].html"],
    "export": ["--triangles", "1000", "-o", f"{FOLDER}/b].glb"],
    "olat": ["-o", f"{FOLDER}/b].exr"],
    "job": [*LIGHT, "-o", f"{FOLDER}/b].%d.png", "-o", f"{FOLDER}/b].json"],
}


@pytest.fixture
def folder(tmp_path, here):
    """A small person, in a folder with brackets in its name."""
    (tmp_path / FOLDER).mkdir()
    y, x = np.mgrid[:60, :50]
    alpha = (np.hypot((x - 25) / 12, (y - 30) / 26) < 1).astype(np.float32)[..., None]
    relight.write(
        f"{FOLDER}/p].1.exr", np.concatenate([alpha * (0.4, 0.3, 0.2), alpha], -1, dtype=np.float32)
    )
    return tmp_path / FOLDER


def run(*words):
    return CliRunner().invoke(app, [*map(str, words)])


@pytest.mark.parametrize(
    "command",
    [
        "apply",
        "job",
        "view",
        *(pytest.param(c, marks=pytest.mark.slow) for c in ("analyse", "export", "olat")),
    ],
)
def test_names_with_brackets_are_printed_and_written_as_they_are(folder, command):
    """What is written tells nothing of the folder, which may be that of somebody's home."""
    if command == "export":
        pytest.importorskip("trimesh")
    plate = folder / ("p].%d.exr" if command == "job" else "p].1.exr")
    result = run(command, plate, *COMMANDS[command])
    assert result.exit_code == 0, result.output
    written = Path(COMMANDS[command][-1])
    assert result.stdout.splitlines()[0] == str(written)
    if command != "job":  # which runs elsewhere, on these files
        files = [written] if written.is_file() else [*written.iterdir()]
        assert files
        assert not [path.name for path in files if b"jane doe" in path.read_bytes()]


@pytest.mark.parametrize("command", [*COMMANDS, "comfyui"])
def test_errors_name_what_has_brackets(folder, command):
    result = run(command, f"{FOLDER}/gone].exr", *COMMANDS.get(command, ()))
    assert result.exit_code == 2, result.output
    assert f"{FOLDER}/gone].exr" in result.output


def test_the_nodes_are_registered_below_a_name_with_brackets(folder):
    for name in ("custom_nodes", "models", "comfy"):
        (folder / name).mkdir()
    result = run("comfyui", folder)
    assert result.exit_code == 0, result.output
    assert f"{FOLDER}/custom_nodes/relight-nodes/__init__.py" in result.output.replace("\n", "")


@pytest.mark.parametrize(
    "output",
    ["take#2.png", pytest.param("50%done.png", marks=pytest.mark.slow), "a#.exr", "100%d.png", "a.%04d.png"],
)
def test_signs_in_the_name_of_a_still_are_no_frame_numbers_or_refused_by_name(folder, output):
    result = run("apply", f"{FOLDER}/p].1.exr", *LIGHT, "-o", output)
    assert result.exit_code == (0 if Path(output).exists() else 2)
    assert output in result.output


PIPES = """
import json, os, signal, sys
import relight, shadow.normals
from relight.media.movies import Movie
from relight.scene.lights import read_lights
signal.alarm(90)
said = {}
for name in sys.argv[1:]:
    os.mkfifo(name)
    suffix = name.rpartition(".")[2]
    read = {"mov": Movie, "mkv": Movie, "ts": Movie}.get(suffix, relight.read)
    if name.startswith("lights"):
        read = read_lights
    elif name.startswith("kept"):
        read = relight.Subject.load
    elif name.startswith("sky"):
        read = relight.EnvironmentLight
    elif name.startswith("matte"):
        read = relight.read_mask
    try:
        read(name)
    except (OSError, ValueError) as error:
        said[name] = str(error)
print(json.dumps(said))
"""
NAMES = [
    *(f"lights.{suffix}" for suffix in ("yaml", "json", "gltf", "glb", "usda", "usdc", "usdz")),
    *(f"movie.{suffix}" for suffix in ("mov", "mkv", "ts")),
    *(f"picture.{suffix}" for suffix in ("png", "exr", "tif", "avif", "dng", "jp2")),
    *("matte.png", "sky.hdr", "kept.safetensors"),
]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no pipes")
def test_a_pipe_is_refused_wherever_a_file_is_read(tmp_path):
    """It would be waited for without end: in a process of its own, which an alarm ends."""
    pytest.importorskip("pxr")
    done = subprocess.run(
        [sys.executable, "-c", PIPES, *NAMES], cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert [*said] == NAMES
    for name, words in said.items():
        assert name in words
        assert "\n" not in words
