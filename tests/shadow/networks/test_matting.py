import pytest
import torch

from shadow.networks.matting import MattingNetwork

NARROW = {"widths": (8,) * 5, "encoder": (1,) * 5, "decoder": (1,) * 4}


def test_a_new_network_answers_with_the_mask():
    network = MattingNetwork(**NARROW)
    mask = torch.zeros(1, 1, 64, 96)
    mask[..., 16:48, 32:64] = 1
    with torch.no_grad():
        fine, coarse = network(torch.rand(1, 3, 64, 96), mask)
    assert fine.shape == mask.shape
    assert coarse.shape == (1, 1, 8, 12)
    torch.testing.assert_close((fine.sigmoid() > 0.5).float(), mask)
    torch.testing.assert_close((coarse.sigmoid() > 0.5).float(), mask[..., ::8, ::8])


def test_the_shipped_size_is_small():
    assert 3e6 < sum(each.numel() for each in MattingNetwork().parameters()) < 6e6


@pytest.mark.parametrize("side", [64, 128])
def test_every_output_depends_on_colour_and_mask(side):
    torch.manual_seed(0)
    network = MattingNetwork(**NARROW)
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, std=0.1)
    rgb, mask = torch.rand(1, 3, side, side).requires_grad_(), torch.rand(1, 1, side, side).requires_grad_()
    network(rgb, mask).fine[0, 0, side // 2, side // 2].backward()
    assert rgb.grad[..., side // 2, side // 2].abs().min() > 0
    assert mask.grad[..., side // 2, side // 2].abs().min() > 0
