import numpy as np
import pytest
import torch

from shadow import inputs

IMAGE = np.random.default_rng(0).random((4, 6, 3))
CHECKS = {
    "image": (lambda value: inputs.image("image", value), IMAGE),
    "mask": (lambda value: inputs.mask("mask", value, (4, 6)), IMAGE[..., 0] + 0.001),
    "directions": (lambda value: inputs.directions("directions", value), IMAGE[0]),
    "normals": (lambda value: inputs.normals("normals", value, (4, 6)), IMAGE),
    "visibility": (lambda value: inputs.visibility("visibility", value, (4, 6, 3)), IMAGE),
}


@pytest.mark.parametrize("dtype", [">f2", ">f4", ">f8"])
@pytest.mark.parametrize("name", CHECKS)
def test_big_endian_arrays_are_the_same(name, dtype):
    check, values = CHECKS[name]
    big = (values * 0.99).astype(dtype)
    torch.testing.assert_close(check(big), check(big.astype(dtype[1:])), rtol=0, atol=0)


@pytest.mark.parametrize("name", list(CHECKS))
def test_tensors_that_require_gradients_are_refused(name):
    """Rather than answered without them, which an optimiser would take for zero."""
    check, values = CHECKS[name]
    tensor = torch.tensor(values * 0.99, requires_grad=True)
    with pytest.raises(ValueError, match="requires a gradient, which is not computed here"):
        check(tensor)
    torch.testing.assert_close(check(tensor.detach()), check(tensor.detach().numpy()), rtol=0, atol=0)


def test_what_is_handed_over_is_what_comes_back():
    result = torch.ones(2)
    assert isinstance(inputs.like(result, IMAGE), np.ndarray)
    assert inputs.like(result, torch.ones(1, requires_grad=True)) is result
