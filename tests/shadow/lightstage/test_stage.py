import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

pytest.importorskip("embreex")
pytest.importorskip("numba")
trimesh = pytest.importorskip("trimesh")
pytest.importorskip("kornia")

from shadow import directions
from shadow.data import photographs, records
from shadow.evaluation import scores
from shadow.lightstage import scans, stage
from shadow.lightstage.figure import Figure
from shadow.lightstage.people.generate import bodies
from shadow.training.loop import fit
from shadow.training.recipes import Recipe
from shadow.training.tasks import SHADOW

LIGHTS = directions.olat(behind=True)


def figure(mesh, name="test"):
    grey = lambda face, barycentric: np.full((len(face), 3), 0.5, np.float32)  # noqa: E731
    normals = mesh.vertex_normals.astype(np.float32)
    return Figure(mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32), normals, grey, name)


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
    mesh.apply_translation([0, 0.9, 0])
    return figure(mesh)


def test_two_scans_of_one_name_are_refused(tmp_path):
    sources = [stage.FigureSource.scan(tmp_path / name / "mesh.obj") for name in ("alice", "bob")]
    with pytest.raises(ValueError, match="two are named 'scan-mesh'"):
        stage.render_all(sources, tmp_path / "records", stage.Settings(views=1))
    assert not (tmp_path / "records").exists()


def test_default_camera_is_that_of_section_3(ball):
    record = stage.render(ball, stage.View(), 128, LIGHTS)
    rows, columns = np.nonzero(record.mask)
    assert (rows.min() + rows.max()) / 2 == pytest.approx(63.5, abs=0.5)
    # The outline of a sphere of radius r at distance d is at tan(asin(r / d)).
    expected = np.tan(np.arcsin(0.5 / 1.75)) / np.tan(np.radians(35)) * 64
    assert (columns.max() - columns.min() + 1) / 2 == pytest.approx(expected, abs=1)


def test_normals_are_in_the_camera_frame(ball):
    for view in stage.views(4):
        record = stage.render(ball, view, 96, LIGHTS)
        image = record.image(record.normals)
        rows, columns = np.nonzero(record.mask)
        middle = int(rows.mean())
        assert image[0, middle, columns.max() - 1] > 0.7
        assert image[0, middle, columns.min() + 1] < -0.7
        assert image[1, rows.min() + 1, int(columns.mean())] > 0.7
        assert image[2, middle, int(columns.mean())] > 0.98


def test_depth_and_camera_give_the_positions_back(ball):
    view = stage.View(azimuth=30, height=1.2, pitch=-12, fov=60)
    record = stage.render(ball, view, 128, LIGHTS[:1])
    camera, (row, column) = record.about["camera"], np.nonzero(record.mask)
    rays = (
        np.stack([column - 63.5, 63.5 - row, np.full(len(row), -camera["focal"])], axis=1) / camera["focal"]
    )
    positions = rays * (camera["mean_depth"] + record.depth)  # in heights
    centre = view.rotation() @ ([0, 0.9, 0] - view.position())
    truth = centre + 0.5 * record.normals  # metres
    height = (np.ptp(row) + 1) / camera["focal"] * -truth[:, 2].mean()
    assert record.depth.mean() == pytest.approx(0, abs=1e-3)
    np.testing.assert_allclose(positions * height, truth, atol=0.01)


def test_azimuth_goes_toward_the_left_hand_of_the_figure():
    box = trimesh.creation.box([0.4, 1.8, 0.4])
    marker = trimesh.creation.box([0.3, 0.3, 0.3])
    marker.apply_translation([0.5, 0, 0])  # the figure faces +z, so its left hand is at +x
    both = trimesh.util.concatenate([box, marker])
    both.apply_translation([0, 0.9, 0])
    front, left = (
        stage.render(figure(both), stage.View(azimuth=a), 96, LIGHTS).mask.any(axis=0) for a in (0, 90)
    )
    assert front[60:].sum() > front[:36].sum()
    assert abs(left[48:].sum() - left[:48].sum()) <= 1


def test_a_sphere_shadows_itself_only_where_it_turns_away(ball):
    record = stage.render(ball, stage.View(), 128, LIGHTS)
    cosine = record.normals @ LIGHTS.T
    clear = abs(cosine) > 0.05
    np.testing.assert_array_equal(record.visibility[clear], (cosine > 0)[clear])


def test_an_occluder_casts_a_shadow_on_the_side_away_from_the_light():
    wall = trimesh.creation.box([1.2, 1.2, 0.02])
    bar = trimesh.creation.box([0.05, 1.2, 0.05])
    bar.apply_translation([0, 0, 0.3])
    both = trimesh.util.concatenate([wall, bar])
    both.apply_translation([0, 0.9, 0])
    light = directions.from_spherical([-45], [0])  # from image left
    record = stage.render(figure(both), stage.View(), 256, light)
    lit = record.image(record.visibility)[0].numpy()
    row = lit[128]
    shadow = np.flatnonzero((row == 0) & record.mask[128])
    wall_right = np.flatnonzero(record.mask[128]).max()
    assert len(shadow) > 3
    assert shadow.min() > 128  # right of the bar
    assert shadow.max() < wall_right - 5  # and not everywhere


