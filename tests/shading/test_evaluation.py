import dataclasses

import numpy as np
import pytest
import torch
from helpers.sphere import sphere

from shading import diffuse, evaluation
from shadow.data import photographs, records
from shadow.networks import checkpoints
from shadow.networks.field import VisibilityField


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two spheres with bounce light of a tenth from everywhere, and untrained weights."""
    path = tmp_path_factory.mktemp("records")
    (path / "views").mkdir()
    for number, radius in enumerate((0.7, 0.9)):
        ball = sphere(radius=radius)
        strength = np.zeros((len(ball.normals_int8), records.BOUNCE_RANK), np.float16)
        strength[:, 0] = 1
        patterns = np.zeros((records.BOUNCE_RANK, 96, 3), np.float32)
        patterns[0] = 0.1
        lit = dataclasses.replace(ball, bounce_float16=strength, bounce_patterns=patterns)
        records.write(path / "views" / f"{number}.npz", lit)
    for name, network, config in (
        ("field", VisibilityField, {}),
        ("shading", diffuse.ShadingField, {}),
        ("blind", diffuse.PerLightShading, {"latent": "resb3", "normals": False, "visibility": None}),
    ):
        config = {"size": 128, **config}
        kind = "shading-per-light" if name == "blind" else name
        checkpoints.save(path / f"{name}.safetensors", network(**config), kind, config, {})
    return path


def run(folder, **models):
    return evaluation.evaluate(
        [folder / "views"],
        models={"ours": folder / "shading.safetensors"} | models,
        out=folder / "figure.png",
        field_model=folder / "field.safetensors",
    )


@pytest.mark.slow
def test_untrained_shading_is_the_base_image_and_scores_as_it(folder):
    tallies, delights = run(folder, **{"w/o both": folder / "blind.safetensors"})
    base, ours, blind = (tallies[name] for name in ("base image", "ours", "w/o both"))
    assert len(base.rmse) == 2 * 64
    np.testing.assert_allclose(ours.rmse, base.rmse, atol=1e-6)
    np.testing.assert_allclose(ours.ssim, base.ssim, atol=1e-6)
    assert np.mean(blind.rmse) > np.mean(base.rmse) + 0.1  # black
    text = evaluation.report(tallies, delights)
    assert f"| ours | {np.mean(ours.rmse):.3f} (" in text
    assert "| w/o normals | not given | – |" in text
    assert (folder / "figure.png").stat().st_size > 1000


def test_truth_is_direct_and_bounce_light(folder):
    found = records.Records([folder / "views"])
    view = photographs.sample(found[0], np.random.default_rng(0), (128, 96), augment=False)
    truth = evaluation.true_shading({key: value[None] for key, value in view.items()})[0]
    inside = view["mask"][0] > 0.99
    assert truth.max() == 1  # where the sphere faces the light: what bounces there besides is cut
    np.testing.assert_allclose(truth[:, inside].min(), 0.1, atol=1e-3)


def test_networks_are_held_to_their_rows(folder):
    with pytest.raises(ValueError, match="the row 'w/o normals' was not trained"):
        run(folder, **{"w/o normals": folder / "blind.safetensors"})


def test_records_without_bounce_light_are_refused(folder, tmp_path):
    records.write(tmp_path / "a.npz", sphere())
    with pytest.raises(ValueError, match="relight stage --shading"):
        evaluation.evaluate([tmp_path], models={"ours": folder / "shading.safetensors"})


def test_a_shadow_that_stays_in_the_albedo_is_measured_in_stops():
    truth = torch.full((3, 10, 10), 0.8)
    lit, shadow = torch.zeros(10, 10, dtype=torch.bool), torch.zeros(10, 10, dtype=torch.bool)
    lit[:5], shadow[5:] = True, True
    delight = evaluation.Delight()
    half = 0.5 ** (1 / 2.2)  # one stop, encoded
    delight.add(3 * truth * torch.where(shadow, half, 1.0), truth, lit, shadow)
    assert delight.left[0] == pytest.approx(1, abs=1e-4)
    assert delight.lit[0] == pytest.approx(0, abs=1e-6)
    assert delight.shadow[0] == pytest.approx(0.8 * (1 - half), abs=1e-5)
