"""A shot that is killed in each phase, and run again, ends bit by bit as if nobody had killed it."""

import json

import numpy as np
import pytest
from helpers import forked
from helpers.finders import discs
from helpers.killing import differences

import relight

FRAMES = 5
# Follows a person, analyses the shot, relights it from plates and from the analysis; prints each step.
PROGRAM = """
import sys, tempfile
from pathlib import Path
import relight
from helpers.finders import small_finder
from helpers.damage import small_canvas
from relight.matting import cutout_network
from relight.matting.people import finder

def report(done, total, step):
    print(step, done, flush=True)

folder, plates = map(Path, sys.argv[1:])
key = relight.DirectionalLight(azimuth=-40, name="key")
with tempfile.TemporaryDirectory() as networks, small_canvas():
    small = small_finder(Path(networks))
    finder.load = lambda: small
    cutout_network.load = lambda: lambda crop, mask: mask  # of a disc, the finder's mask is the matte
    relight.write_track(plates, folder / "t.json", progress=report)
    source = relight.Source(plates, track=folder / "t.json")
    relight.analyse_shot(source, folder / "s.relight", progress=report)
    output = relight.Output([folder / "r.mp4", folder / "r.%d.png"], report=folder / "r.json")
    relight.render_shot(source, key, output, resume=True, progress=report)
    relight.render_shot(folder / "s.relight", key, folder / "c.%d.exr", resume=True, progress=report)
"""
PHASES = (  # the last one is killed before its report is written
    *("Following the person 3", "Analysing 1", "Analysing 4", "Relighting 2", "Encoding r.mp4 2"),
    "Encoding r.mp4 5",
)


def finish(folder, plates):
    with forked.started(PROGRAM, folder, plates) as (process, printed):
        printed.read()
    assert process.exitcode == 0


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    """Plates of a disc that walks, and the folder of a run that nobody interrupted."""
    pytest.importorskip("openvino")
    top = tmp_path_factory.mktemp("shot")
    for number in range(1, FRAMES + 1):
        picture, _ = discs((160, 160), (50 + 4 * number, 70, 16))
        noisy = picture + np.random.default_rng(number).normal(0, 0.01, picture.shape)
        relight.write(top / f"p.{number}.png", np.round(noisy.clip(0, 1) * 255).astype(np.uint8))
    whole = top / "whole"
    whole.mkdir()
    finish(whole, top / "p.%d.png")
    return top / "p.%d.png", whole


@pytest.mark.slow
def test_killed_in_every_phase_in_turn_and_run_again(shot, tmp_path):
    """Each run goes on from what the run before left, whatever phase that was killed in."""
    plates, whole = shot
    for phase in PHASES:
        with forked.started(PROGRAM, tmp_path, plates) as (process, printed):
            assert any(line.strip() == phase for line in printed), phase
            process.kill()
    finish(tmp_path, plates)
    for pattern in ("*.mp4", "*.png", "*.exr"):
        assert len(list(tmp_path.glob(pattern))) == len(list(whole.glob(pattern))) > 0
    for name in ("t.json", "r.json"):  # they name the folder
        assert json.loads((tmp_path / name).read_text()) == json.loads((whole / name).read_text())
        for folder in (tmp_path, whole):
            (folder / name).unlink()
    assert [each for each in differences(tmp_path, whole) if ".safetensors" not in each] == []