def test_smooth_normals_leak_no_light():
    """A coarse sphere with smooth normals: no pixel is lit whose facet faces away."""
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
    mesh.apply_translation([0, 0.9, 0])
    smooth, flat = figure(mesh), mesh.copy()
    flat.unmerge_vertices()
    smooth_record = stage.render(smooth, stage.View(), 96, LIGHTS)
    flat_record = stage.render(figure(flat), stage.View(), 96, LIGHTS)
    geometric = flat_record.normals @ LIGHTS.T
    assert smooth_record.visibility[geometric < -0.02].max() == 0


def test_a_camera_that_sees_nothing_is_an_error(ball):
    with pytest.raises(ValueError, match="sees nothing"):
        stage.render(ball, stage.View(height=50), 32, LIGHTS)


def test_jittered_views_show_the_whole_figure(ball):
    rng = np.random.default_rng(0)
    for view in stage.views(6, ball, rng):
        mask = stage.render(ball, view, 64, LIGHTS[:1]).mask
        assert mask.sum() == mask[1:-1, 1:-1].sum()


def test_portraits_show_the_top_and_are_cut_below():
    """Also of who leans out of the axis: a leaning column's head is on the picture, its foot is not."""
    mesh = trimesh.creation.box([0.3, 1.8, 0.3])
    mesh.apply_translation([0, 0.9, 0])
    mesh.vertices[:, 0] += 0.5 * mesh.vertices[:, 1]
    column = figure(mesh.subdivide_loop(3))
    for view in stage.views(6, column, np.random.default_rng(0), portrait=True):
        mask = stage.render(column, view, 64, LIGHTS[:1]).mask
        assert not mask[0].any()
        assert mask[-1].any()
        assert abs(np.nonzero(mask)[1].mean() - 31.5) < 8


def test_portraits_are_rather_of_faces(ball):
    """Of whole figures as many views are from the front as from behind."""
    shares = []
    for portrait in (False, True):
        found = [stage.views(3, ball, np.random.default_rng(seed), portrait) for seed in range(200)]
        azimuths = np.radians([view.azimuth for each in found for view in each])
        shares.append((np.cos(azimuths) > 0).mean())
        assert abs(np.sin(azimuths).mean()) < 0.06  # neither side is preferred
    np.testing.assert_allclose(shares, (0.5, 0.63), atol=0.04)


@pytest.fixture(scope="module")
def mesh_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("meshes") / "capsule.ply"
    mesh = trimesh.creation.capsule(height=1.2, radius=0.25)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    mesh.export(path)
    return path


def test_rendering_resumes_and_is_deterministic(mesh_file, tmp_path):
    settings = stage.Settings(views=2, size=64, behind=True, jitter=True)
    sources = [stage.FigureSource.scan(mesh_file)]
    written, size, errors = stage.render_all(sources, tmp_path / "a", settings, processes=1)
    assert (written, errors) == (2, {})
    assert size == sum(path.stat().st_size for path in (tmp_path / "a").iterdir())
    assert stage.render_all(sources, tmp_path / "a", settings, processes=1)[0] == 0
    stage.render_all(sources, tmp_path / "b", settings, processes=2)
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()
    (tmp_path / "a" / "scan-capsule-01.npz").unlink()
    assert stage.render_all(sources, tmp_path / "a", settings, processes=1)[0] == 1
    assert len(records.Records([tmp_path / "a"])) == 2


@pytest.mark.slow
def test_directions_drawn_for_each_view_are_trained_on_and_scored(mesh_file, tmp_path):
    """Views with directions of their own, beside one with the fixed ones, make one mini-batch."""
    sources = [stage.FigureSource.scan(mesh_file)]
    drawn, fixed = (
        stage.Settings(views, 64, behind=True, lights=lights) for views, lights in ((2, 42), (1, None))
    )
    for folder in ("a", "b"):
        stage.render_all(sources, tmp_path / folder, drawn, processes=1)
    stage.render_all(sources, tmp_path / "fixed", fixed, processes=1)
    paths = sorted((tmp_path / "a").iterdir())
    assert [path.read_bytes() for path in paths] == [
        path.read_bytes() for path in sorted((tmp_path / "b").iterdir())
    ]
    first, second = records.Records([tmp_path / "a"])
    assert first.visibility.shape[1] == len(first.directions) == 42
    assert (first.directions[:, 2] < 0).sum() == 14
    assert abs(first.directions - second.directions).max() > 0.1
    facing = first.normals @ first.directions.T
    assert not first.visibility[facing < -0.05].any()
    assert first.visibility[facing > 0.05].mean() > 0.95  # a capsule hides nothing from itself
    mixed = [tmp_path / "a", tmp_path / "fixed"]
    recipe = Recipe(steps=1, size=128, batch=3)
    path = fit(SHADOW, recipe, mixed, tmp_path / "run", workers=0, validation=mixed)
    found, _ = scores.evaluate(mixed, model=path)
    assert all(np.isfinite(score.rmse).all() for score in found.values())


