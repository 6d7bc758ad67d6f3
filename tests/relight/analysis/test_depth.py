import numpy as np
import OpenImageIO as oiio
import pytest
import torch
from helpers import shots
from helpers.onnx_models import onnx_package, save

import relight
from relight.analysis.camera import Camera, canvas_grid
from relight.analysis.depth import AlignedDepth, IntegratedDepth, WorldGeometry, centred, checked_depth
from shadow.framing import Framing

SIZE = (192, 144)


def camera(matte, **options):
    return Camera.of(torch.from_numpy(np.float32(matte)), **options)


def balls(*shapes):
    """Spheres (x, y, z, radius), metres, before a camera at the origin that looks along -z with a vertical
    field of view of 40 degrees: mask (h, w), normals (3, h, w) and distance along the axis (h, w)."""
    focal = SIZE[0] / 2 / np.tan(np.radians(20))
    y, x = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5
    ray = np.stack([(x - SIZE[1] / 2) / focal, (SIZE[0] / 2 - y) / focal, -np.ones(SIZE)])
    away, normals = np.full(SIZE, np.inf), np.zeros((3, *SIZE))
    for *centre, radius in shapes:
        middle = np.array(centre)[:, None, None]
        a, b = (ray**2).sum(axis=0), (ray * middle).sum(axis=0)
        under = b**2 - a * ((middle**2).sum() - radius**2)
        distance = np.where(under > 0, (b - np.sqrt(under.clip(0))) / a, np.inf)
        nearer = distance < away
        away = np.where(nearer, distance, away)
        found = (ray * np.where(nearer, distance, 0) - middle) / radius
        normals = np.where(nearer, found, normals)
    mask = np.isfinite(away)
    return mask, torch.from_numpy(np.float32(normals * mask)), np.where(mask, away, 0)


def shown(mask, away):
    """The metres that the mask shows at the median of its distances."""
    rows = np.flatnonzero(mask.any(axis=1))
    return (rows[-1] + 1 - rows[0]) * np.median(away[mask]) / SIZE[0] * 2 * np.tan(np.radians(20))


def space(mask, normals, away, room=None):
    """The room of a frame of 192 x 144 that is its own canvas."""
    framing = Framing((SIZE[1] / 2, SIZE[0] / 2), 1.0, SIZE, SIZE)
    room = room or camera(mask, height=shown(mask, away))
    return WorldGeometry(room, framing, IntegratedDepth(room, framing, normals, torch.from_numpy(mask)))


def test_positions_are_metres_from_the_middle_of_the_matte():
    matte = np.zeros((400, 300))
    matte[100:300, 200:260] = 1
    room = camera(matte, height=1.6, field_of_view=40)
    corners = torch.tensor([200.0, 260.0, 230.0]), torch.tensor([100.0, 300.0, 200.0])
    top, foot, middle = room.positions(*corners, torch.tensor([0.0, 0.0, 0.3])).T
    np.testing.assert_allclose(top, (-0.24, 0.8, 0), atol=1e-5)
    np.testing.assert_allclose(foot, (0.24, -0.8, 0), atol=1e-5)
    assert middle[2] == pytest.approx(-0.3)  # farther away is along -z
    assert room.distance == pytest.approx(1.6 / 200 * 200 / np.tan(np.radians(20)))
    assert room.on_plate(middle.tolist()) == pytest.approx((230, 200), abs=1e-3)


def test_a_sphere_comes_out_as_it_is():
    mask, normals, away = balls((0.1, 0, -5, 1.0))
    room = space(mask, normals, away)
    estimate = room.depth.numpy()
    error = estimate - (away - np.median(away[mask]))
    assert np.abs(error)[mask].mean() < 0.01  # of a radius of 1
    assert room.camera.distance == pytest.approx(np.median(away[mask]))
    assert not estimate[~mask].any()


def test_depth_jumps_where_a_limb_passes_before_the_body():
    mask, normals, away = balls((0, 0, -5, 1.2), (0.9, 0.3, -4.2, 0.35))
    estimate = space(mask, normals, away).depth.numpy()
    error = np.abs(estimate - (away - np.median(away[mask])))[mask]
    assert error.mean() < 0.007  # 0.009 where pixels trust both of their sides alike


