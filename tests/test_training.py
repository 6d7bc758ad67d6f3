import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import sphere

from shading.training import ALBEDO
from shadow import normals, records, training, visibility, weights
from shadow.field import VisibilityField
from shadow.normals import NormalsNetwork
from shadow.training import NORMALS, SHADOW, Recipe, fit, learning_rate, warm_start


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("records")
    for number in range(4):
        records.write(path / f"{number}.npz", sphere(radius=0.6 + 0.1 * number))
    return path


def run(task, folder, out, steps, **options):
    torch.manual_seed(0)
    recipe = Recipe(steps=steps, size=128, batch=2, learning_rate=3e-3, warm_up=2)
    return fit(task, recipe, [folder], out, workers=0, **options)


def test_learning_rate_warms_up_and_falls_to_zero():
    recipe = Recipe(steps=1000, warm_up=100, learning_rate=1)
    rates = np.array([learning_rate(recipe, step) for step in range(1001)])
    assert rates[0] == pytest.approx(0.01)
    assert rates.argmax() == pytest.approx(99, abs=2)
    assert rates[-1] == pytest.approx(0, abs=1e-9)


def test_normals_of_a_sphere_are_learned(folder, tmp_path):
    path = run(NORMALS, folder, tmp_path, 12, validation=[folder])
    rows = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert rows[-1]["images"] == 24
    untrained = 45  # degrees: a visible hemisphere against normals that all face the camera is 45 on average
    assert rows[-1]["angle"] < untrained
    assert (tmp_path / "samples-000012.png").stat().st_size > 0
    assert normals.load(path).size == 128


def test_an_interrupted_run_ends_where_an_uninterrupted_one_does(folder, tmp_path, monkeypatch):
    whole = run(NORMALS, folder, tmp_path / "whole", 4)
    recipe = Recipe(steps=4, size=128, batch=2, learning_rate=3e-3, warm_up=2)

    class Interrupt(Exception):
        pass

    calls = 0

    def interrupted(network, batch):
        nonlocal calls
        calls += 1
        if calls == 4:
            raise Interrupt
        return NORMALS.loss(network, batch)

    monkeypatch.setattr(training, "LOG_EVERY", 1)
    with pytest.raises(Interrupt):
        fit(replace(NORMALS, loss=interrupted), recipe, [folder], tmp_path / "cut", workers=0,
            checkpoint_minutes=0)  # fmt: skip
    resumed = fit(NORMALS, recipe, [folder], tmp_path / "cut", workers=0)
    for (key, a), b in zip(weights.read(whole)[0].items(), weights.read(resumed)[0].values(), strict=True):
        torch.testing.assert_close(a, b, msg=key)


def test_field_starts_from_the_normals_and_records_them(folder, tmp_path):
    estimator = run(NORMALS, folder, tmp_path / "normals", 2)
    path = run(SHADOW, folder, tmp_path / "field", 2, init=estimator, estimator=str(estimator))
    assert isinstance(visibility.load(path), VisibilityField)
    recipe = json.loads(weights.read(path)[1]["recipe"])
    assert recipe["normals"] == recipe["init"] == "normals"
    albedo = run(ALBEDO, folder, tmp_path / "albedo", 2, init=estimator, estimator=str(estimator))
    assert weights.read(albedo)[1]["network"] == "albedo"


def test_warm_start_keeps_the_features(tmp_path):
    torch.manual_seed(0)
    config = {"size": 128}
    source, target = NormalsNetwork(**config), VisibilityField(**config)
    weights.save(tmp_path / "n.safetensors", source, "normals", config, {})
    warm_start(target, tmp_path / "n.safetensors")
    image = torch.rand(1, 4, 32, 32)
    stem, wider = source.backbone.half().float().stem, target.backbone.stem
    unshuffled = torch.nn.functional.pixel_unshuffle(image, 2)
    with_normals = torch.nn.functional.pixel_unshuffle(torch.cat([image, torch.rand(1, 3, 32, 32)], dim=1), 2)
    torch.testing.assert_close(wider(with_normals), stem(unshuffled))
    assert target.backbone.head.weight.abs().max() == 0


def test_another_architecture_is_refused(tmp_path):
    small = NormalsNetwork(size=128, widths=(8, 8, 8, 8, 8))
    weights.save(tmp_path / "n.safetensors", small, "normals", {"size": 128}, {})
    with pytest.raises(ValueError, match="another architecture"):
        warm_start(VisibilityField(), tmp_path / "n.safetensors")


def test_a_loss_that_is_not_finite_stops_the_run(folder, tmp_path):
    broken = replace(NORMALS, loss=lambda network, batch: NORMALS.loss(network, batch) * float("nan"))
    with pytest.raises(ValueError, match=r"loss at step .* is not finite"):
        run(broken, folder, tmp_path, 2)
    assert not (tmp_path / "normals.safetensors").exists()
