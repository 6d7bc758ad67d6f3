"""What is kept of an analysed person, and what comes back."""

import json
import os

import numpy as np
import pytest
import torch
from helpers import standins
from helpers.clothed import clothed
from helpers.damage import small_canvas
from safetensors import safe_open
from safetensors.numpy import save_file

import relight
from relight.analysis import array_codec, storage
from relight.analysis.old_light import OldLight
from relight.errors import DamagedFileError, UnsupportedFileError

KEY = relight.DirectionalLight(azimuth=-40, elevation=30, name="key")
SKY = relight.EnvironmentLight(np.linspace(2, 0.1, 8, dtype=np.float32)[:, None, None] * np.ones((8, 16, 3)))
LAMP = relight.PointLight((0.4, 0.3, 0.6), name="lamp")


@pytest.fixture(scope="module")
def subject():
    with small_canvas(256):
        return relight.Subject(*clothed())


@pytest.fixture
def no_network():
    with standins.no_network():
        yield


def rms(first, second, inside):
    return float(np.sqrt(((first - second)[inside] ** 2).mean()))


def test_what_comes_back_is_relit_alike(subject, tmp_path, no_network):
    subject.save(tmp_path / "kept.safetensors")
    kept = relight.Subject.load(tmp_path / "kept.safetensors")
    inside = subject.matte > 0
    for light in (KEY, SKY, LAMP):
        assert rms(kept.relit(light), subject.relit(light), inside) < 0.002
    np.testing.assert_allclose(kept.matte, subject.matte, atol=3e-4)
    assert rms(kept.albedo, subject.albedo, inside) < 2e-4
    assert rms(kept.normals, subject.normals, inside) < 5e-4
    assert rms(kept.depth, subject.depth, inside) < 1e-3
    assert kept.camera == subject.camera
    directions = np.float32([[0.6, 0.2, 0.7], [0, 0, 1]])
    assert rms(kept.visibility(directions), subject.visibility(directions), np.s_[:, inside]) < 0.01
    picture = relight.over(subject.relit(KEY), (0, 0, 0))
    powers = [one.fit_lighting(picture)[1].sum() for one in (kept, subject)]
    np.testing.assert_allclose(*powers, rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("given", [False, True])
def test_colour_of_a_large_person_is_shortened(tmp_path, monkeypatch, given):
    plate, matte = clothed()
    subject = relight.Subject(plate, matte, albedo=plate if given else None)
    inside, sizes = subject.matte > 0, []
    for name in ("exact.safetensors", "short.safetensors"):
        subject.save(tmp_path / name)
        with safe_open(tmp_path / name, "np") as file:
            sizes.append(len(file.get_tensor("provided_albedo" if given else "colour")))
        monkeypatch.setattr(storage, "SHORTENING_PIXELS", 1000)
    exact, short = (relight.Subject.load(tmp_path / f"{name}.safetensors") for name in ("exact", "short"))
    assert sizes[1] < 0.8 * sizes[0]
    assert 1e-5 < rms(short.relit(KEY), exact.relit(KEY), inside) < 0.002
    np.testing.assert_allclose(short.albedo[inside], exact.albedo[inside], rtol=0.02, atol=1e-3)


@pytest.mark.slow
def test_provided_albedo_and_a_matte_with_specks_come_back(tmp_path):
    plate, matte = clothed()
    matte[2:4, 2:4] = 1
    with pytest.warns(UserWarning, match="small parts far from the person"):
        subject = relight.Subject(plate, matte, albedo=np.full_like(plate, 0.5))
    subject.save(tmp_path / "kept.safetensors")
    kept = relight.Subject.load(tmp_path / "kept.safetensors")
    assert (kept.matte[2:4, 2:4] == 1).all()
    np.testing.assert_allclose(kept.albedo[subject.matte > 0], 0.5, atol=1e-3)
    np.testing.assert_allclose(kept.relit(KEY), subject.relit(KEY), atol=0.03)
    assert rms(kept.relit(KEY), subject.relit(KEY), subject.matte > 0) < 0.002


@pytest.mark.slow
def test_it_is_linear_in_the_lights_and_may_be_filtered_and_kept_again(subject, tmp_path):
    subject.save(tmp_path / "once.safetensors")
    kept = relight.Subject.load(tmp_path / "once.safetensors")
    twice = relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2)
    np.testing.assert_allclose(kept.relit(twice)[..., :3], 2 * kept.relit(KEY)[..., :3], rtol=1e-5, atol=1e-6)
    kept.save(tmp_path / "again.safetensors")
    again = relight.Subject.load(tmp_path / "again.safetensors")
    assert rms(again.relit(KEY), kept.relit(KEY), subject.matte > 0) < 0.001
    steady = kept.temporally_filtered([subject])
    assert rms(steady.relit(KEY), subject.relit(KEY), subject.matte > 0) < 0.002


