import numpy as np
import pytest
import torch

import shading
from shading import albedo, diffuse, tasks
from shadow.directions import olat
from shadow.networks import checkpoints


def test_lighting_is_recovered_from_exact_albedo_and_shading():
    generator = torch.Generator().manual_seed(0)
    maps = torch.rand(96, 64, 48, generator=generator) ** 3
    paint = torch.rand(3, 64, 48, generator=generator)
    truth = torch.zeros(96, 3)
    truth[5], truth[40] = torch.tensor([1.0, 0.8, 0.5]), torch.tensor([0.1, 0.2, 0.4])
    image = paint * torch.einsum("dhw,dc->chw", maps, truth)
    found = albedo.solve_lighting(image, paint, maps, torch.ones(64, 48))
    torch.testing.assert_close(found, truth, atol=0.01, rtol=0)
    assert found.min() >= 0
    twice = albedo.solve_lighting(2 * image, paint, maps, torch.ones(64, 48))
    torch.testing.assert_close(twice, 2 * found, atol=1e-5, rtol=1e-4)


def test_only_the_masked_pixels_count():
    maps, paint, mask = torch.rand(96, 64, 48), torch.rand(3, 64, 48), torch.zeros(64, 48)
    mask[:, :24] = 1
    image = paint * maps[7]
    spoiled = image.clone()
    spoiled[:, :, 24:] = 100
    expected = albedo.solve_lighting(image, paint, maps, mask)
    torch.testing.assert_close(albedo.solve_lighting(spoiled, paint, maps, mask), expected)


@pytest.mark.slow
def test_lighting_of_a_photograph(person):
    rgb, mask = person
    directions, powers, paint = shading.infer_lighting(rgb, mask)
    np.testing.assert_array_equal(directions, olat(behind=True))
    assert powers.shape == (96, 3)
    assert powers.min() >= 0
    np.testing.assert_array_equal(paint, shading.infer_albedo(rgb, mask))
    brighter = shading.infer_lighting(4 * rgb, mask)[1]
    np.testing.assert_allclose(brighter, 4 * powers, rtol=0.05, atol=0.02 * powers.max())


def test_the_albedo_has_the_photographs_colours(person):
    mask = person[1]
    halves = np.where(np.arange(mask.shape[1])[:, None] < 80, (0.6, 0.3, 0.2), (0.2, 0.25, 0.5))
    photograph = np.float32(halves * mask[..., None])
    paint = shading.infer_albedo(photograph, mask)
    seen, painted = (image[mask > 0.99] for image in (photograph, paint))
    shares = (pixels / pixels.sum(axis=1, keepdims=True) for pixels in (seen, painted))
    assert np.percentile(abs(np.subtract(*shares)), 95) < 1e-3


def test_a_shadow_left_in_the_albedo_does_not_pull_at_its_brightness(monkeypatch):
    monkeypatch.setattr(tasks, "ABSOLUTE_WEIGHT", 0)
    truth = torch.rand(1, 3, 4, 50, generator=torch.Generator().manual_seed(0)) * 0.5 + 0.3
    estimate = torch.cat([0.5 * truth[..., :10], truth[..., 10:]], dim=-1)
    brightness = torch.tensor(1.3, requires_grad=True)
    light = torch.ones_like(truth)
    tasks.albedo_error(brightness * estimate, truth, torch.ones(1, 1, 4, 50), light).backward()
    assert brightness.grad.abs() < 1e-6


def test_an_error_in_shadow_counts_more_than_one_in_light():
    truth, light = torch.full((1, 3, 4, 50), 0.5), torch.ones(1, 3, 4, 50)
    light[..., :10] = 0
    in_shadow, in_light = truth.clone(), truth.clone()
    in_shadow[..., :10] *= 0.9
    in_light[..., 40:] *= 0.9
    errors = [tasks.albedo_error(x, truth, torch.ones(1, 1, 4, 50), light) for x in (in_shadow, in_light)]
    assert errors[0] > 1.5 * errors[1]


def test_a_network_without_albedo_is_refused(person, tmp_path):
    network = diffuse.PerLightShading(128, "resb3")
    path = tmp_path / "per-light.safetensors"
    checkpoints.save(path, network, "shading-per-light", {"size": 128, "latent": "resb3"}, {})
    with pytest.raises(ValueError, match="infers shading only"):
        shading.infer_albedo(*person, model=path)
