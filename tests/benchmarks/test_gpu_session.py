"""The command for a quarter of an hour of a GPU, rehearsed on a CPU."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from helpers.sphere import sphere

pytest.importorskip("kornia")

from shadow.data import records

ROOT = Path(__file__).resolve().parents[2]
SESSION = ROOT / "benchmarks/gpu/session.py"
LIMIT = 16 * 2**20  # of a file that comes back


@pytest.fixture
def pool(tmp_path):
    folder = tmp_path / "pool"
    folder.mkdir()
    for number in range(3):
        records.write(folder / f"{number}.npz", sphere(radius=0.6 + 0.1 * number))
    return folder


@pytest.fixture
def begun(tmp_path):
    """The folder of a session that has measured and made its records."""
    work = tmp_path / "work"
    work.mkdir()
    found = {"batch": 2, "compiled": True, "stacked": True, "workers": 2, "steps_a_second": 1.0}
    (work / "probe.json").write_text(json.dumps(found))
    return work


def session(out, work, *options, limit):
    command = [sys.executable, SESSION, out, "--work", work, "--packs", work / "none", "--tiny"]
    command += ["--total", "1", "--limit", str(limit), *options]
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=900)


@pytest.mark.slow
def test_a_stopped_command_goes_on_and_its_state_comes_back(tmp_path, pool, begun):
    out = tmp_path / "out"
    options = "--records", pool, "--distil", 0.5
    first = session(out, begun, *options, limit=0)
    assert first.returncode == 1  # not finished; its worker goes on
    second = session(out, begun, *options, limit=600)
    assert second.returncode == 0, second.stdout
    assert (begun / "worker.log").read_text().count("learning_rate") == 1
    files = list(out.iterdir())
    assert len(files) <= 8
    assert max(file.stat().st_size for file in files) <= LIMIT
    report = [json.loads(line) for line in (out / "report.jsonl").read_text().splitlines()]
    assert {"plan", "learning_rate", "warm_up"} <= report[-2].keys()
    assert report[-1]["views_at_the_end"] == {"bodies": 0, "made": 0}
    subprocess.run([sys.executable, SESSION, out, tmp_path / "run", "--restore"], check=True)
    saved, restored = (
        torch.load(folder / "checkpoint.pt", weights_only=True)
        for folder in (begun / "run", tmp_path / "run")
    )
    assert restored["step"] == saved["step"] > 0
    for part in ("network", "average"):
        for key, value in saved[part].items():
            torch.testing.assert_close(restored[part][key], value, atol=2e-2, rtol=1e-2)
    moments, again = (state["optimiser"]["parts"][1]["state"][0] for state in (saved, restored))
    for key, value in moments.items():
        value, restored_value = torch.as_tensor(value), torch.as_tensor(again[key])
        assert (restored_value - value).abs().max() <= 0.01 * value.abs().max()


@pytest.mark.slow
def test_an_error_reaches_the_folder_that_comes_back(tmp_path, pool, begun):
    missing = tmp_path / "missing.safetensors"
    failed = session(tmp_path / "out", begun, "--records", pool, "--init", missing, limit=300)
    assert failed.returncode == 1
    assert "missing.safetensors" in (tmp_path / "out/worker.log").read_text()


@pytest.mark.slow
def test_the_whole_session(tmp_path):
    """It measures, renders a body, predicts the steps, trains and ends."""
    done = session(tmp_path / "out", tmp_path / "work", "--minutes", "0.02", limit=800)
    assert done.returncode == 0, done.stdout
    report = (tmp_path / "out/report.jsonl").read_text()
    for fact in (
        "analysis",
        "64 lights",
        "frames a second",
        '"views": {"bodies": 2',
        "steps_a_second",
        "plan",
    ):
        assert fact in report
    assert (tmp_path / "out/field.safetensors").exists()
