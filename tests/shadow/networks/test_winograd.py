"""Convolutions by minimal filtering are the ones that PyTorch computes."""

import pytest
import torch
import torch.nn.functional as F

from shadow.networks.winograd import Conv3x3


@pytest.mark.parametrize(
    "size", [(32, 16), (33, 22), (128, 48)]
)  # whole tiles, parts of tiles, several chunks
def test_a_frozen_convolution_equals_pytorchs(size, monkeypatch):
    torch.manual_seed(0)
    convolution = Conv3x3(96, 80).requires_grad_(False)
    x = torch.randn(2, 96, *size).to(memory_format=torch.channels_last)
    expected = F.conv2d(x, convolution.weight, convolution.bias, padding=1)
    monkeypatch.setattr(F, "conv2d", None)  # so that this is not what is compared
    torch.testing.assert_close(convolution(x), expected, atol=5e-5, rtol=0)


def test_a_convolution_that_learns_has_gradients():
    convolution = Conv3x3(96, 96)
    convolution(torch.randn(1, 96, 32, 16)).sum().backward()
    assert convolution.weight.grad.abs().sum() > 0
