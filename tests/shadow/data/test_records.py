import dataclasses
import io
import subprocess
import sys
import zipfile

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from helpers import ROOT
from PIL import Image

from shadow.data import lightings, photographs, records
from shadow.framing import canvas_size


def same(a, b):
    arrays = ("mask", "normals_int8", "albedo_uint8", "visibility_bits", "directions", "depth_float16")
    return a.about == b.about and all(np.array_equal(getattr(a, n), getattr(b, n)) for n in arrays)


def test_round_trip_is_exact(ball, tmp_path):
    size = records.write(tmp_path / "a.npz", ball)
    assert size == (tmp_path / "a.npz").stat().st_size
    assert same(records.Records([tmp_path])[0], ball)
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_bounce_light_is_kept_with_its_pixels(ball, tmp_path):
    rng = np.random.default_rng(0)
    factors = rng.random((len(ball.normals_int8), 8)), rng.random((8, len(ball.directions), 3))
    lit = dataclasses.replace(
        ball, bounce_float16=factors[0].astype(np.float16), bounce_patterns=factors[1].astype(np.float32)
    )
    records.write(tmp_path / "a.npz", lit)
    back = records.Records([tmp_path])[0]
    np.testing.assert_array_equal(back.bounce[0], lit.bounce_float16)
    np.testing.assert_array_equal(back.bounce[1], lit.bounce_patterns)
    small = back.cropped(20)
    assert len(small.bounce[0]) == small.mask.sum() < len(lit.bounce[0])
    assert set(map(bytes, small.bounce_float16)) <= set(map(bytes, lit.bounce_float16))
    assert not ball.bounce[0].any()


def test_records_without_depth_load(ball, tmp_path):
    records.write(tmp_path / "a.npz", dataclasses.replace(ball, depth_float16=None))
    back = records.Records([tmp_path])[0]
    assert back.depth is None
    assert back.cropped(20).depth is None
    view = photographs.sample(back, np.random.default_rng(0), canvas_size(128), 1)
    assert view["depth_known"] == 0
    assert not view["depth"].any()


@pytest.mark.parametrize("seed", range(6))
def test_depth_is_in_units_of_the_height_that_shows(ball, seed):
    """Turned, moved, enlarged, a sphere is as deep as its outline says; cut, deeper for what shows."""
    pytest.importorskip("kornia")
    view = photographs.sample(ball, np.random.default_rng(seed), canvas_size(256), 1)
    inside = (view["mask"][0] > 0.99) & (view["matte"][0] > 0.99) & (view["normals"][2] > 0.3)
    found, slope = view["depth"][0][inside], -view["normals"][2][inside]
    gain = ((found - found.mean()) * (slope - slope.mean())).sum() / (slope - slope.mean()).square().sum()
    x = view["normals"][0]
    across = torch.nonzero(inside)[:, 1][(x[inside].abs() < 0.9)].float()
    radius = ((across - across.mean()).square().sum() / (
        (x[inside][x[inside].abs() < 0.9] - x[inside][x[inside].abs() < 0.9].mean()).square().sum()
    )).sqrt()  # canvas pixels  # fmt: skip
    rows = torch.nonzero((view["mask"][0] > 0.5).any(dim=1))[:, 0]
    assert gain == pytest.approx(float(radius / (rows[-1] + 1 - rows[0])), rel=0.04)


def test_stored_precision(ball):
    step = (np.arange(96) + 0.5) * 2 / 96 - 1
    x, y = np.meshgrid(step / 0.8, -step / 0.8)
    truth = np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))], axis=-1)[ball.mask]
    assert np.degrees(np.arccos(np.clip((ball.normals * truth).sum(axis=1), -1, 1))).max() < 0.6
    np.testing.assert_array_equal(ball.visibility, truth @ ball.directions.T > 0)
    np.testing.assert_allclose(ball.albedo[:, 0], 0.8, atol=0.005)


@pytest.mark.parametrize("keep", [0, 10, 0.5, 0.95])
def test_a_truncated_record_is_named(ball, tmp_path, keep):
    data = records.to_bytes(ball)
    (tmp_path / "cut.npz").write_bytes(data[: int(keep * len(data)) if keep < 1 else keep])
    with pytest.raises(ValueError, match=r"cut\.npz is damaged"):
        records.Records([tmp_path])[0]