def test_an_arm_held_forward_does_not_move_the_middle():
    known = torch.ones(20, 20, dtype=torch.bool)
    depth = torch.full((20, 20), 3.0)
    depth[:8, 5] = 2.4  # a fiftieth of the person
    assert not centred(depth, known)[:, 6:].any()


def test_an_arm_that_rises_leaves_the_torso_where_it_is():
    torso, hanging = (0, 0, -5, 0.8), [(0.95, -0.1 - 0.25 * i, -5, 0.16) for i in range(4)]
    raised = [(0.9 + 0.12 * i, 0.3 + 0.3 * i, -4.9 + 0.1 * i, 0.16) for i in range(4)]
    lamp = torch.tensor([-0.6, 0.8, 2.0])[:, None, None]
    lit, room = [], None
    for arm in (hanging, raised):
        mask, normals, away = balls(torso, *arm)
        found = space(mask, normals, away, room)
        room = found.camera
        ways = lamp - found.positions
        lit.append((ways * normals).sum(dim=0).clamp_min(0) / (ways**2).sum(dim=0) ** 1.5)
    inside = balls((0, 0, -5, 0.6))[0]
    before, after = (image.numpy()[inside] for image in lit)
    assert np.abs(after - before).mean() < 0.01 * before.mean()


def test_a_person_cut_by_the_frame_is_said_to_have_a_guessed_height(recwarn):
    mask, normals, away = balls((0, -1.2, -5, 1.0))
    said, guessed = (camera(mask, height=height) for height in (1.2, None))
    assert said.distance < guessed.distance
    _ = space(mask, normals, away, said).depth
    assert not recwarn
    with pytest.warns(UserWarning, match="height: the frame cuts the person"):
        _ = space(mask, normals, away, guessed).depth


def test_given_depth_counts_by_its_differences(person):
    rgb, mask = person
    given = np.tile(np.linspace(2, 3, 160, dtype=np.float32), (200, 1))
    subject = relight.Subject(rgb, mask, depth=given + 5)
    inside = mask > 0
    expected = given - np.median(given[inside])
    assert np.abs(subject.depth - expected)[inside].max() < 0.02
    assert not subject.depth[~inside].any()
    for wrong, error in ((given[1:], ValueError), (given * np.nan, ValueError), (mask > 0, TypeError)):
        with pytest.raises(error, match="depth: "):
            relight.Subject(rgb, mask, depth=wrong)


def network(path, scale, channels=1):
    """A network of DAViD's signature whose depth is the picture's first channel, blue, times `scale`."""
    helper = onnx_package().helper
    shape, numbers = [1, 3, 512, 512], {"a": np.int64([0]), "b": np.int64([channels]), "axis": np.int64([1])}
    nodes = [
        helper.make_node("Slice", ["x", "a", "b", "axis"], ["blue"]),
        helper.make_node("Mul", ["blue", "scale"], ["d"]),
    ]
    outputs = {"d": [1, channels, 512, 512]}
    return save(path, nodes, {"x": shape}, outputs, scale=np.float32([scale]), **numbers)


def test_relative_depth_is_scaled_to_the_normals_either_way_up():
    mask, normals, away = balls((0, 0, -5, 1.0))
    own = space(mask, normals, away)
    known, relative = torch.from_numpy(mask), torch.from_numpy(np.float32(away))
    for scale in (3.0, -0.2):
        found = AlignedDepth(scale * relative + 7, known, own._source)()
        assert (found - own.depth)[known].abs().mean() < 0.03
    noise = torch.rand(SIZE, generator=torch.Generator().manual_seed(0))
    with pytest.raises(ValueError, match="does not go with the person's normals"):
        AlignedDepth(noise, known, own._source)()


def test_a_picture_of_depth_is_scaled_to_the_normals():
    mask, normals, away = balls((0, 0, -5, 1.0))
    rgb = np.full((*SIZE, 3), 0.2, np.float32)
    options = {"normals": normals.permute(1, 2, 0).numpy(), "height": shown(mask, away)}
    near_is_white = np.where(mask, (5.2 - away) / 1.2 * 65535, 0)
    for picture in (near_is_white.astype(np.uint16), (255 - near_is_white / 257).astype(np.uint8)):
        depth = relight.Subject(rgb, np.float32(mask), depth=picture, **options).depth
        assert np.corrcoef(depth[mask], away[mask])[0, 1] > 0.97
        assert np.std(depth[mask]) == pytest.approx(np.std(away[mask]), rel=0.1)