@pytest.mark.slow
def test_a_filtered_person_is_kept_as_they_are(tmp_path):
    frames = [relight.Subject(*clothed(seed=seed)) for seed in range(3)]
    steady = frames[1].temporally_filtered([frames[0], frames[2]])
    steady.save(tmp_path / "steady.safetensors")
    kept = relight.Subject.load(tmp_path / "steady.safetensors")
    for light in (KEY, SKY):
        error = rms(kept.relit(light), steady.relit(light), steady.matte > 0)
        assert error < 0.0015
        assert error < 0.5 * rms(kept.relit(light), frames[1].relit(light), steady.matte > 0)


@pytest.mark.slow
def test_bright_and_dark_plates_keep_their_precision(tmp_path):
    plate, matte = clothed()
    for exposure in (1e-6, 1e7):
        subject = relight.Subject(plate * np.float32(exposure), matte)
        subject.save(tmp_path / "kept.safetensors")
        kept = relight.Subject.load(tmp_path / "kept.safetensors")
        assert rms(kept.relit(KEY), subject.relit(KEY), matte > 0) < 0.002


def test_maps_of_the_anchors_are_of_low_rank(subject, tmp_path):
    subject.save(tmp_path / "kept.safetensors")
    with safe_open(tmp_path / "kept.safetensors", "np") as file:
        about = json.loads(file.metadata()["relight"])
    assert about["old_light"].keys() == set(OldLight._fields)
    assert about["arrays"]["cast"][1][0] == storage.RANK["cast"] < 96
    kept = relight.Subject.load(tmp_path / "kept.safetensors")
    field, exact = (one.record.maps.field.in_row_order() for one in (kept, subject))
    torch.testing.assert_close(field.residual, exact.residual, rtol=0, atol=0.05)


@pytest.mark.parametrize("share", [0, 0.0001, 0.5, 0.999])
def test_a_truncated_file_is_named(subject, tmp_path, share):
    path = tmp_path / "kept.safetensors"
    subject.save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(ValueError, match=r"kept\.safetensors: is damaged or truncated"):
        relight.Subject.load(path)


