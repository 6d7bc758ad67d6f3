import numpy as np
import pytest
import torch
from helpers.stored import PREMULTIPLIED, STRAIGHT

from relight.errors import EmptyMatteError
from relight.media import colour
from relight.media.images import coverage, person_mask, scene_linear
from relight.media.images.arrays import linearise


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integers_are_srgb_with_straight_alpha(dtype):
    top = np.iinfo(dtype).max
    image = np.array([[[top, top // 2, 0, top // 2]]], dtype)
    code = (top // 2) / top
    linear = ((code + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(scene_linear("image", image), [[[code, linear * code, 0, code]]], rtol=1e-5)


@pytest.mark.parametrize("dtype", [">u2", ">f4", ">f8"])
def test_big_endian_arrays_are_the_same(dtype):
    image = (STRAIGHT[..., :3] * (65535 if dtype == ">u2" else 1)).astype(dtype)
    native = image.astype(image.dtype.newbyteorder("="))
    np.testing.assert_array_equal(scene_linear("image", image), scene_linear("image", native))
    np.testing.assert_array_equal(coverage("mask", image[..., 0]), coverage("mask", native[..., 0]))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64, torch.float16])
def test_tensors_are_arrays_unless_they_require_a_gradient(dtype):
    tensor = torch.tensor(PREMULTIPLIED, dtype=dtype)
    np.testing.assert_array_equal(scene_linear("image", tensor), tensor.numpy().astype(np.float32))
    np.testing.assert_array_equal(coverage("mask", tensor[..., 3]), tensor[..., 3].numpy())
    tensor.requires_grad_()
    for convert, name, value in ((scene_linear, "image", tensor), (coverage, "mask", tensor[..., 3])):
        with pytest.raises(ValueError, match=rf"{name}: requires a gradient, .* give {name}\.detach\(\)"):
            convert(name, value)


def test_what_is_no_array_is_named():
    with pytest.raises(TypeError, match=r"image: expected an array, got list"):
        scene_linear("image", [[1, 2], [3]])


def test_bfloat16_tensors_are_floats():
    tensor = torch.tensor([[[0.25, 2.0, -0.5]]], dtype=torch.bfloat16)
    np.testing.assert_array_equal(scene_linear("image", tensor), [[[0.25, 2.0, -0.5]]])


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16, torch.float64])
def test_mattes_may_be_tensors_of_any_float(dtype):
    tensor = torch.tensor([[0.25, 1.0]], dtype=dtype)
    found = person_mask("mask", tensor, (1, 2))
    assert (found.dtype, found.tolist()) == (torch.float32, [[0.25, 1.0]])


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_floats_are_linear_and_premultiplied(dtype):
    image = np.array([[[-0.25, 4.0, 0.5, 0.5]]], dtype)
    result = scene_linear("image", image)
    assert result.dtype == np.float32
    np.testing.assert_array_equal(result, image)


@pytest.mark.parametrize(
    ("image", "error", "message"),
    [
        (np.zeros((4, 4)), ValueError, r"picture: expected shape \(H, W, 3\) or \(H, W, 4\), got \(4, 4\)"),
        (np.zeros((4, 4, 2)), ValueError, r"got \(4, 4, 2\)"),
        (np.zeros((0, 4, 3)), ValueError, r"got \(0, 4, 3\)"),
        (np.zeros((4, 4, 3), np.int32), TypeError, "expected uint8, uint16 or a floating dtype, got int32"),
        (np.zeros((4, 4, 3), bool), TypeError, "got bool"),
        (np.zeros((4, 4, 3), complex), TypeError, "got complex128"),
        ("image.png", TypeError, "expected an array, got the path"),
        (np.full((4, 4, 3), np.nan), ValueError, "picture: contains NaN or infinite"),
        (np.full((4, 4, 3), np.inf), ValueError, "picture: contains NaN or infinite"),
        (np.full((4, 4, 4), 1.5), ValueError, r"picture: expected alpha in \[0, 1\], got \[1.5, 1.5\]"),
    ],
)
def test_bad_images_are_named(image, error, message):
    with pytest.raises(error, match=message):
        scene_linear("picture", image)


def test_premultiplied_integers_of_linear_light_are_scaled():
    codes = np.full((2, 2, 4), 128, np.uint8)
    found = linearise(codes, straight=False, space=colour.LINEAR)
    np.testing.assert_allclose(found, 128 / 255, rtol=1e-6)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("label", [1, 2, 127])
@pytest.mark.states("Stills", "labels of 0 and 1 as a matte", "refused")
def test_labels_are_no_coverage(dtype, label):
    labels = np.zeros((8, 8), dtype)
    labels[2:6, 2:6] = label
    full = np.iinfo(dtype).max
    with pytest.raises(EmptyMatteError, match=rf"the highest is {label} of {full}; multiply labels such as"):
        person_mask("mask", labels, (8, 8))
    with pytest.raises(EmptyMatteError, match=rf"the highest is {label} of {full}"):  # as a file is read
        person_mask("mask", labels / np.float32(full), (8, 8))
    with pytest.raises(EmptyMatteError, match=r"so there is no subject$"):
        person_mask("mask", np.zeros((8, 8), dtype), (8, 8))