def test_depth_by_a_network(tmp_path):
    mask, normals, away = balls((0, 0, -5, 1.0))
    rgb = np.full((*SIZE, 3), 0.2, np.float32)
    rgb[..., 2] = np.where(mask, (away - 3.9) / 1.2, 0.5) ** 2.2  # about what the network reads from it
    options = {"normals": normals.permute(1, 2, 0).numpy(), "height": shown(mask, away)}
    with pytest.raises(ValueError, match="is neither DAViD's depth nor its multi-task model"):
        relight.Subject(rgb, np.float32(mask), depth=network(tmp_path / "two.onnx", 1.0, channels=2))
    model = network(tmp_path / "m.onnx", -1.0)
    read = relight.Subject(rgb, np.float32(mask), depth=model, **options)
    assert np.corrcoef(read.depth[mask], away[mask])[0, 1] > 0.97
    assert np.std(read.depth[mask]) == pytest.approx(np.std(away[mask]), rel=0.1)


def test_pass_z_is_metres_in_floats(tmp_path, person):
    rgb, mask = person
    path, light = tmp_path / "o.exr", relight.DirectionalLight(name="key")
    image = np.concatenate([rgb * mask[..., None], mask[..., None]], axis=-1)
    shots.render(image, light, path, passes=["Z"], height=1.6)
    spec = oiio.ImageBuf(str(path)).spec()
    formats = dict(zip(spec.channelnames, map(str, spec.channelformats), strict=True))
    assert formats["Z"] == "float"
    assert formats["R"] == formats["C_key.R"] == "half"
    stored = relight.media.images.read_depth(path)
    np.testing.assert_array_equal(relight.read_layers(path)["Z"][..., 0], stored)
    assert ((stored > 0) == (mask > 0)).all()
    subject = relight.Subject(image, height=1.6, depth=stored)  # a Z pass can be given back
    assert spec.getattribute("relight:distance") == pytest.approx(subject.distance)
    assert np.median(stored[mask > 0]) == pytest.approx(subject.distance, rel=0.01)
    assert np.abs(subject.distance + subject.depth - stored)[mask > 0].max() < 0.03
    y, x = (torch.from_numpy(part.astype(np.float32)) for part in np.indices(mask.shape) + 0.5)
    places = subject.camera.positions(x, y, torch.tensor(subject.depth)).numpy()[:, mask > 0]
    # The height is that at the middle's depth: a head or feet nearer to the camera or farther away change it.
    assert places.max(axis=1)[1] - places.min(axis=1)[1] == pytest.approx(1.6, rel=0.08)


def test_the_grid_of_a_canvas_is_where_its_framing_says():
    framing = Framing((30.0, 40.0), 2.0, (128, 96), (80, 60))
    x, y = canvas_grid(framing)
    plate = torch.stack(torch.meshgrid(torch.arange(80) + 0.5, torch.arange(60) + 0.5, indexing="ij"))
    down, across = framing.crop(plate)[:, 20:-20, 20:-20]
    torch.testing.assert_close(x[20:-20, 20:-20], across, atol=1e-3, rtol=0)
    torch.testing.assert_close(y[20:-20, 20:-20], down, atol=1e-3, rtol=0)


@pytest.mark.parametrize("far", [1e10, np.inf, -np.inf, np.nan])
def test_what_renderers_write_beside_the_person_is_ignored(far):
    matte = torch.zeros(8, 8)
    matte[2:6, 2:6] = 1
    depth = np.full((8, 8), far, np.float32)
    depth[2:6, 2:6] = 2.5
    found = checked_depth(depth, matte)[0]
    assert torch.isfinite(found).all()
    assert (found[matte > 0] == 2.5).all()
    depth[3, 3] = far
    with pytest.raises(ValueError, match=r"depth: contains NaN, infinite values or .* where the person is"):
        checked_depth(depth, matte)