def test_a_flipped_bit_is_noticed(subject, tmp_path):
    path = tmp_path / "kept.safetensors"
    subject.save(path)
    whole = bytearray(path.read_bytes())
    for place in (len(whole) // 2, len(whole) - 3):
        flipped = bytearray(whole)
        flipped[place] ^= 16
        path.write_bytes(flipped)
        with pytest.raises(ValueError, match=r"kept\.safetensors: is damaged"):
            relight.Subject.load(path)


def test_what_is_no_analysis_is_refused(subject, tmp_path):
    path = tmp_path / "kept.safetensors"
    with pytest.raises(FileNotFoundError, match=r"kept\.safetensors: no such file"):
        relight.Subject.load(path)
    save_file({"weight": np.zeros(3, np.float32)}, path)
    with pytest.raises(ValueError, match=r"kept\.safetensors: is no analysis by relight"):
        relight.Subject.load(path)
    about = {"format": 99, "arrays": {}, "provenance": {}}
    save_file({}, path, {"relight": json.dumps(about)})
    with pytest.raises(ValueError, match=f"has format 99, expected {storage.FORMAT}"):
        relight.Subject.load(path)
    save_file({}, path, {"relight": json.dumps(about | {"format": storage.FORMAT})})
    with pytest.raises(ValueError, match=r"kept\.safetensors: is damaged"):
        relight.Subject.load(path)
    path.write_bytes(b"\x80\x05pickled")
    with pytest.raises(ValueError, match="is damaged or truncated, or no safetensors file"):
        relight.Subject.load(path)
    with pytest.raises(ValueError, match=r"kept\.npz: expected a file name that ends in \.safetensors"):
        subject.save(tmp_path / "kept.npz")


def test_a_small_file_that_says_it_is_large_takes_no_memory(subject, tmp_path):
    path = tmp_path / "kept.safetensors"
    subject.save(path)
    with safe_open(path, "np") as file:
        about = json.loads(file.metadata()["relight"])
        tensors = {name: file.get_tensor(name) for name in about["arrays"]}
    about["arrays"].pop("matte", None)
    one_too_large = json.loads(json.dumps(about))
    one_too_large["arrays"]["colour"][1] = [3, 10**12]
    save_file(tensors, path, {"relight": json.dumps(one_too_large)})
    with pytest.raises(DamagedFileError, match=r"colour is <f2 \(3, 1000000000000\), expected <f2 <u2 \(3, "):
        relight.Subject.load(path)
    side = 8000  # a plate that could be, in a file that is too small for it
    about |= {"size": [side, side], "corner": [0, 0], "box": [side, side]}
    about["camera"]["size"] = [side, side]
    for name, shape in {"inside": [side**2 // 8], "coverage": [side**2], "colour": [3, side**2]}.items():
        about["arrays"][name][1] = shape
    save_file(tensors, path, {"relight": json.dumps(about)})
    with pytest.raises(DamagedFileError, match=r"a file of \d+ bytes claims arrays of \d+"):
        relight.Subject.load(path)


def test_arrays_are_compressed_without_loss():
    random = np.random.default_rng(0)
    for dtype in (np.uint8, np.uint16, np.float16, np.float32):
        array = (random.random((3, 500)) * 250).astype(dtype)
        data = array_codec.compress(array)
        back = array_codec.decompress(data, dtype, array.shape)
        np.testing.assert_array_equal(back, array)
        with pytest.raises(ValueError, match="holds"):
            array_codec.decompress(data, dtype, (3, 501))
        with pytest.raises(ValueError, match="compressed bytes of"):
            array_codec.decompress(data[:-1].copy(), dtype, array.shape)


def test_negative_zero_is_zero_when_it_is_shortened():
    values = torch.tensor([[-0.0, 0.0, 0.5]])
    np.testing.assert_allclose(
        storage.lengthened(storage.shortened(values, most=2)), [[0, 0, 0.5]], rtol=0.02
    )


def test_pipes_and_devices_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.safetensors")
    for path in (tmp_path / "pipe.safetensors", "/dev/zero"):
        with pytest.raises(UnsupportedFileError, match="no regular file"):
            relight.Subject.load(path)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("corner", [0.5, 1], "measures in pixels are no whole numbers"),
        ("corner", [-1, 1], r"a box of .* pixels at \(-1, 1\) is not in a plate of"),
        ("size", [20, 2000], "is not in a plate of"),
        ("size", [200, 1600], "the camera's plate is one of"),
        ("size", [10**7, 10**7], "is too large"),
        ("arrays", ["colour"], ""),
        ("exposure", 0, "expected measures above zero, got 0"),
        ("scale", float("nan"), "a measure is not finite"),
        ("centre", ["a", "b"], ""),
        ("camera", None, ""),
    ],
)
def test_odd_measures_are_refused(subject, tmp_path, name, value, message):
    path = tmp_path / "kept.safetensors"
    subject.save(path)
    with safe_open(path, "np") as file:
        about = json.loads(file.metadata()["relight"])
        tensors = {name: file.get_tensor(name) for name in about["arrays"]}
    save_file(tensors, path, {"relight": json.dumps(about | {name: value})})
    with pytest.raises(ValueError, match=rf"kept\.safetensors: is damaged: .*{message}"):
        relight.Subject.load(path)


def test_other_weights_are_said(subject, tmp_path):
    subject.save(tmp_path / "kept.safetensors", provenance={"weights": ["other", "weights"]})
    with pytest.warns(UserWarning, match=r"kept\.safetensors: was analysed with other weights"):
        relight.Subject.load(tmp_path / "kept.safetensors")
