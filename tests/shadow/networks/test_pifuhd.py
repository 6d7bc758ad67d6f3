"""A generator with random parameters, saved in the layout of PIFuHD's own checkpoint."""

import os
import warnings

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from helpers.pifuhd_checkpoints import narrow, save
from helpers.sphere import sphere

import shadow
from shadow import normals, visibility
from shadow.data import records
from shadow.networks import pifuhd
from shadow.networks.pifuhd import FrontNormals
from shadow.training import loop, recipes, tasks

BLOCKS = range(16, 25)
KEYS = [
    f"netG.netF.model.{layer}.{kind}"
    for layer in (
        *(1, 4, 7, 10, 13),
        *(f"{block}.conv_block.{conv}" for block in BLOCKS for conv in (1, 5)),
        *(25, 28, 31, 34, 38),
    )
    for kind in ("weight", "bias")
]


@pytest.fixture
def checkpoint(tmp_path):
    return save(tmp_path / "pifuhd.pt", narrow())


def test_the_generator_is_pifuhds():
    with torch.device("meta"):
        network = FrontNormals()
    assert sum(parameter.numel() for parameter in network.parameters()) == 182_443_267
    assert [f"netG.netF.{key}" for key in network.state_dict()] == KEYS
    assert network.model[20].conv_block[1].weight.shape == (1024, 1024, 3, 3)


@pytest.mark.parametrize("legacy", [False, True])
def test_a_checkpoint_in_either_format_loads_with_equal_parameters(tmp_path, legacy):
    """Both of PyTorch's file formats: the original checkpoint is as old as 2020."""
    parameters = narrow(1)
    network = normals.load(save(tmp_path / "mine.pt", parameters, legacy))
    assert not network.training
    for key, value in network.state_dict().items():
        assert torch.equal(value, parameters[f"netG.netF.{key}"])


def test_the_layers_do_what_pix2pixhds_do(checkpoint):
    """Written out from the keys: padding, strides, normalisation and activations of the global generator."""
    parameters = torch.load(checkpoint, weights_only=False)["model_state_dict"]

    def of(layer):
        return parameters[f"netG.netF.model.{layer}.weight"], parameters[f"netG.netF.model.{layer}.bias"]

    def padded(x, layer, pad):
        return F.conv2d(F.pad(x, (pad,) * 4, mode="reflect"), *of(layer))

    image = torch.rand(1, 3, 64, 64) * 2 - 1
    x = F.relu(F.instance_norm(padded(image, 1, 3)))
    for layer in (4, 7, 10, 13):
        x = F.relu(F.instance_norm(F.conv2d(x, *of(layer), stride=2, padding=1)))
    for block in BLOCKS:
        h = F.relu(F.instance_norm(padded(x, f"{block}.conv_block.1", 1)))
        x = x + F.instance_norm(padded(h, f"{block}.conv_block.5", 1))
    for layer in (25, 28, 31, 34):
        up = F.conv_transpose2d(x, *of(layer), stride=2, padding=1, output_padding=1)
        x = F.relu(F.instance_norm(up))
    expected = torch.tanh(padded(x, 38, 3))
    with torch.no_grad():
        torch.testing.assert_close(normals.load(checkpoint)(image), expected, atol=1e-4, rtol=1e-4)


class Painter(FrontNormals):
    """Answers with what it was shown."""

    def forward(self, image):
        self.seen = image
        return 0.6 * image


def test_it_sees_the_displayed_picture_on_grey_and_black_beyond_the_frame():
    rgb = torch.full((3, 90, 60), 0.2140411)  # 0.5 in sRGB
    rgb[0], mask = 4.0, torch.zeros(90, 60)
    mask[30:, 20:50] = 1  # cut by the lower edge
    network = Painter(2)
    vectors = network.normals(rgb, mask)
    seen = network.seen[0]
    assert seen.shape == (3, 512, 512)
    torch.testing.assert_close(seen[:, 256, 256], torch.tensor([1.0, 0.0, 0.0]), atol=1e-4, rtol=0)  # clipped
    torch.testing.assert_close(seen[:, 256, 60], torch.zeros(3), atol=1e-6, rtol=0)  # the grey behind
    torch.testing.assert_close(seen[:, 505, 256], torch.full((3,), -1.0))  # beyond the plate
    # The person is centred, and as large in the square as in PIFuHD's crop.
    rows = torch.nonzero(seen[0, :, 256] > 0.5)[:, 0]
    assert int(rows[0] + rows[-1]) == pytest.approx(511, abs=2)
    assert len(rows) == pytest.approx(512 / 1.2, abs=3)
    # Back on the plate: unit length, where they were, nothing outside.
    torch.testing.assert_close(vectors[:, 60, 35], torch.tensor([1.0, 0.0, 0.0]), atol=1e-3, rtol=0)
    torch.testing.assert_close(vectors.norm(dim=0), mask, atol=1e-4, rtol=0)


