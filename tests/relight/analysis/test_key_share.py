import numpy as np
import pytest
import torch

from relight.analysis.key_share import by_colour

WARM, COOL = (0.0, 0.0), (-0.6, 0.7)  # log R/G and log B/G of the key, and of the other light relative to it
SIZE = 96


def lit(share):
    """Log-chromaticity (2, h, w) of a grey surface of which the key gives a share (h, w) of the light."""
    other = torch.tensor(COOL).view(2, 1, 1)
    return (share + (1 - share) * other.exp()).log()


def found(start, colours, luminance=None, known=None):
    flat = torch.full((SIZE, SIZE), 0.5)
    return by_colour(
        start,
        COOL,
        colours,
        torch.ones(SIZE, SIZE),
        flat if luminance is None else luminance,
        torch.ones(SIZE, SIZE, dtype=torch.bool) if known is None else known,
    )


def edge(soft):
    """A share that falls from 0.8 to 0.1 across the middle, over `soft` pixels."""
    x = torch.arange(SIZE) - SIZE / 2 + 0.5
    return (0.45 - 0.7 * (x / max(soft, 1)).clamp(-0.5, 0.5)).expand(SIZE, SIZE).contiguous()


def test_the_share_follows_the_colours():
    truth, start = edge(1), edge(40)
    share = found(start, lit(truth))
    assert (share - truth).abs().mean() < 0.7 * (start - truth).abs().mean()


def test_a_share_that_explains_the_colours_stays():
    truth = edge(20)
    torch.testing.assert_close(found(truth, lit(truth)), truth, rtol=0, atol=0.02)


@pytest.mark.parametrize("told_by", ["lightness", "colour"])
def test_another_material_is_no_other_light(told_by):
    """A white stripe in neutral light beside blue cloth of another lightness, or of a much stronger blue."""
    share = torch.full((SIZE, SIZE), 0.5)
    stripe = torch.arange(SIZE) < SIZE // 2
    step = {"lightness": 0.3, "colour": 2.5}[told_by]
    colours = lit(share) + torch.where(stripe, 0.0, 1.0) * torch.tensor([-0.1, step]).view(2, 1, 1)
    luminance = torch.where(stripe, 0.8, 0.2 if told_by == "lightness" else 0.7).expand(SIZE, SIZE)
    torch.testing.assert_close(found(share, colours, luminance), share, rtol=0, atol=0.06)


def test_it_stays_within_bounds_and_is_the_same_each_time_and_at_each_place():
    rng = np.random.default_rng(0)
    known = torch.zeros(SIZE, SIZE, dtype=torch.bool)
    known[9:60, 12:60] = True
    start, colours = torch.from_numpy(np.float32(rng.random((SIZE, SIZE)))), torch.zeros(2, SIZE, SIZE)
    colours[:] = torch.from_numpy(rng.normal(0, 2, (2, SIZE, SIZE)))
    share = found(start, colours, known=known)
    assert torch.isfinite(share).all()
    assert 0 <= share.min() <= share.max() <= 1
    torch.testing.assert_close(found(start, colours, known=known), share, rtol=0, atol=0)
    moved = [image.roll((30, 15), (-2, -1)) for image in (start, colours, known)]
    elsewhere = found(moved[0], moved[1], known=moved[2]).roll((-30, -15), (0, 1))
    torch.testing.assert_close(elsewhere[known], share[known], rtol=0, atol=1e-4)


@pytest.mark.parametrize("pixels", [0, 1, 40])
def test_a_few_pixels_are_no_error(pixels):
    known = (torch.arange(SIZE * SIZE) < pixels).view(SIZE, SIZE)
    start = edge(10)
    assert torch.isfinite(found(start, lit(start), known=known)).all()
