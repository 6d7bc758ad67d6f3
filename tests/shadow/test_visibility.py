import numpy as np
import pytest
import torch

import shading
import shadow
from shadow.directions import from_spherical, olat


def test_baseline_is_the_sign_of_the_cosine():
    normals = np.zeros((2, 2, 3), np.float32)
    normals[0, 0], normals[0, 1], normals[1, 0] = [0, 0, 1], [1, 0, 0], [-1, 0, 0]
    lights = from_spherical([-40, 0], [0, 0])
    np.testing.assert_array_equal(shadow.baseline(normals, lights)[0], [[1, 0], [1, 0]])
    np.testing.assert_array_equal(shadow.baseline(normals, 5 * lights), shadow.baseline(normals, lights))


@pytest.mark.slow
def test_shapes_types_and_the_outside(person):
    rgb, mask = person
    lights = olat(behind=True)
    normals = shadow.infer_normals(rgb, mask)
    visibility = shadow.infer(rgb, mask, lights)
    shade = shading.infer(rgb, mask, lights)
    albedo = shading.infer_albedo(rgb, mask)
    assert normals.shape == albedo.shape == rgb.shape
    assert visibility.shape == shade.shape == (96, *mask.shape)
    for result in (normals, visibility, shade, albedo):
        assert isinstance(result, np.ndarray)
        assert result.dtype == np.float32
        assert np.isfinite(result).all()
    assert abs(normals[mask == 0]).max() == abs(albedo[mask == 0]).max() == 0
    assert visibility[:, mask == 0].max() == shade[:, mask == 0].max() == 0
    np.testing.assert_allclose(np.linalg.norm(normals[mask > 0], axis=1), 1, atol=1e-4)
    for result in (visibility, shade, albedo):
        assert result.min() >= 0
        assert result.max() <= 1


def test_torch_in_torch_out(person):
    rgb, mask = map(torch.from_numpy, person)
    lights = torch.from_numpy(olat()[:3])
    as_numpy = shadow.infer(*person, olat()[:3])
    as_torch = shadow.infer(rgb, mask, lights)
    assert isinstance(as_torch, torch.Tensor)
    np.testing.assert_allclose(as_torch, as_numpy, atol=1e-6)


def test_given_normals_are_used(person):
    rgb, mask = person
    sideways = np.zeros_like(rgb)
    sideways[..., 0] = 1
    lights = from_spherical([90, -90], [0, 0])
    shade = shading.infer(rgb, mask, lights, normals=sideways)
    toward, away = shade[:, mask > 0.5].mean(axis=1)
    assert away < 0.05 * toward  # what is left is bounce light
    assert toward > 0.2


BAD_INPUT = {
    "rgb: expected a float array of shape": lambda rgb, mask, lights: (rgb[..., 0], mask, lights),
    "rgb: expected a float array .* got dtype": lambda rgb, mask, lights: (
        (rgb * 255).astype(np.uint8),
        mask,
        lights,
    ),
    "rgb: contains NaN": lambda rgb, mask, lights: (np.where(mask[..., None] > 0, np.nan, rgb), mask, lights),
    "mask: expected an array of shape": lambda rgb, mask, lights: (rgb, mask[:-1], lights),
    "mask: expected values in": lambda rgb, mask, lights: (rgb, mask * 255, lights),
    "mask: is empty": lambda rgb, mask, lights: (rgb, mask * 0, lights),
    "mask: contains NaN": lambda rgb, mask, lights: (rgb, mask * np.inf, lights),
    "directions: expected light directions of shape": lambda rgb, mask, lights: (rgb, mask, lights[0]),
    "directions: direction 2 has zero length": lambda rgb, mask, lights: (
        rgb,
        mask,
        lights * [[1], [1], [0], [1]],
    ),
    "directions: contains NaN": lambda rgb, mask, lights: (rgb, mask, lights * np.nan),
}


@pytest.mark.parametrize("message", BAD_INPUT)
@pytest.mark.parametrize("function", [shadow.infer, shading.infer])
@pytest.mark.filterwarnings("ignore:invalid value")
def test_inference_refuses_invalid_images_masks_and_directions(person, function, message):
    arguments = BAD_INPUT[message](*person, olat()[:4])
    with pytest.raises((TypeError, ValueError), match=message):
        function(*arguments)


@pytest.mark.parametrize("function", [shadow.infer_normals, shading.infer_albedo])
def test_an_image_of_two_dimensions_is_refused(person, function):
    rgb, mask = person
    with pytest.raises(ValueError, match="rgb: expected"):
        function(rgb[0], mask)
    with pytest.raises(ValueError, match="mask: is empty"):
        function(rgb, mask * 0)


def test_bad_normals_and_visibility_are_named(person):
    rgb, mask = person
    with pytest.raises(ValueError, match="normals: expected shape"):
        shadow.infer(rgb, mask, olat(), normals=rgb[:-1])
    with pytest.raises(ValueError, match="visibility: expected shape"):
        shading.infer(rgb, mask, olat(), visibility=np.zeros((3, *mask.shape), np.float32))
    with pytest.raises(ValueError, match="visibility: expected values in"):
        shading.infer(rgb, mask, olat()[:1], visibility=2 * mask[None])
    with pytest.raises(ValueError, match="unknown weights 'resb99'"):
        shadow.infer(rgb, mask, olat(), model="resb99")
