import numpy as np
import pytest
from conftest import sphere

from shadow import evaluation, records, weights
from shadow.field import VisibilityField
from shadow.normals import NormalsNetwork


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two spheres, and untrained weights."""
    path = tmp_path_factory.mktemp("records")
    records.write(path / "a.npz", sphere(radius=0.7))
    records.write(path / "b.npz", sphere(radius=0.9))
    config = {"size": 128}
    weights.save(path / "field.safetensors", VisibilityField(**config), "field", config, {})
    weights.save(path / "normals.safetensors", NormalsNetwork(**config), "normals", config, {})
    return path


def test_scores_of_a_sphere_and_untrained_weights(folder):
    scores, angle = evaluation.evaluate(
        [folder / "a.npz", folder / "b.npz"],
        model=folder / "field.safetensors",
        normals_model=folder / "normals.safetensors",
    )
    true, estimated = scores["sign(N·L), true normals"], scores["sign(N·L), estimated normals"]
    assert true.rmse[0] < 0.12  # a sphere casts no shadow: only the edge pixels of the terminator differ
    assert true.dice[0] > 0.98
    assert scores["field"].rmse[0] == pytest.approx(estimated.rmse[0], abs=1e-3)  # an untrained field
    assert estimated.rmse[0] > 0.3
    assert estimated.psnr == pytest.approx(-20 * np.log10(estimated.rmse[0]), abs=1e-3)
    assert 35 < angle < 55  # a hemisphere against normals that all face the camera
    table = evaluation.report(scores, angle)
    assert f"| field | {scores['field'].rmse[0]:.3f} (" in table


def test_the_score_does_not_depend_on_chance(folder):
    arguments = {"model": folder / "field.safetensors", "normals_model": folder / "normals.safetensors"}
    first, again = (evaluation.evaluate([folder / "a.npz"], **arguments) for _ in range(2))
    assert first == again