@pytest.mark.slow
def test_views_of_a_body_may_differ_in_its_fabrics():
    """The same cloth hangs the same way in another colour; skin and hair stay as they are."""
    figure = bodies.body(3, "training")
    view = stage.View(distance=3)
    first = stage.render(figure, view, 96, LIGHTS[:8])
    others = [figure.redraw_fabrics(np.random.default_rng(seed)) for seed in (0, 1)]
    second, third = (stage.render(replace(figure, albedo=paint), view, 96, LIGHTS[:8]) for paint in others)
    np.testing.assert_array_equal(second.normals_int8, first.normals_int8)
    np.testing.assert_array_equal(second.visibility_bits, first.visibility_bits)
    changed = abs(second.albedo - first.albedo).max(axis=1) > 0.02
    assert 0.3 < changed.mean() < 1
    assert not changed[first.regions > 0].any()
    assert abs(third.albedo - second.albedo).max(axis=1)[changed].mean() > 0.02


@pytest.mark.slow
def test_the_option_of_fabrics_changes_the_albedo_and_not_the_normals(tmp_path):
    sources = [stage.FigureSource.body(3, "training")]
    for name in ("a", "b"):
        settings = stage.Settings(views=2, size=64, fabrics=name == "b")
        stage.render_all(sources, tmp_path / name, settings, processes=1)
    plain, other = (records.Records([tmp_path / name])[0] for name in ("a", "b"))
    np.testing.assert_array_equal(plain.normals_int8, other.normals_int8)
    assert abs(plain.albedo - other.albedo).mean() > 0.02


def test_folds_are_raised_if_asked_also_after_torch_has_started_threads(mesh_file, tmp_path):
    torch.rand(2000, 2000).exp().sum()  # many threads, which no forked process inherits
    for raised in (False, True):
        sources = [stage.FigureSource.scan(mesh_file)]
        settings = stage.Settings(raised=raised, views=1, size=64)
        stage.render_all(sources, tmp_path / str(raised), settings, processes=1)
    plain, relief = (records.Records([tmp_path / name])[0] for name in ("False", "True"))
    assert "relief" not in plain.about
    assert relief.about["relief"] == 1
    np.testing.assert_array_equal(relief.mask, plain.mask)


def test_a_broken_mesh_is_reported_and_the_rest_rendered(mesh_file, tmp_path):
    broken = tmp_path / "broken.glb"
    broken.write_bytes(b"not a mesh")
    sources = [stage.FigureSource.scan(path) for path in (broken, mesh_file)]
    settings = stage.Settings(views=1, size=32)
    written, _, errors = stage.render_all(sources, tmp_path / "out", settings, processes=1)
    assert written == 1
    assert list(errors) == ["scan-broken"]
    assert scans.load(mesh_file).vertices[:, 1].min() == pytest.approx(0, abs=1e-5)


def test_bounce_light_is_recorded_on_request():
    wall = trimesh.creation.box([0.6, 0.6, 0.02])
    floor = trimesh.creation.box([0.6, 0.02, 0.6])
    floor.apply_translation([0, -0.3, 0.3])
    both = trimesh.util.concatenate([wall, floor])
    both.apply_translation([0, 0.9, 0])
    record = stage.render(figure(both), stage.View(height=1.1, pitch=-20), 64, LIGHTS, bounced=True)
    assert record.bounce_float16.shape == (record.mask.sum(), records.BOUNCE_RANK)
    light = np.zeros((len(LIGHTS), 3), np.float32)
    light[0] = 1
    direct = stage.render(figure(both), stage.View(height=1.1, pitch=-20), 64, LIGHTS)
    more = photographs.light(record, light) - photographs.light(direct, light)
    assert more.min() >= 0
    assert more.mean() > 0.005


def test_other_machines_render_the_same_and_resume(mesh_file, tmp_path):
    """Records are named by what they show, so a run that stopped here goes on by the workers of a cluster."""
    distributed = pytest.importorskip("distributed")
    from relight.cli.commands import app

    words = ["--scan", str(mesh_file), "--views", "3", "--size", "48"]
    here, there = tmp_path / "here", tmp_path / "there"
    assert CliRunner().invoke(app, ["stage", str(here), *words, "--processes", "1"]).exit_code == 0
    there.mkdir()
    first = sorted(here.iterdir())[0]
    shutil.copy2(first, there)
    kept = (there / first.name).stat().st_ino
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp://", dashboard_address=None
    ) as cluster:
        dask = ["--dask", cluster.scheduler_address]
        for written in (2, 0):
            result = CliRunner().invoke(app, ["stage", str(there), *words, *dask])
            assert result.exit_code == 0, result.output
            assert f"{written} records" in result.output
    assert (there / first.name).stat().st_ino == kept
    assert {path.name: path.read_bytes() for path in here.iterdir()} == {
        path.name: path.read_bytes() for path in there.iterdir()
    }
