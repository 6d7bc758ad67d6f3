"""Folds in the mesh: cloth is raised, skin, head and loose pieces stay, seams stay closed, shadows fall."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("embreex")
pytest.importorskip("numba")
trimesh = pytest.importorskip("trimesh")
pytest.importorskip("kornia")

from shadow import directions
from shadow.data import records
from shadow.lightstage import folds, stage
from shadow.lightstage.figure import Figure, vertex_normals

SKIN, BLUE = np.float32([0.5, 0.3, 0.2]), np.float32([0.1, 0.15, 0.4])


@pytest.fixture(scope="module")
def person():
    """A standing ellipsoid in blue, with a face and bare shins; a seam splits the vertices of one face in
    two. Beside it hangs a ball, in blue as well."""
    body = trimesh.creation.icosphere(subdivisions=5, radius=1)
    body.vertices = body.vertices * [0.25, 0.9, 0.2] + [0, 0.9, 0]
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    ball.apply_translation([0.6, 0.9, 0])
    mesh = trimesh.util.concatenate([body, ball])
    normals, faces = vertex_normals(mesh.vertices, mesh.faces), mesh.faces.copy()
    seam = np.abs(mesh.vertices[faces[:, 0]] - [0, 0.9, 0.2]).sum(axis=1).argmin()
    split = faces[seam].copy()
    faces[seam] = len(mesh.vertices) + np.arange(3)
    vertices, normals = (np.concatenate([each, each[split]]) for each in (mesh.vertices, normals))

    def albedo(face, barycentric):
        height = vertices[faces[face]].mean(axis=1)[:, 1:2]
        return np.where((height > 1.5) | (height < 0.4), SKIN, BLUE)

    return Figure(
        vertices.astype(np.float32), faces.astype(np.int32), normals.astype(np.float32), albedo, "x"
    )


@pytest.fixture(scope="module")
def folded(person):
    return folds.add_folds(person, np.random.default_rng(0))


def test_cloth_is_raised_and_nothing_else_moves(person, folded):
    moved = np.linalg.norm(folded.vertices[: len(person.vertices)] - person.vertices, axis=1)
    height = person.vertices[:, 1]
    cloth = (height > 0.6) & (height < 1.3) & (np.abs(person.vertices[:, 0]) < 0.4)
    assert moved[(height > 1.55) | (height < 0.35) | (person.vertices[:, 0] > 0.5)].max() < 1e-6
    assert moved[cloth].max() > 0.006
    assert moved.max() < 0.06
    assert (moved[cloth] > 0.001).mean() > 0.5


def test_seams_stay_closed(folded):
    """Where two vertices were one they are one: the mesh of merged vertices has no open border."""
    mesh = trimesh.Trimesh(folded.vertices.round(5), folded.faces)
    mesh.merge_vertices()
    assert mesh.is_watertight


def test_normals_are_those_of_the_folds_and_colours_stay(person, folded):
    assert len(folded.faces) == 4 * len(person.faces)
    mesh = trimesh.Trimesh(folded.vertices, folded.faces, process=False)
    truth = vertex_normals(mesh.vertices, mesh.faces)
    angle = np.degrees(np.arccos(np.clip((folded.normals * truth).sum(axis=1), -1, 1)))
    flat = folds.subdivide(person, np.zeros(len(person.vertices)))[0]
    before = np.degrees(np.arccos(np.clip((flat.normals * truth).sum(axis=1), -1, 1)))
    assert before.mean() > 3
    assert angle.mean() < 1
    face = np.arange(0, len(folded.faces), 7)
    middle = np.full((len(face), 3), 1 / 3)
    np.testing.assert_array_equal(folded.albedo(face, middle), person.albedo(face // 4, middle))


def test_textures_follow_their_faces(person):
    """What a texture is asked for is where the finer face lies in its parent."""
    asked = replace(
        person, albedo=lambda face, bary: np.einsum("nk,nkc->nc", bary, person.vertices[person.faces[face]])
    )
    fine = folds.subdivide(asked, np.zeros(len(person.vertices)))[0]
    rng = np.random.default_rng(0)
    face, barycentric = rng.integers(len(fine.faces), size=500), rng.dirichlet([1, 1, 1], 500)
    place = np.einsum("nk,nkc->nc", barycentric, fine.vertices[fine.faces[face]])
    np.testing.assert_allclose(fine.albedo(face, barycentric), place, atol=1e-5)


def test_folds_cast_shadows_and_are_seeded(person, folded, tmp_path):
    again = folds.add_folds(person, np.random.default_rng(0))
    np.testing.assert_array_equal(again.vertices, folded.vertices)
    assert np.abs(folds.add_folds(person, np.random.default_rng(1)).vertices - folded.vertices).max() > 0.003
    lights = directions.olat()
    dark = []
    for figure in (person, folded):
        record = stage.render(figure, stage.View(), 128, lights)
        facing = record.normals @ lights.T > 0.1
        dark.append((facing & (record.visibility == 0)).sum() / facing.sum())
    assert dark[1] > dark[0] + 0.01
    path = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=3, radius=0.9).export(path)
    source = stage.FigureSource.variant(path, 0, folded=True)
    settings = stage.Settings(views=1, size=32)
    assert stage.render_all([source], tmp_path / "out", settings, processes=1)[::2] == (1, {})
    assert records.Records([tmp_path / "out"])[0].about["figure"] == "ball-variant-000-folded"
