"""Variants of scans: another build, the same person's topology, normals that fit the bent surface."""

import numpy as np
import pytest

pytest.importorskip("embreex")
pytest.importorskip("kornia")
trimesh = pytest.importorskip("trimesh")

from shadow.data import records
from shadow.lightstage import scans, stage, variants
from shadow.lightstage.figure import Figure, vertex_normals
from shadow.lightstage.people.cloth.fabric import BRIGHTEST, DARKEST

SEEDS = range(5)


@pytest.fixture(scope="module")
def column():
    """A finely meshed standing ellipsoid, darker on its left; its normals are those of the mesh."""
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=1)
    vertices = (mesh.vertices * [0.25, 0.9, 0.2] + [0, 0.9, 0]).astype(np.float32)
    faces = mesh.faces.astype(np.int32)

    def albedo(face, barycentric):
        left = vertices[faces[face]].mean(axis=1)[:, :1] > 0
        return np.where(left, np.float32(0.2), np.float32(0.4)) * np.ones((1, 3), np.float32)

    return Figure(vertices, faces, vertex_normals(vertices, faces).astype(np.float32), albedo, "column")


def varied(figure, seed):
    return variants.vary(figure, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", SEEDS)
def test_normals_are_those_of_the_bent_surface(column, seed):
    variant = varied(column, seed)
    truth = vertex_normals(variant.vertices, variant.faces)
    before = np.degrees(np.arccos(np.clip((column.normals * truth).sum(axis=1), -1, 1)))
    after = np.degrees(np.arccos(np.clip((variant.normals * truth).sum(axis=1), -1, 1)))
    assert before.mean() > 3  # bent for the eye to see
    assert after.mean() < 0.2
    assert after.max() < 3


@pytest.mark.parametrize("seed", SEEDS)
def test_space_does_not_fold_over(seed):
    points = np.random.default_rng(seed).uniform(-1, 2, (5000, 3))
    moved, jacobian = variants.wave_heights(points, np.random.default_rng(seed))
    assert np.linalg.det(jacobian).min() > 0
    nudge = 1e-5 * np.array([1, -2, 0.5])
    beside, _ = variants.wave_heights(points + nudge, np.random.default_rng(seed))
    np.testing.assert_allclose(beside - moved, jacobian @ nudge, atol=1e-8)


def test_a_variant_stands_where_figures_do_and_is_as_tall_as_a_person(column):
    for seed in SEEDS:
        vertices = varied(column, seed).vertices
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        np.testing.assert_allclose([low[1], low[0] + high[0], low[2] + high[2]], 0, atol=1e-5)
        assert 1.4 < high[1] < 2.3


def test_colours_are_dyed_and_keep_their_detail(column):
    face = np.arange(len(column.faces))
    middle = np.full((len(face), 3), 1 / 3, np.float32)
    colour, plain = varied(column, 1).albedo(face, middle), column.albedo(face, middle)
    assert colour.dtype == np.float32
    assert DARKEST <= colour.min() <= colour.max() <= BRIGHTEST
    assert abs(colour - plain).max() > 0.02
    height = column.vertices[column.faces].mean(axis=1)[:, 1]
    for band in (height < 0.7, height > 1.6):  # one tint each: below the waist, and the head
        light, dark = (colour[band & (plain[:, 0] == value)] for value in (np.float32(0.4), np.float32(0.2)))
        assert np.ptp(light, axis=0).max() < 1e-6
        assert (light.mean(axis=0) > 1.2 * dark.mean(axis=0)).all()


def test_a_number_and_a_mesh_make_one_variant(tmp_path):
    path = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=2, radius=0.9).export(path)
    first, again, second = (variants.variant(path, number) for number in (0, 0, 1))
    np.testing.assert_array_equal(first.vertices, again.vertices)
    assert abs(first.vertices - second.vertices).max() > 0.02
    assert abs(first.vertices - scans.load(path).vertices).max() > 0.02
    sources = [
        stage.FigureSource.scan(path),
        *(stage.FigureSource.variant(path, number) for number in (0, 1)),
    ]
    names = ["scan-ball", "scan-ball-variant-000", "scan-ball-variant-001"]
    assert [source.name for source in sources] == names
    settings = stage.Settings(views=1, size=32)
    assert stage.render_all(sources, tmp_path / "out", settings, processes=1)[::2] == (3, {})
    found = records.Records([tmp_path / "out"])
    assert [file.stem for file, _ in found.entries] == [f"{name}-00" for name in names]
    assert [f"scan-{record.about['figure']}" for record in found] == names
