"""Training photographs: where they are made, and the tones and colours that cameras give them."""

import numpy as np
import pytest
import torch
from helpers.sphere import sphere

from shadow.data import photographs
from shadow.data.photographs import PictureStyle, photograph, random_style, sample

pytest.importorskip("kornia")


@pytest.fixture
def picture():
    return torch.from_numpy(np.random.default_rng(0).uniform(0, 1, (3, 64, 48)).astype(np.float32))


def test_the_default_style_changes_nothing(picture):
    torch.testing.assert_close(PictureStyle()(picture), picture)
    mask, rngs = torch.ones(1, 64, 48), (np.random.default_rng(1) for _ in range(2))
    plain, styled = (
        photograph(picture, mask, rng, style) for rng, style in zip(rngs, (None, PictureStyle()), strict=True)
    )
    torch.testing.assert_close(plain, styled)


def test_contrast_is_an_s_from_black_to_white():
    grey = torch.linspace(0, 1, 33).expand(3, 4, 33)
    curve = PictureStyle(contrast=6)(grey)[0, 0]
    assert (curve.diff() > 0).all()
    torch.testing.assert_close(curve[[0, 16, 32]], torch.tensor([0, 0.5, 1.0]))
    assert curve[8] < 0.2  # darker shadows
    assert curve[24] > 0.8  # lighter highlights
    slope = float(curve[17] - curve[15]) * 16
    assert slope == pytest.approx(1.66, abs=0.02)


def test_saturation_keeps_grey_and_luma(picture):
    strong = PictureStyle(saturation=1.3)
    grey = torch.linspace(0, 1, 33).expand(3, 4, 33)
    torch.testing.assert_close(strong(grey), grey)
    muted = 0.4 + 0.2 * picture  # far from clipping
    weights = torch.tensor([0.2126, 0.7152, 0.0722])[:, None, None]
    torch.testing.assert_close((strong(muted) * weights).sum(0), (muted * weights).sum(0))
    colourful, plain = strong(muted), muted
    np.testing.assert_allclose(
        np.ptp(colourful.numpy(), axis=0), 1.3 * np.ptp(plain.numpy(), axis=0), rtol=1e-4
    )


def test_local_contrast_raises_edges_and_keeps_plain_areas():
    step = torch.full((3, 128, 96), 0.4)
    step[..., 48:] = 0.6
    sharper = PictureStyle(local_contrast=0.5)(step)
    torch.testing.assert_close(sharper[..., [0, 95]], step[..., [0, 95]], atol=1e-3, rtol=0)
    assert (sharper[..., 47] < 0.36).all()
    assert (sharper[..., 48] > 0.64).all()


def test_random_styles_differ_and_keep_pictures_in_range(picture):
    rng = np.random.default_rng(0)
    styles = [random_style(rng) for _ in range(20)]
    assert len(set(styles)) == 20
    for style in styles:
        styled = style(picture)
        assert styled.shape == picture.shape
        assert 0 <= styled.min() <= styled.max() <= 1


@pytest.mark.parametrize("augment", [False, True])
def test_the_window_in_which_a_photograph_is_made_holds_all_of_the_subject(clean, monkeypatch, augment):
    draw = lambda: [  # noqa: E731
        sample(sphere(radius=0.6), np.random.default_rng(seed), (128, 96), 4, augment) for seed in range(12)
    ]
    found = draw()
    whole_canvas = lambda _record, _matrix, size: tuple(slice(0, length) for length in size)  # noqa: E731
    monkeypatch.setattr(photographs, "window_of", whole_canvas)
    for ours, whole in zip(found, draw(), strict=True):
        assert ours.keys() == whole.keys()
        for key in ours:
            torch.testing.assert_close(ours[key], whole[key], rtol=0, atol=5e-3, msg=f"{key} differs")