def test_missing_and_empty_folders(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file or folder"):
        records.Records([tmp_path / "absent"])
    with pytest.raises(ValueError, match="no records"):
        records.Records([tmp_path])
    with pytest.raises(ValueError, match="holds no records"):
        records.pack(tmp_path, tmp_path / "out")


def test_shards_hold_every_record_once_and_stay_small(ball, tmp_path, monkeypatch):
    (tmp_path / "views").mkdir()
    size = records.write(tmp_path / "views" / "00.npz", ball)
    for number in range(1, 10):
        records.write(tmp_path / "views" / f"{number:02d}.npz", ball)
    monkeypatch.setattr(records, "SHARD_BYTES", 4 * size)
    shards = records.pack(tmp_path / "views", tmp_path / "shards")
    assert all(path.stat().st_size <= 4 * size for path in shards)
    names = [name for path in shards for name in zipfile.ZipFile(path).namelist()]
    assert sorted(names) == [f"{number:02d}.npz" for number in range(10)]
    found = records.Records([tmp_path / "shards"])
    assert len(found) == 10
    assert same(found[7], ball)


def test_light_is_lambert_times_visibility(ball):
    weights = np.zeros((96, 3), np.float32)
    weights[5] = [1, 0.5, 0.25]
    shading = np.maximum(ball.normals @ ball.directions[5], 0) * ball.visibility[:, 5]
    expected = ball.albedo * shading[:, None] * weights[5]
    np.testing.assert_allclose(photographs.light(ball, weights), expected, atol=1e-5)


def test_light_is_linear(ball):
    rng = np.random.default_rng(0)
    a, b = (lightings.random_lighting(rng, ball.directions) for _ in range(2))
    np.testing.assert_allclose(
        photographs.light(ball, a + 2 * b),
        photographs.light(ball, a) + 2 * photographs.light(ball, b),
        rtol=1e-4,
        atol=1e-5,
    )


def test_random_lighting_is_never_dark():
    from shadow.directions import olat

    rng = np.random.default_rng(0)
    for _ in range(50):
        weights = lightings.random_lighting(rng, olat(behind=True))
        assert np.isfinite(weights).all()
        assert (weights >= 0).all()
        assert weights.sum() > 1


def test_everyday_light_is_hard_or_a_sky_as_often_and_shadows_are_bluer_than_keys():
    from shadow.directions import olat

    directions, rng = olat(behind=True), np.random.default_rng(0)
    hard = bluer = 0
    for _ in range(400):
        weights = lightings.everyday_lighting(rng, directions)
        assert np.isfinite(weights).all()
        assert weights.min() >= 0
        assert weights.sum() > 1
        energy = weights.sum(axis=1)
        brightest = np.sort(energy)[::-1]
        if brightest[:2].sum() < 0.88 * (brightest[:2].sum() + brightest[2:].sum() / 4):
            continue
        hard += 1
        key, fill = weights[energy.argmax()], weights[energy < brightest[1]].sum(axis=0)
        bluer += fill[2] * key[0] >= key[2] * fill[0] * 0.999
    assert 0.3 < hard / 400 < 0.5  # a third, and what random_lighting has of them
    assert bluer > 0.8 * hard


def test_lighting_without_ambient_light():
    from shadow.directions import olat

    rng = np.random.default_rng(0)
    for _ in range(20):
        weights = lightings.random_lighting(rng, olat(behind=True), unfilled=1)
        assert 1 <= weights.any(axis=1).sum() <= 4
        assert weights.sum() > 1


@pytest.mark.parametrize("seed", range(12))
def test_normals_and_lights_turn_with_the_picture(ball, seed):
    """A flipped, turned, scaled sphere is still a sphere: its normals follow from its outline, and where it
    is lit follows from them and the turned lights."""
    pytest.importorskip("kornia")
    view = photographs.sample(ball, np.random.default_rng(seed), canvas_size(128), lights=8)
    inside = (view["mask"][0] > 0.99) & (view["normals"][2] > 0.5)
    y, x = torch.nonzero(inside, as_tuple=True)
    normals = view["normals"][:, inside]
    # The outline gives x and y up to a common scale and the centre: a linear fit must explain them.
    ones = torch.ones_like(x)
    for axis, position in ((0, x), (1, -y)):
        system = torch.stack([position, ones], dim=1).float()
        fit = torch.linalg.lstsq(system, normals[axis, :, None]).solution
        assert fit[0] > 0
        assert (system @ fit - normals[axis, :, None]).abs().max() < 0.06
    cosine = view["directions"] @ normals
    certain = cosine.abs() > 0.1
    lit = view["visibility"][:, inside]
    torch.testing.assert_close(lit[certain].round(), (cosine > 0).float()[certain])


def test_without_augmentation_the_camera_frame_is_kept(ball):
    view = photographs.sample(ball, np.random.default_rng(0), canvas_size(128), augment=False)
    np.testing.assert_allclose(view["directions"], ball.directions, atol=1e-6)
    inside = view["mask"][0] > 0.99
    left, right = view["normals"][0][:, :60][inside[:, :60]], view["normals"][0][:, 132 - 96 :]
    assert left.mean() < 0 < right[inside[:, 132 - 96 :]].mean()
    top = view["normals"][1][:40][inside[:40]]
    assert top.mean() > 0


def test_what_the_frame_cuts_stays_cut(ball):
    """A record's frame is a plate's: no margin where it cuts the subject, also when the picture is turned."""
    pytest.importorskip("kornia")
    cut = _framed(ball, slice(0, 60), slice(None))
    for height in (128, 20):
        assert cut.cropped(height).mask[-1].any()
        assert not cut.cropped(height).mask[[0]].any()
        assert not ball.cropped(height).mask[[0, -1]].any()
    size = canvas_size(128)
    assert photographs.sample(cut, np.random.default_rng(0), size, 1, augment=False)["mask"][0, -1].any()
    drawn = [photographs.sample(cut, np.random.default_rng(seed), size, 1)["mask"][0] for seed in range(20)]
    assert np.mean([mask[-1, 10:-10] for mask in drawn]) > 0.9


def test_what_the_frame_cuts_on_all_sides_fills_the_canvas(ball):
    pytest.importorskip("kornia")
    cut = _framed(ball, slice(30, 70), slice(35, 65))
    assert cut.mask.all()
    size = canvas_size(128)
    drawn = [photographs.sample(cut, np.random.default_rng(seed), size, 1)["mask"][0] for seed in range(20)]
    assert np.mean([mask[:, [0, -1]] for mask in drawn]) > 0.9


def _framed(record, rows, columns):
    """What a smaller frame shows of a record."""
    inside = np.zeros_like(record.mask)
    inside[rows, columns] = True
    kept = {
        name: getattr(record, name)[inside[record.mask]]
        for name in ("normals_int8", "albedo_uint8", "visibility_bits", "depth_float16")
    }
    return dataclasses.replace(record, mask=record.mask[rows, columns], **kept)


def test_a_given_lighting_is_the_one_photographed(ball):
    lighting = np.zeros_like(ball.directions)
    lighting[9] = 0.5, 1, 2
    size, seed = canvas_size(128), 0  # a seed without gloss
    view, twice = (
        photographs.sample(ball, np.random.default_rng(seed), size, augment=False, lighting=k * lighting)
        for k in (1, 2)
    )
    torch.testing.assert_close(view["weights"], torch.from_numpy(lighting))
    torch.testing.assert_close(twice["rgb"], 2 * view["rgb"])
    cosine = (view["normals"] * view["directions"][9].view(3, 1, 1)).sum(dim=0).clamp_min(0)
    lit = view["albedo"] * cosine * view["visibility"][9] * torch.tensor([0.5, 1, 2]).view(3, 1, 1)
    inside = (view["mask"][0] == 1) & ((view["visibility"][9] == 0) | (view["visibility"][9] == 1))
    torch.testing.assert_close(view["rgb"][:, inside], lit[:, inside], atol=0.02, rtol=0)


def test_samples_are_deterministic_and_finite(ball):
    first, again = (photographs.sample(ball, np.random.default_rng(3), canvas_size(128), 5) for _ in range(2))
    for key, value in first.items():
        assert torch.isfinite(value).all(), key
        torch.testing.assert_close(value, again[key], rtol=0, atol=0)
    assert first["rgb"].min() >= 0
    assert first["rgb"].max() <= 1
    assert first["visibility"].shape == (5, 128, 96)


def test_a_rough_matte_is_wrong_at_the_edge_alone(ball):
    mask = photographs.sample(ball, np.random.default_rng(0), canvas_size(256), 1, augment=False)["mask"]
    width = 2 * round(0.012 * 256) + 1
    core = -F.max_pool2d(-mask, width, stride=1, padding=width // 2)
    reach = F.max_pool2d(mask, width, stride=1, padding=width // 2)
    for seed in range(8):
        matte = photographs.MatteError.draw(np.random.default_rng(seed))(mask)
        assert (matte >= core).all()
        assert (matte[reach == 0] == 0).all()
        assert 0 < (matte - mask).abs().sum() < 0.1 * mask.sum()


def test_compression_is_that_of_a_jpeg_file(ball):
    """As Pillow's, at the same quality; its chroma is at full resolution."""
    pytest.importorskip("kornia")
    view = photographs.sample(ball, np.random.default_rng(0), canvas_size(128), 1, augment=False)
    rgb = photographs.photograph(view["rgb"], view["mask"], np.random.default_rng(0))
    encoded = (rgb ** (1 / records.ENCODING) * 255).round().permute(1, 2, 0).numpy().astype(np.uint8)
    for quality in (30, 90):
        file = io.BytesIO()
        Image.fromarray(encoded).save(file, "JPEG", quality=quality, subsampling=0)
        reference = np.asarray(Image.open(file)).astype(float)
        ours = (photographs.compress(rgb, quality) ** (1 / records.ENCODING) * 255).permute(1, 2, 0).numpy()
        lost = np.abs(reference - encoded).mean()
        assert np.abs(ours - reference).mean() < 0.6 * lost


def test_sharpening_deepens_detail_and_keeps_what_is_flat(ball):
    pytest.importorskip("kornia")
    view = photographs.sample(ball, np.random.default_rng(0), canvas_size(128), 1, augment=False)
    rgb = view["rgb"].clamp(0, 1)
    torch.testing.assert_close(photographs.sharpen(rgb, 1.0), rgb)
    flat = torch.full_like(rgb, 0.3)
    torch.testing.assert_close(photographs.sharpen(flat, 3.0), flat)
    slopes = [
        (image ** (1 / records.ENCODING)).diff(dim=2).abs().mean()
        for image in (photographs.sharpen(rgb, 0.0), rgb, photographs.sharpen(rgb, 3.0))
    ]
    assert slopes[0] < slopes[1] < slopes[2]


@pytest.mark.parametrize("seed", range(6))
def test_truth_is_asked_for_where_the_matte_shows_the_subject(ball, seed):
    pytest.importorskip("kornia")
    view = photographs.sample(ball, np.random.default_rng(seed), canvas_size(128), 3)
    assert (view["mask"] <= view["matte"]).all()
    inside = view["mask"] > 0.5
    assert inside.any()
    length = view["normals"].square().sum(dim=0)[inside[0]]
    torch.testing.assert_close(length, torch.ones_like(length))


MOUNTED = """
import sys
forbidden = []
def watch(event, arguments):
    writes = event == "open" and arguments[1] is not None and set(str(arguments[1])) & set("wax+")
    if event in ("mmap.__new__", "fcntl.flock", "fcntl.lockf") or writes:
        forbidden.append((event, arguments[:2]))
import numpy, torch
from shadow.data.records import Records
from shadow.framing import canvas_size
from shadow.training.minibatches import Photographs
sys.addaudithook(watch)
records = Records(sys.argv[1:])
photographs = Photographs(records, 1, canvas_size(128), 4, 0, len(records), augment=False)
for index in range(len(photographs)):
    photographs[index]
assert not forbidden, forbidden
print(len(records))
"""


def test_training_reads_as_a_mounted_object_store_lets_it(ball, tmp_path):
    """Packs are opened, sought in and read: never mapped, locked or written, which such mounts refuse."""
    for number in range(3):
        records.write(tmp_path / f"{number}.npz", ball)
    (shard,) = records.pack(tmp_path, tmp_path / "shards")
    shard.chmod(0o444)
    shard.parent.chmod(0o555)
    try:
        command = [sys.executable, "-c", MOUNTED, str(shard.parent)]
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    finally:
        shard.parent.chmod(0o755)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "3"
