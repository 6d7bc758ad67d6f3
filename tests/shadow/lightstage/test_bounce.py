import numpy as np
import pytest

pytest.importorskip("embreex")
pytest.importorskip("kornia")
trimesh = pytest.importorskip("trimesh")

from helpers.pathtracer import path_trace

from shadow import directions
from shadow.lightstage import bounce, stage
from shadow.lightstage.figure import Figure
from shadow.lightstage.scene import Scene

ALBEDO = np.float32([0.8, 0.5, 0.2])
FRONT = np.float32([[0, 0, 1]])


def figure(*parts):
    """Meshes of one plain colour each."""
    owner = np.repeat(range(len(parts)), [len(mesh.faces) for mesh, _ in parts])
    colours = np.float32([colour for _, colour in parts])
    mesh = trimesh.util.concatenate([mesh for mesh, _ in parts])
    normals = mesh.vertex_normals.astype(np.float32)
    albedo = lambda face, barycentric: colours[owner[face]]  # noqa: E731
    return Figure(mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32), normals, albedo, "test")


def plate(centre, facing, colour, extent=0.6):
    grid = trimesh.creation.box([extent, extent, 0.002]).subdivide_loop(0)
    grid.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], facing))
    grid.apply_translation(centre)
    flat = trimesh.Trimesh(
        grid.triangles.reshape(-1, 3), np.arange(3 * len(grid.faces)).reshape(-1, 3), process=False
    )
    return flat, colour


@pytest.fixture(scope="module")
def bowl():
    """Half a sphere, open toward the camera."""
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
    mesh.update_faces(mesh.triangles_center[:, 2] < 0)
    mesh.remove_unreferenced_vertices()
    mesh.apply_translation([0, 0.9, 0])
    return figure((mesh, ALBEDO))


@pytest.fixture(scope="module")
def corner():
    """A white floor before a red wall."""
    return figure(
        plate([0, 0.6, 0.3], [0, 1, 0], [0.8, 0.8, 0.8]), plate([0, 0.9, 0], [0, 0, 1], [0.8, 0.05, 0.05])
    )


def seen(figure, size, view=stage.View()):  # noqa: B008 (a frozen dataclass)
    scene = Scene(figure, view.rotation(), view.position())
    mask, surface = scene.trace(*stage.camera_rays(view, size))
    return scene, mask.reshape(size, size), surface


def test_bounce_light_in_a_bowl_is_what_the_integral_says(bowl):
    # On a sphere every patch sees every other equally, so a bounce is the mean of albedo times irradiance
    # over the whole sphere: first a cross-section's light on its area, πR² / 4πR²; then half of it each time.
    scene, _, surface = seen(bowl, 48)
    shading = bounce.indirect_shading(scene, surface, FRONT, np.random.default_rng(0))[:, 0]
    expected = ALBEDO / 4 * sum((ALBEDO / 2) ** k for k in range(4))
    np.testing.assert_allclose(shading.mean(axis=0), expected, rtol=0.03)


def test_a_convex_figure_throws_no_light_on_itself():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    ball.apply_translation([0, 0.9, 0])
    scene, _, surface = seen(figure((ball, ALBEDO)), 32)
    assert bounce.indirect_shading(scene, surface, FRONT, np.random.default_rng(0)).max() < 0.01


def test_colour_bleeds_from_the_wall_to_the_floor(corner):
    scene, _, surface = seen(corner, 64, stage.View(height=1.2, pitch=-20))
    shading = bounce.indirect_shading(scene, surface, FRONT, np.random.default_rng(0))[:, 0]
    floor = surface.normal[:, 1] > 0.9  # near enough: the camera looks down a little
    assert shading[floor, 0].mean() > 0.05
    assert shading[floor, 1].mean() < 0.2 * shading[floor, 0].mean()


@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 20), (-50, 40)])
def test_direct_and_bounce_light_are_those_of_mitsuba(corner, azimuth, elevation):
    view, size = stage.View(distance=1.2, height=1.2, pitch=-20), 40
    light = directions.from_spherical([azimuth], [elevation])
    scene, mask, surface = seen(corner, size, view)
    direct = (surface.normal @ light.T).clip(0) * scene.visibility(surface, light)
    indirect = bounce.indirect_shading(scene, surface, light, np.random.default_rng(0))[:, 0]
    reference = path_trace(corner, view, size, light[0], samples=64, bounces=0)[mask]
    same = (np.abs(reference - direct) < 0.01).all(axis=1)
    assert same.mean() > 0.9  # the rest are pixels with an edge in them: Mitsuba has 64 samples of it, we one
    path = path_trace(corner, view, size, light[0], samples=256, bounces=4)[mask]
    np.testing.assert_allclose(indirect[same].mean(axis=0), (path - direct)[same].mean(axis=0), rtol=0.05)
    assert np.corrcoef(indirect[same, 0], (path - direct)[same, 0])[0, 1] > 0.9


def test_factors_keep_what_has_low_rank():
    rng = np.random.default_rng(0)
    shading = (rng.random((50, 5)) @ rng.random((5, 12))).reshape(50, 4, 3)
    strength, patterns = bounce.factorise(shading)
    np.testing.assert_allclose(np.einsum("nk,kdc->ndc", strength, patterns), shading, atol=1e-9)


def test_spreading_keeps_constants_and_edges(corner):
    _, mask, surface = seen(corner, 64, stage.View(height=1.2, pitch=-20))
    quarter = np.zeros_like(mask)
    quarter[::2, ::2] = True
    sparse = surface.take(quarter[mask])
    wall = (surface.normal[:, 2] > 0.9).astype(float)
    values = np.stack([np.ones(len(sparse)), (sparse.normal[:, 2] > 0.9)], axis=1)
    full = bounce.upsample(values, sparse, surface, mask)
    np.testing.assert_allclose(full[:, 0], 1, atol=1e-9)
    np.testing.assert_allclose(full[:, 1], wall, atol=0.01)