def test_the_public_call(checkpoint, person):
    rgb, mask = person
    found = shadow.infer_normals(rgb, mask, model=checkpoint)
    assert found.shape == rgb.shape
    assert found.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(found[mask > 0], axis=1), 1, atol=1e-4)
    assert abs(found[mask == 0]).max() == 0
    as_torch = shadow.infer_normals(*map(torch.from_numpy, person), model=normals.load(checkpoint))
    np.testing.assert_allclose(as_torch, found, atol=1e-5)


class Code:
    def __reduce__(self):
        return os.mkdir, ("executed",)


@pytest.mark.parametrize("legacy", [False, True])
def test_pickled_code_is_not_run(tmp_path, here, legacy):
    save("code.pt", narrow(), legacy, callback=Code())
    with pytest.raises(ValueError, match=r"code.pt contains pickled code, \w+.mkdir, which is not run"):
        pifuhd.load("code.pt")
    assert not (tmp_path / "executed").exists()


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("share", [0, 0.5, 0.999])
def test_a_truncated_file_is_named(tmp_path, legacy, share):
    path = save(tmp_path / "short.pt", narrow(), legacy)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(ValueError, match=r"short.pt is not a PyTorch checkpoint, or is truncated"):
        pifuhd.load(path)


def test_weights_that_are_not_finite_are_refused(tmp_path):
    parameters = narrow()
    parameters["netG.netF.model.1.bias"][0] = float("nan")
    with pytest.raises(ValueError, match=r"nan.pt is damaged: model.1.bias holds NaN or infinite values"):
        pifuhd.load(save(tmp_path / "nan.pt", parameters))


def test_other_files_are_named(tmp_path):
    (tmp_path / "text.pt").write_text("not found")
    with pytest.raises(ValueError, match=r"text.pt is not a PyTorch checkpoint"):
        pifuhd.load(tmp_path / "text.pt")
    with pytest.raises(FileNotFoundError):
        pifuhd.load(tmp_path / "absent.pt")
    torch.save({"weight": torch.zeros(3)}, tmp_path / "other.pt")
    with pytest.raises(ValueError, match="has no front-normal generator"):
        pifuhd.load(tmp_path / "other.pt")


def test_a_missing_or_odd_key_is_named(tmp_path):
    parameters = narrow()
    del parameters["netG.netF.model.20.conv_block.5.weight"]
    with pytest.raises(
        ValueError, match=r"does not contain PIFuHD's generator.*model\.20\.conv_block\.5\.weight"
    ):
        pifuhd.load(save(tmp_path / "missing.pt", parameters))
    parameters = narrow() | {"netG.netF.model.28.bias": torch.zeros(3)}
    with pytest.raises(ValueError, match=r"size mismatch for model\.28\.bias"):
        pifuhd.load(save(tmp_path / "odd.pt", parameters))


@pytest.mark.parametrize("key", ["model_state_dict", "state_dict"])
def test_the_generators_of_icon_and_econ_are_refused(tmp_path, key):
    """They also take the normals of a fitted body: 6 channels. ICON's file is Lightning's: `state_dict`."""
    parameters = narrow() | {"netG.netF.model.1.weight": torch.zeros(2, 6, 7, 7)}
    torch.save({key: parameters}, tmp_path / "normal.pt")
    with pytest.raises(ValueError, match=r"takes 6 channels, expected 3.* ICON and ECON"):
        pifuhd.load(tmp_path / "normal.pt")


@pytest.mark.slow
def test_our_networks_learn_from_its_normals(checkpoint, tmp_path):
    records.write(tmp_path / "ball.npz", sphere())
    recipe = recipes.Recipe(steps=1, size=128, batch=2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        path = loop.fit(
            tasks.SHADOW, recipe, [tmp_path], tmp_path / "out", estimator=str(checkpoint), workers=0
        )
        field = visibility.load(path)
        rgb, mask = np.full((128, 96, 3), 0.2, np.float32), np.ones((128, 96), np.float32)
        visibility.infer(rgb, mask, [[0, 0, 1]], normals=checkpoint, model=path)
    assert field.origin.recipe["normals"] == "pifuhd"
    with pytest.warns(UserWarning, match="'pifuhd'"):
        visibility.infer(rgb, mask, [[0, 0, 1]], model=path)


@pytest.mark.parametrize(
    "content",
    [
        [1, 2],
        torch.zeros(2),
        {1: torch.zeros(2)},
        {"model_state_dict": None},
        {"model_state_dict": [torch.zeros(2)]},
        {"model_state_dict": {1: torch.zeros(2)}},
        {"model_state_dict": {"netG.netF.model.1.weight": 3}},
        {"model_state_dict": {"netG.netF.model.1.weight": torch.tensor(1.0)}},
    ],
)
def test_odd_checkpoints_are_refused_in_one_line(tmp_path, content):
    torch.save(content, tmp_path / "odd.pt")
    with pytest.raises(ValueError, match=r"^normals: .*odd\.pt has no front-normal generator: .*$"):
        normals.load(tmp_path / "odd.pt")
