import numpy as np
import pytest
import torch
from scipy.ndimage import map_coordinates

from relight.analysis.camera import Camera, canvas_grid
from relight.scene.mesh import CUTOFF, JUMP, PersonSurface, build
from shadow.framing import Framing

PLATE = (200, 160)


@pytest.fixture(scope="module")
def surface():
    """A chest 1.2 m high, 2.5 m away, and a bar across it, 0.15 m nearer the camera."""
    matte = np.zeros(PLATE, np.float32)
    matte[20:180, 40:120] = 1
    framing = Framing.around(torch.from_numpy(matte), 128)
    camera = Camera.of(torch.from_numpy(matte), 1.2, 30.0)
    x, y = (values.numpy() for values in canvas_grid(framing))
    bar = (abs(y - 100) < 12) & (x > 60) & (x < 100)
    depth = np.where(bar, -0.15, 0.0) + 0.02 * np.sin(x / 9)
    normals = np.broadcast_to(np.array([0, 0, 1.0]), (*depth.shape, 3))
    return PersonSurface(depth, normals, np.ones(depth.shape, bool), framing, camera, matte)


@pytest.fixture(scope="module")
def mesh(surface):
    return build(surface)


def front(mesh):
    """The triangles of the front sheet."""
    return mesh.faces[(mesh.faces < len(mesh.points) // 2).all(axis=1)]


def test_the_mesh_is_closed_and_turned_outward(mesh):
    trimesh = pytest.importorskip("trimesh")
    solid = trimesh.Trimesh(mesh.points, mesh.faces, process=False)
    assert solid.is_winding_consistent
    assert solid.is_watertight
    assert solid.volume > 0
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)


def test_no_sheet_stretches_over_a_jump_of_depth(mesh):
    depth = mesh.points[front(mesh), 2]
    assert np.ptp(depth, axis=1).max() < JUMP
    assert np.ptp(depth) > 0.15  # both are there


def test_the_camera_sees_no_gap(mesh, surface):
    """Rays through all pixels of the person hit the front."""
    pytest.importorskip("embreex")  # with which Trimesh casts rays
    trimesh = pytest.importorskip("trimesh")
    camera = surface.camera
    rows, columns = np.nonzero(surface.matte > 0.5)
    rays = camera.rays(torch.from_numpy(columns + 0.5), torch.from_numpy(rows + 0.5)).numpy().T
    eye = camera.positions(torch.tensor(camera.middle[0]), torch.tensor(camera.middle[1]),
                           torch.tensor(-camera.distance)).numpy()  # fmt: skip
    solid = trimesh.Trimesh(mesh.points, front(mesh), process=False)
    hits = solid.ray.intersects_any(np.tile(eye, (len(rays), 1)), rays)
    assert hits.all()


def test_texture_coordinates_lie_where_the_camera_sees_the_points(mesh, surface):
    top, left, bottom, right = mesh.box
    for point, (u, v) in zip(mesh.points[::97], mesh.uv[::97], strict=True):
        x, y = surface.camera.on_plate(point.astype(float))
        assert abs(left + u * (right - left) - x) < 0.01
        assert abs(bottom - v * (bottom - top) - y) < 0.01


def test_cells_smaller_than_pixels_leave_no_holes(surface):
    """A small photograph, of which the canvas has several pixels for one of its own."""
    small = surface.matte[::4, ::4]
    framing = Framing.around(torch.from_numpy(np.ascontiguousarray(small)), 128)
    camera = Camera.of(torch.from_numpy(np.ascontiguousarray(small)), 1.2, 30.0)
    flat = np.zeros(surface.depth.shape)
    mesh = build(PersonSurface(flat, surface.normals, surface.known, framing, camera, small))
    sheet = mesh.points[front(mesh)]
    across, up = sheet[:, 1] - sheet[:, 0], sheet[:, 2] - sheet[:, 0]
    area = abs(across[:, 0] * up[:, 1] - across[:, 1] * up[:, 0]).sum() / 2
    np.testing.assert_allclose(area, (small > 0.5).sum() * camera.metres_per_pixel**2, rtol=1e-3)


@pytest.mark.parametrize("blur", [0.6, 3.0])
@pytest.mark.parametrize("turn", [-30, 18])
def test_the_cut_at_half_coverage_does_not_open_the_shell(surface, blur, turn):
    """Rays from the side, which pass where the texture is transparent, never meet the shell from inside."""
    pytest.importorskip("embreex")
    trimesh = pytest.importorskip("trimesh")
    rows, columns = np.mgrid[:200, :160] + 0.5
    wavy = 55 + 3 * np.sin(rows / 4)
    matte = (1 / (1 + np.exp((np.hypot((rows - 100) / 1.5, columns - 80) - wavy) / blur))).astype(np.float32)
    body = Camera.of(torch.from_numpy(matte), 1.2, 30.0)
    framing = Framing.around(torch.from_numpy(matte), 128)
    mesh = build(
        surface._replace(depth=np.zeros_like(surface.depth), framing=framing, camera=body, matte=matte)
    )
    solid = trimesh.Trimesh(mesh.points, mesh.faces, process=False)
    angle = np.radians(turn)
    toward = np.array([np.sin(angle), 0, np.cos(angle)])
    right = np.array([toward[2], 0, -toward[0]])
    across, up = np.meshgrid(np.linspace(-0.6, 0.6, 240), np.linspace(-0.7, 0.7, 280))
    start = (across[..., None] * right + up[..., None] * np.array([0, 1, 0]) + 3 * toward).reshape(-1, 3)
    triangle, ray, place = solid.ray.intersects_id(
        start, np.tile(-toward, (len(start), 1)), multiple_hits=True, max_hits=8, return_locations=True
    )
    shares = trimesh.triangles.points_to_barycentric(solid.triangles[triangle], place)
    uv = np.nan_to_num((mesh.uv[mesh.faces[triangle]] * shares[..., None]).sum(axis=1))
    top, left, bottom, right_end = mesh.box
    at = [(1 - uv[:, 1]) * (bottom - top) + top - 0.5, uv[:, 0] * (right_end - left) + left - 0.5]
    kept = np.flatnonzero(map_coordinates(matte, at, order=1) >= CUTOFF)
    kept = kept[np.lexsort((-(place @ toward)[kept], ray[kept]))]
    first = kept[np.diff(ray[kept], prepend=-1) > 0]
    from_inside = solid.face_normals[triangle[first]] @ toward < -0.05
    assert len(first) > 10_000
    assert from_inside.mean() < 1e-3


@pytest.mark.parametrize("fold", [6, 9])
def test_folds_of_the_front_do_not_go_through_to_the_back(surface, fold):
    """Seen from the side, the back stands out beside the front, and its own outline would be ragged."""
    _, y = (values.numpy() for values in canvas_grid(surface.framing))
    mesh = build(surface._replace(depth=0.01 * np.sin(2 * np.pi * y / fold)))
    sheet, back = np.split(mesh.points, 2)
    middle = abs(sheet[:, 0]) < 0.08
    middle &= abs(sheet[:, 1]) < 0.3
    assert sheet[middle, 2].std() > 0.005
    assert back[middle, 2].std() < 0.2 * sheet[middle, 2].std()


@pytest.mark.parametrize("row", [30, 100, 190])
def test_nothing_is_below_the_soles(surface, row):
    """The back goes away from the camera, downward below its horizon; at the ground it stops."""
    matte = np.zeros(PLATE, np.float32)
    matte[10:row, 40:120] = 1
    camera = Camera.of(torch.from_numpy(matte), 1.2, 30.0)
    framing = Framing.around(torch.from_numpy(matte), 128)
    mesh = build(surface._replace(framing=framing, camera=camera, matte=matte))
    below = mesh.points[:, 1] < mesh.lowest - 1e-6
    assert not below.any() or camera.eye[1] <= mesh.lowest  # then the back goes upward
    assert mesh.points[:, 1].min() > mesh.lowest - 3 * camera.metres_per_pixel


@pytest.mark.parametrize("triangles", [1000, 5000])
def test_triangles_are_as_many_as_are_allowed(surface, triangles):
    count = len(build(surface, triangles).faces)
    assert 0.5 * triangles < count <= triangles


@pytest.mark.parametrize("triangles", [0, 999, 2.5e4])
def test_too_few_triangles_are_refused(surface, triangles):
    with pytest.raises(ValueError, match="triangles: expected a whole number of at least 1000"):
        build(surface, triangles)
