"""One analysis of an image serves all that is asked of it."""

import copy
import pickle
import re
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch

import relight
import shading
import shadow
from relight import subject as subject_module
from relight.errors import DamagedFileError
from shading.diffuse import ShadingField
from shadow import analysis, inputs
from shadow.networks import checkpoints
from shadow.networks.field import VisibilityField
from shadow.networks.precision import using

LIGHTS = np.float32([[-0.6, 0.4, 0.7], [0.5, 0.5, 0.7], [0.8, 0.0, -0.6]])


@pytest.fixture
def forwards(monkeypatch):
    """The forwards of both networks, as they happen."""
    seen = []
    for network in (VisibilityField, ShadingField):
        forward = network.forward

        def counted(self, *arguments, forward=forward, **more):
            seen.append(type(self).__name__)
            return forward(self, *arguments, **more)

        monkeypatch.setattr(network, "forward", counted)
    return seen


def test_everything_of_one_image_costs_two_forwards(person, forwards):
    found = shading.analyse(*person)
    assert found.normals.shape == found.albedo.shape == person[0].shape
    assert found.visibility(LIGHTS).shape == found.shading(LIGHTS).shape == (3, *person[1].shape)
    found.shading(LIGHTS[:1])
    assert forwards == ["VisibilityField", "ShadingField"]


def test_a_subject_costs_two_forwards(person, forwards):
    subject = relight.Subject(*person)
    subject.relit([relight.DirectionalLight(), relight.DirectionalLight(azimuth=120)])
    assert subject.albedo.shape == subject.normals.shape
    assert len(forwards) == 2


def test_the_functions_are_the_analysis(person):
    found = shading.analyse(*person)
    np.testing.assert_array_equal(found.normals, shadow.infer_normals(*person))
    np.testing.assert_array_equal(found.visibility(LIGHTS), shadow.infer(*person, LIGHTS))
    np.testing.assert_array_equal(found.shading(LIGHTS), shading.infer(*person, LIGHTS))
    np.testing.assert_array_equal(found.albedo, shading.infer_albedo(*person))
    visible = shadow.analyse(*person)
    np.testing.assert_array_equal(visible.normals, found.normals)
    np.testing.assert_array_equal(visible.visibility(LIGHTS), found.visibility(LIGHTS))


def test_one_pass_sees_the_photograph_alone(person, tmp_path):
    once, twice, default = (shadow.analyse(*person, passes=passes) for passes in (1, 2, None))
    np.testing.assert_array_equal(twice.normals, default.normals)
    difference = np.abs(once.normals - twice.normals)
    assert 1e-3 < difference[person[1] > 0.5].mean() < 0.1
    with pytest.raises(ValueError, match="passes: expected 1 or 2 with a field"):
        shadow.analyse(*person, passes=3)


def test_depth_is_relative_and_away_from_the_camera(person, tmp_path):
    """Of weights with depth; those from before there was any say nothing."""
    rgb, mask = person
    network = VisibilityField(128)
    checkpoints.save(tmp_path / "old.safetensors", network, "field", {"size": 128}, {})
    assert shadow.analyse(rgb, mask, model=tmp_path / "old.safetensors").depth is None
    network = VisibilityField(128, depth=True)
    torch.nn.init.normal_(network.backbone.head.weight[-4:], std=0.5)
    checkpoints.save(tmp_path / "deep.safetensors", network, "field", {"size": 128, "depth": True}, {})
    found = shadow.analyse(rgb, mask, model=tmp_path / "deep.safetensors")
    assert found.depth.shape == mask.shape
    assert found.depth.dtype == np.float32
    assert not found.depth[mask == 0].any()
    assert found.depth[mask > 0].std() > 0.01
    assert found.canvas_depth.sum() == pytest.approx(0, abs=0.05)
    raised = shadow.analyse(rgb, mask, model=_nearer(network, tmp_path / "near.safetensors"))
    np.testing.assert_allclose(raised.depth, found.depth, atol=0.05)  # an offset does not count


def _nearer(network, path):
    """The weights of a field whose depths are all half a height less."""
    torch.nn.init.constant_(network.backbone.head.bias[-4:], -0.5)
    checkpoints.save(path, network, "field", {"size": 128, "depth": True}, {})
    return path


def test_a_tensor_gives_tensors(person):
    rgb, mask = map(torch.from_numpy, person)
    found = shading.analyse(rgb, mask)
    maps = found.normals, found.albedo, found.visibility(torch.from_numpy(LIGHTS)), found.shading(LIGHTS)
    assert all(isinstance(image, torch.Tensor) and image.dtype == torch.float32 for image in maps)
    np.testing.assert_array_equal(found.normals.numpy(), shadow.infer_normals(*person))


