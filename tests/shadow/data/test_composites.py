import numpy as np
import pytest
import torch
from helpers.cutouts import disc, write_sources

pytest.importorskip("kornia")

from shadow.data import composites
from shadow.data.backdrops import Backdrops
from shadow.data.composites import Composites
from shadow.data.rough_masks import blurred, rough_mask
from shadow.data.things import thing

SIDE = 96


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    return write_sources(tmp_path_factory.mktemp("sources"))


@pytest.fixture(scope="module")
def pictures(sources):
    people, behind = sources
    made = Composites([people], Backdrops(behind), 0, SIDE, 0, 40)
    return [made[number] for number in range(len(made))]


def test_pictures_are_within_their_ranges(pictures):
    for picture in pictures:
        assert picture.rgb.shape == (3, SIDE, SIDE)
        for plane in picture:
            assert plane.shape[1:] == (SIDE, SIDE)
            assert plane.min() >= 0
            assert plane.max() <= 1
            assert torch.isfinite(plane).all()


def test_everybody_is_in_their_picture(pictures):
    assert all(picture.alpha.sum() > 0.02 * SIDE**2 for picture in pictures)


def test_rough_masks_are_wrong_but_of_the_same_person(pictures):
    overlaps = []
    for picture in pictures:
        rough, true = picture.mask > 0.5, picture.alpha > 0.5
        overlaps.append(float((rough & true).sum() / (rough | true).sum()))
    assert 0.6 < np.mean(overlaps) < 0.97


def test_most_rough_masks_are_those_of_a_pose_network_that_sees_somebody(sources, pictures):
    people, behind = sources

    def mask(rgb, matte):
        return None if rgb.mean() < 0.3 else matte.round() / 2

    posed = Composites([people], Backdrops(behind), 0, SIDE, 0, 40, pose_mask=mask)
    number = 0
    for made, other in zip((posed[index] for index in range(40)), pictures, strict=True):
        torch.testing.assert_close(made.rgb, other.rgb)
        torch.testing.assert_close(made.alpha, other.alpha)
        number += float(made.mask.max()) == 0.5
        assert float(made.mask.max()) == 0.5 or torch.equal(made.mask, other.mask)
    assert 8 < number < 36


def test_a_person_whom_the_frame_cuts_is_cut_there():
    half = disc(radius=24)
    half = composites.Cutout(half.colour[:32], half.alpha[:32], [])
    for seed in range(5):
        rng = np.random.default_rng(seed)
        frame = composites.framed(rng, half, SIDE)
        layer, _ = composites.Frame(*frame).placed(rng, half)
        valid = composites.Frame(*frame).valid()[0]
        last = int(torch.nonzero(valid.any(dim=1)).max())
        assert layer[3, last].max() > 0.5
        assert not layer[3][valid == 0].any()


def test_a_picture_depends_on_seed_and_number_alone(sources):
    people, behind = sources
    first = Composites([people], Backdrops(behind), 3, SIDE, 0, 10)[7]
    later = Composites([people], Backdrops(behind), 3, SIDE, 5, 5)[2]
    torch.testing.assert_close(first.rgb, later.rgb)
    torch.testing.assert_close(first.mask, later.mask)


def test_folders_without_pictures_are_refused(tmp_path, sources):
    with pytest.raises(FileNotFoundError, match="no photographs"):
        Backdrops(tmp_path)
    with pytest.raises(FileNotFoundError, match="cutouts: none"):
        Composites([tmp_path], Backdrops(sources[1]), 0, SIDE, 0, 1)


def test_a_thing_is_in_the_hand(sources):
    backdrops = Backdrops(sources[1])
    for seed in range(20):
        layer = thing(np.random.default_rng(seed), SIDE, 40.0, 50.0, 6.0, backdrops)
        assert layer[3].max() > 0.5
        rows, columns = torch.nonzero(layer[3] > 0.3).T
        nearest = torch.hypot(rows + 0.5 - 50, columns + 0.5 - 40).min()
        assert nearest < 3 * 6
        assert (layer[:3] >= 0).all()


def test_a_wide_blur_on_fewer_pixels_is_the_same():
    plane = torch.zeros(1, 96, 96)
    plane[:, 40:60, 30:70] = 1
    wide = blurred(plane, 5.0)
    offsets = torch.arange(-15, 16)
    kernel = torch.exp(-0.5 * (offsets / 5.0) ** 2)
    kernel = (kernel / kernel.sum()).view(1, 1, -1, 1)
    exact = torch.nn.functional.conv2d(plane[None], kernel, padding=(15, 0))
    exact = torch.nn.functional.conv2d(exact, kernel.transpose(2, 3), padding=(0, 15))[0]
    assert (wide - exact).abs().max() < 0.03


def test_a_neighbours_piece_may_be_in_the_mask():
    alpha, neighbours = torch.zeros(64, 64), torch.zeros(64, 64)
    alpha[20:60, 8:24], neighbours[20:60, 26:44] = 1, 1
    inside = [
        float(rough_mask(alpha, np.random.default_rng(seed), neighbours)[:, 30:].max()) for seed in range(40)
    ]
    assert 2 < sum(value > 0.3 for value in inside) < 38
