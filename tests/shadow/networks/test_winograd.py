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


@pytest.mark.parametrize("size", [(32, 16), (33, 22), (128, 96)])
def test_the_gradients_of_a_convolution_that_learns_equal_pytorchs(size, monkeypatch):
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: "AVX2")
    torch.manual_seed(0)
    convolution = Conv3x3(48, 80)
    x = torch.randn(2, 48, *size).to(memory_format=torch.channels_last).requires_grad_()
    result = convolution(x)
    assert type(result.grad_fn).__name__ == "_LearnedBackward"
    learned = x, convolution.weight, convolution.bias
    exact = [tensor.detach().double().requires_grad_() for tensor in learned]
    toward = torch.randn_like(result)
    expected = torch.autograd.grad(F.conv2d(*exact, padding=1), exact, toward.double())
    for gradient, truth in zip(torch.autograd.grad(result, learned, toward), expected, strict=True):
        torch.testing.assert_close(gradient.double(), truth, atol=3e-5 * truth.abs().max().item(), rtol=0)


@pytest.mark.parametrize("capability", ["AVX2", "AVX512"])
def test_a_convolution_that_learns_has_gradients(capability, monkeypatch):
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: capability)
    convolution = Conv3x3(96, 96)
    convolution(torch.randn(1, 96, 64, 32)).sum().backward()
    assert convolution.weight.grad.abs().sum() > 0
    with torch.no_grad():
        assert convolution(torch.randn(1, 96, 64, 32)).grad_fn is None
