import json
import re

import numpy as np
import OpenImageIO as oiio
import pytest
from helpers.sphere import sphere

from shadow.data import records
from shadow.evaluation import report
from shadow.networks import checkpoints
from shadow.networks.field import VisibilityField
from shadow.networks.unet import LATENTS, PerLight

SMALL = {"size": 128, "widths": [8, 8, 16, 16, 32]}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A sphere, and untrained weights: a field, and per-light networks with normals and without."""
    path = tmp_path_factory.mktemp("records")
    records.write(path / "a.npz", sphere())
    config = {"size": 128}
    checkpoints.save(path / "field.safetensors", VisibilityField(**config), "field", config, {})
    for name, config, recipe in (
        ("resb3", {"latent": "resb3", **SMALL}, {"normals": "normals"}),
        ("colour", {"latent": "resb3", "normals": False, **SMALL}, {}),
        ("mixed", {"latent": "resb3", **SMALL}, {"normals": "true"}),
    ):
        checkpoints.save(path / f"{name}.safetensors", PerLight(**config), "resb3", config, recipe)
    return path


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    few = {"LEVELS": np.array([1e-4, 1, 100]), "REPEATS": 1, "LATENTS": {"resb3": LATENTS["resb3"]}}
    for name, value in few.items():
        monkeypatch.setattr(report, name, value)


def write(folder, out, models=(), **options):
    files = {name: folder / f"{file}.safetensors" for name, file in {"ours": "field", **dict(models)}.items()}
    return report.write([folder / "a.npz"], out, models=files, **options)


@pytest.mark.slow
def test_every_table_and_figure(folder, tmp_path):
    models = {"resb3": "resb3", "mixed": "mixed", "other": "field"}
    text = write(folder, tmp_path, models, limit=1).read_text()
    figures = json.loads((tmp_path / "report.json").read_text())
    assert (figures["views"], figures["maps"]) == (1, 64)

    baseline, true, ours, other = figures["table2"]
    assert true["measured"]["rmse"][0] < 0.12  # a sphere casts no shadow
    assert ours["measured"] == other["measured"]
    assert ours["measured"]["rmse"] == pytest.approx(baseline["measured"]["rmse"], abs=1e-3)  # untrained
    assert baseline["paper"] == {"rmse": [0.432, 0.056], "psnr": pytest.approx(7.29, abs=1e-2),
                                 "dice": [0.834, 0.049]}  # fmt: skip
    mean, deviation = ours["measured"]["dice"]
    assert f"| {mean:.3f} ({deviation:.3f}) | 0.313 (0.051) | 10.09 | 0.881 (0.041) |" in text

    without, mixed, _ = figures["table3"]
    assert mixed["measured"] is not None
    assert without["measured"] is None
    assert re.search(r"\| w/o normals \| – \| – \| not given \| – \| 0.334", text)

    resb3, ours = figures["table4"]
    assert resb3["measured"] is not None
    assert min(row["milliseconds"] for row in (resb3, ours)) > 0
    assert ours["millions"] == pytest.approx(13.7, abs=0.1)
    assert (resb3["paper_milliseconds"], resb3["paper_millions"]) == (11.9, 24.8)

    assert len(figures["figure2"]["lights"]) == len(figures["figure2"]["mean"]) == 64
    rmse = ours["measured"]["rmse"][0]
    assert np.mean(figures["figure2"]["mean"]) == pytest.approx(rmse)  # as many maps for each light
    assert [len(curve) for curve in figures["figure4"]["dice"].values()] == [3, 3]
    for picture in re.findall(r"\((figure-\d\.png)\)", text):
        assert oiio.ImageBuf(str(tmp_path / picture)).spec().width > 300
    assert "No soft maps were given" in text


@pytest.mark.parametrize(
    ("row", "file"),
    [("resb3", "field"), ("resb3", "colour"), ("mixed", "resb3"), ("without-normals", "mixed")],
)
def test_a_network_in_the_wrong_row_is_refused(folder, tmp_path, row, file):
    with pytest.raises(ValueError, match=f"{file}.safetensors is not a network for the row '{row}'"):
        write(folder, tmp_path, {row: file})