@pytest.mark.parametrize("device", ["gpu9", "cuda:99", 3.5])
@pytest.mark.parametrize(
    "call",
    [
        shadow.analyse,
        shading.analyse,
        relight.Subject,
        lambda *image, device: relight.apply(image[0], [], mask=image[1], device=device),
        lambda *image, device: relight.render(
            image[0], relight.DirectionalLight(), mask=image[1], device=device
        ),
    ],
)
def test_an_unknown_device_is_named(person, call, device):
    with pytest.raises(
        TypeError if device == 3.5 else ValueError,
        match=r"device: (expected a device of this machine, |.* is not available: .* use )cpu",
    ):
        call(*person, device=device)


def test_a_network_that_is_shared_stays_where_it_is():
    assert inputs.device("device", None) is None
    assert analysis.load() is analysis.load(device=torch.device("cpu"))
    on_meta = analysis.load(device="meta")  # stands for any other device: tensors without memory
    assert {parameter.device.type for parameter in on_meta.parameters()} == {"meta"}
    assert {parameter.device.type for parameter in analysis.load().parameters()} == {"cpu"}


@pytest.mark.slow
def test_eight_threads_make_what_one_makes(person):
    rgb, mask = person
    plates = [np.roll(rgb, shift, axis=2) * np.float32(0.5 + shift / 8) for shift in range(8)]
    light = relight.DirectionalLight(azimuth=-50, elevation=20)
    alone = [relight.apply(plate, light, mask=mask) for plate in plates]
    start = threading.Barrier(8)

    def make(plate):
        start.wait()
        return relight.apply(plate, light, mask=mask)

    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(8) as pool:
            together = list(pool.map(make, plates))
    finally:
        sys.setswitchinterval(0.005)
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-6)


def test_a_subject_can_be_pickled(person, tmp_path):
    subject = relight.Subject(*person)
    packed = pickle.dumps(subject)
    subject.save(tmp_path / "kept.safetensors")
    assert len(packed) <= (tmp_path / "kept.safetensors").stat().st_size + 2 * 2**20
    again, light = pickle.loads(packed), relight.DirectionalLight(azimuth=-40)
    assert np.sqrt(((again.relit(light) - subject.relit(light)) ** 2).mean()) < 0.002  # as `save` says
    same = relight.Subject.load(tmp_path / "kept.safetensors").relit(light)
    np.testing.assert_array_equal(again.relit(light), same)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(again)).matte, again.matte)
    for copied in (copy.copy(subject), copy.deepcopy(subject)):  # in this process nothing is lost
        np.testing.assert_array_equal(copied.relit(light), subject.relit(light))


def test_a_damaged_pickle_is_named(person):
    _, (kind, packed) = relight.Subject(*person).__reduce__()
    for damaged in (packed[:99], packed[:-40] + bytes(40), b"", b"\xff" * 99):
        with pytest.raises(
            DamagedFileError, match=r"a pickled Subject is damaged|a pickled Subject: is damaged"
        ):
            pickle.loads(pickle.dumps(_Stored(kind, damaged)))


class _Stored:
    """What unpickles as a subject of these bytes."""

    def __init__(self, *given):
        self.given = given

    def __reduce__(self):
        return subject_module.unpickled, self.given


def test_a_subject_tells_what_it_is(person):
    assert re.fullmatch(
        r"<Subject of 160 x 200 pixels, [\d.]+ % covered, weights \w{8}, \w{8}>",
        repr(relight.Subject(*person)),
    )


def test_bfloat16_is_around_the_networks_alone(person):
    rgb, mask = person
    found = []
    for precision in ("bfloat16", "float32"):
        with using(precision):
            found.append(shading.analyse(rgb, mask))
    half, full = found
    inside = mask > 0.5
    cosine = (half.normals * full.normals).sum(axis=-1)[inside].clip(-1, 1)
    assert np.degrees(np.arccos(cosine)).mean() < 1
    for one, other in ((half.visibility(LIGHTS), full.visibility(LIGHTS)), (half.albedo, full.albedo)):
        assert 0 < np.abs(one - other).max() < 0.2
        assert np.sqrt(((one - other) ** 2).mean()) < 0.01


def test_a_speck_in_the_matte_changes_no_normals(person):
    rgb, mask = person
    wide = np.zeros((mask.shape[0], 3 * mask.shape[1], 3), np.float32) + 0.2
    matte = np.zeros(wide.shape[:2], np.float32)
    wide[:, : mask.shape[1]], matte[:, : mask.shape[1]] = rgb, mask
    speck = matte.copy()
    speck[2:5, -5:-2] = 1
    inside = matte > 0.5
    with pytest.warns(UserWarning, match="small parts far from the person"):
        found = shadow.infer_normals(wide, speck)
    expected = shadow.infer_normals(wide, matte)
    assert np.abs(found - expected)[inside].mean() < 0.01
