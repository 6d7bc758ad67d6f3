import numpy as np
import pytest
import torch
from helpers import ROOT

import relight
from relight.matting import networks
from relight.matting.cutout_network import CutoutNetwork, is_one
from relight.matting.refine import encoded_srgb
from shadow.data.rough_masks import rough_mask
from shadow.networks import checkpoints
from shadow.networks.matting import MattingNetwork

NARROW = {"widths": (8,) * 5, "encoder": (1,) * 5, "decoder": (1,) * 4}


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """A network that answers with its mask."""
    path = tmp_path_factory.mktemp("weights") / "new.safetensors"
    checkpoints.save(path, MattingNetwork(size=512, **NARROW), "matting", {"size": 512, **NARROW}, {})
    return path


def square(size, turned=False):
    mask = np.zeros(size, np.float32)
    mask[size[0] // 4 : -size[0] // 4, size[1] // 4 : -size[1] // 4] = 1
    return mask


@pytest.mark.parametrize("size", [(96, 64), (700, 300), (64, 1100)])
def test_a_matte_has_the_size_of_its_crop(weights, size):
    mask = square(size)
    found = CutoutNetwork(str(weights))(np.full((*size, 3), 0.5, np.float32), mask)
    assert found.shape == size
    assert ((found > 0.5) == (mask > 0.5)).mean() > 0.97
    assert found.min() >= 0
    assert found.max() <= 1


def test_a_mirrored_picture_has_the_mirrored_matte(weights):
    torch.manual_seed(0)
    network = CutoutNetwork(str(weights))
    crop, mask = np.random.default_rng(0).random((128, 96, 3), np.float32), square((128, 96))
    mask[:, :30] = 0
    first = network(crop, mask)
    mirrored = network(crop[:, ::-1], mask[:, ::-1])[:, ::-1]
    np.testing.assert_allclose(first, mirrored, atol=2e-2)
    assert ((first > 0.5) == (mask > 0.5)).mean() > 0.97  # what is mirrored is turned back


def overlap(matte, person):
    return ((matte > 0.5) & person).sum() / ((matte > 0.5) | person).sum()


def test_the_shipped_network_mends_masks():
    """The bundled person before a plain wall, with masks that lack parts and have pieces of the wall."""
    picture = relight.read(ROOT / "examples" / "person.png")
    side = max(picture.shape[:2]) * 3 // 2
    canvas = np.zeros((side, side, 4), np.float32)
    top, left = ((side - length) // 2 for length in picture.shape[:2])
    canvas[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    person = canvas[..., 3] > 0.5
    crop = encoded_srgb(canvas[..., :3] + (1 - canvas[..., 3:]) * np.float32([0.5, 0.46, 0.4]))
    network, before, after = CutoutNetwork(), [], []
    for seed in range(6):
        mask = rough_mask(torch.from_numpy(canvas[..., 3].copy()), np.random.default_rng(seed)).numpy()
        before.append(overlap(mask, person))
        after.append(overlap(network(crop, mask), person))
    assert np.mean(after) > np.mean(before) + 0.02


def test_which_names_are_networks_of_this_kind():
    assert is_one("matting")
    assert is_one("runs/matting.safetensors")
    assert not is_one("isnet.onnx")


def test_such_a_network_takes_no_options(weights):
    with pytest.raises(ValueError, match="takes no options"):
        networks.load("auto", silhouette=str(weights), size=512)
