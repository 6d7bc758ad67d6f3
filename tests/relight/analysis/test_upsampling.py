import pytest
import torch

from relight.analysis.upsampling import JointBilateral
from shadow.framing import Framing

SCALE = 1 / 8  # canvas pixels a plate pixel
CANVAS, PLATE = (32, 24), (256, 192)


def enlarger(guide, canvas_guide, known=None):
    framing = Framing((PLATE[1] / 2, PLATE[0] / 2), SCALE, CANVAS, PLATE)
    known = torch.ones(CANVAS, dtype=torch.bool) if known is None else known
    pixels = torch.arange(PLATE[0] * PLATE[1])
    return JointBilateral(framing, guide.flatten(1).T, canvas_guide, known, pixels)


def step(size, edge):
    """A picture (3, H, W), dark left of column `edge` and bright from there."""
    return torch.where(torch.arange(size[1]) < edge, 0.2, 0.8).expand(3, *size).contiguous()


@pytest.fixture(scope="module")
def noisy():
    generator = torch.Generator().manual_seed(0)
    guides = torch.rand(3, *PLATE, generator=generator), torch.rand(3, *CANVAS, generator=generator)
    return enlarger(*guides), generator


def test_keeps_constants_and_ranges(noisy):
    enlarge, generator = noisy
    torch.testing.assert_close(
        enlarge(torch.full((1, *CANVAS), 0.7)), torch.full((PLATE[0] * PLATE[1], 1), 0.7)
    )
    maps = torch.rand(2, *CANVAS, generator=generator)
    enlarged = enlarge(maps)
    assert enlarged.shape == (PLATE[0] * PLATE[1], 2)
    assert enlarged.min() >= maps.min()
    assert enlarged.max() <= maps.max() * (1 + 1e-6)


def test_is_linear(noisy):
    enlarge, generator = noisy
    a, b = torch.rand(2, 3, *CANVAS, generator=generator)
    torch.testing.assert_close(enlarge(a + b), enlarge(a) + enlarge(b), rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(enlarge(4 * a), 4 * enlarge(a), rtol=0, atol=0)


def test_edges_fall_where_the_plate_has_them():
    edge = 100  # in the middle of a canvas pixel: 100 / 8 = 12.5
    enlarge = enlarger(step(PLATE, edge), step(CANVAS, 13))
    columns = enlarge(step(CANVAS, 13)[:1]).view(*PLATE)[128]
    assert columns[:edge].max() < 0.25
    assert columns[edge:].min() > 0.75


def test_without_an_edge_to_guide_it_is_smooth():
    flat = torch.full((3, *PLATE), 0.5), torch.full((3, *CANVAS), 0.5)
    columns = enlarger(*flat)(step(CANVAS, 12)[:1]).view(*PLATE)[128]
    assert columns.diff().abs().max() < 0.08  # 0.6 over two canvas pixels and more
    assert (columns.diff() > -1e-4).all()


def test_texture_is_not_printed_into_the_map():
    stripes = step(PLATE, 0)
    stripes[:, :, ::2] = 0.2
    ramp = torch.linspace(0, 1, CANVAS[1]).expand(1, *CANVAS)
    enlarge = enlarger(stripes, torch.full((3, *CANVAS), 0.5))
    columns = enlarge(ramp).view(*PLATE)[128, 24:-24]
    torch.testing.assert_close(columns.diff(), torch.full((len(columns) - 1,), SCALE / 23), atol=1e-3, rtol=0)


def test_what_is_unknown_does_not_leak():
    known = (torch.arange(CANVAS[1]) < 12).expand(CANVAS)
    maps = torch.where(known, 1.0, 0.0)[None]
    flat = torch.full((3, *PLATE), 0.5), torch.full((3, *CANVAS), 0.5)
    enlarged = enlarger(*flat, known=known)(maps).view(*PLATE)
    assert enlarged[:, : 12 * 8].min() > 0.99
