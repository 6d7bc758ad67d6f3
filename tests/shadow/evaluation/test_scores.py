import numpy as np
import OpenImageIO as oiio
import pytest
from helpers.sphere import sphere

from shadow import visibility
from shadow.data import records
from shadow.evaluation import scores
from shadow.networks import checkpoints
from shadow.networks.field import VisibilityField


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two spheres, and untrained weights."""
    path = tmp_path_factory.mktemp("records")
    records.write(path / "a.npz", sphere(radius=0.7))
    records.write(path / "b.npz", sphere(radius=0.9))
    config = {"size": 128}
    checkpoints.save(path / "field.safetensors", VisibilityField(**config), "field", config, {})
    return path


def test_scores_of_a_sphere_and_untrained_weights(folder):
    paths = [folder / "a.npz", folder / "b.npz"]
    found, angle = scores.evaluate(paths, model=folder / "field.safetensors")
    true, estimated = found["sign(N·L), true normals"], found["sign(N·L), estimated normals"]
    assert true.rmse[0] < 0.12  # a sphere casts no shadow: only the edge pixels of the terminator differ
    assert true.dice[0] > 0.98
    assert found["field"].rmse[0] == pytest.approx(estimated.rmse[0], abs=1e-3)  # an untrained field
    assert estimated.rmse[0] > 0.3
    assert estimated.psnr == pytest.approx(-20 * np.log10(estimated.rmse[0]), abs=1e-3)
    assert 35 < angle < 55  # a hemisphere against normals that all face the camera
    table = scores.report(found, angle)
    assert f"| field | {found['field'].rmse[0]:.3f} (" in table


def test_the_score_does_not_depend_on_chance(folder):
    first, again = (scores.evaluate([folder / "a.npz"], model=folder / "field.safetensors") for _ in range(2))
    assert first == again


def test_the_kind_of_light_is_what_the_photograph_is_taken_in(folder, monkeypatch):
    """Hard: nearly all of the light comes from one or two directions; under a sky it does not."""
    lit = {}
    view_of = scores.ScoredView.of

    def watched(record, seed, height, lighting=None):
        energy = np.sort(lighting.sum(axis=1))[::-1]
        lit.setdefault(kind, []).append(energy[:2].sum() / energy.sum())
        return view_of(record, seed, height, lighting)

    monkeypatch.setattr(scores.ScoredView, "of", watched)
    for kind in ("hard", "sky"):
        scores.evaluate([folder], model=folder / "field.safetensors", light=kind)
    assert min(lit["hard"]) > 0.6 > 0.4 > max(lit["sky"])
    with pytest.raises(ValueError, match="light: expected one of hard, sky, any, got 'dim'"):
        scores.evaluate([folder], model=folder / "field.safetensors", light="dim")


@pytest.fixture
def stage(folder):
    """One sphere's records, the field, and where all take their normals from."""
    field = visibility.load(folder / "field.safetensors")
    return records.Records([folder / "a.npz"]), field, scores.normals_of(field)


def test_each_light_has_its_own_mean(stage):
    found, field, surface = stage
    tallies, _ = scores.compare(found, {"field": field}, surface)
    lights, mean, deviation = tallies["field"].by_light()
    assert lights.shape == (64, 3)
    assert mean.mean() == pytest.approx(tallies["field"].score().rmse[0])
    assert abs(deviation).max() == 0  # one map each
    central = lights[:, 2] > 0.9
    assert mean[central].mean() < mean[lights[:, 2] < 0.3].mean()  # as in Figure 2


def test_normal_exposures_do_not_matter_but_black_does(stage):
    found, field, surface = stage
    black, normal, half = scores.intensity_sweep(found, field, surface, [1e-9, 1, 0.5])
    assert normal[0].score().dice == pytest.approx(half[0].score().dice, abs=0.02)
    assert black[1].score().dice == pytest.approx(normal[1].score().dice, abs=0.02)  # untrained normals
    assert len(black[0].dice) == 64


def soft_map(record, light):
    return record.image(record.visibility[:, light : light + 1].astype(np.float32))[0].numpy()


def test_otsu_recovers_soft_maps_of_a_perfect_method(stage, tmp_path):
    found, field, surface = stage
    np.save(tmp_path / "a_03.npy", 10 + 2 * soft_map(found[0], 3))
    encoded = np.repeat(soft_map(found[0], 40)[..., None] * 0.6 + 0.2, 3, axis=2)
    assert oiio.ImageBuf(encoded).write(str(tmp_path / "a_40.png"))
    tallies = scores.against_soft_maps(found, tmp_path, field, surface)
    theirs, ours = tallies["sphere"]
    assert theirs.rmse == [0, 0]
    assert theirs.dice == [1, 1]
    np.testing.assert_allclose(theirs.lights, found[0].directions[[3, 40]], atol=1e-6)
    assert min(ours.rmse) > 0.1


def test_a_constant_soft_map_is_lit_or_dark(stage, tmp_path):
    found, field, surface = stage
    np.save(tmp_path / "a_00.npy", np.full((96, 96), 0.3))
    np.save(tmp_path / "a_01.npy", np.zeros((96, 96)))
    theirs, _ = scores.against_soft_maps(found, tmp_path, field, surface)["sphere"]
    assert theirs.dice[0] > 0.98  # the light is at the camera
    assert theirs.dice[1] == 0


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("c_00.npy", np.zeros((96, 96)), "expected maps of these records"),
        ("a_00.npy", np.zeros((90, 96)), r"expected size \(96, 96\), got \(90, 96\)"),
        ("a_00.npy", np.zeros((96, 96, 3)), r"expected an array \(H, W\)"),
        ("a_00.npy", np.full((96, 96), np.nan), "contains NaN"),
        ("a_96.npy", np.zeros((96, 96)), "the record has 96 lights"),
    ],
)
def test_bad_soft_maps_are_named(stage, tmp_path, name, array, message):
    found, field, surface = stage
    np.save(tmp_path / name, array)
    with pytest.raises(ValueError, match=message):
        scores.against_soft_maps(found, tmp_path, field, surface)
