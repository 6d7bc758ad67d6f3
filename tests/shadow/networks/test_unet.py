import pytest
import torch

from shadow.directions import olat
from shadow.networks.unet import LATENTS, LIGHTS_AT_ONCE, PerLight, UNet

TABLE_4 = {"resb3": 24.8e6, "resb7": 45.8e6, "resb11": 83.5e6, "attention": 39.0e6}


@pytest.mark.parametrize("latent", TABLE_4)
def test_parameters_of_table_4(latent):
    with torch.device("meta"):
        count = sum(parameter.numel() for parameter in UNet(latent=latent).parameters())
    assert count == pytest.approx(TABLE_4[latent], rel=0.005)


def test_shapes_of_table_1():
    seen = {}
    with torch.device("meta"):
        network = UNet()
        for name in ("encoder.4", "latent", "decoder.4", "head"):
            network.get_submodule(name).register_forward_hook(
                lambda module, inputs, output, name=name: seen.update({name: tuple(output.shape)})
            )
        assert network(torch.empty(1, 9, 512, 512)).shape == (1, 1, 512, 512)
    assert seen["encoder.4"] == seen["latent"] == (1, 512, 16, 16)
    assert seen["head"] == (1, 1, 512, 512)


SMALL = (8, 8, 16, 16, 32)


@pytest.fixture
def image():
    return torch.randn(2, 9, 64, 96, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("latent", LATENTS)
def test_images_of_a_batch_are_independent(latent, image):
    torch.manual_seed(0)
    network = UNet(latent=latent, widths=SMALL)
    with torch.no_grad():
        both = network(image)
        torch.testing.assert_close(network(image[1:]), both[1:], atol=1e-4, rtol=1e-4)
    assert both.shape == (2, 1, 64, 96)


def test_tanh_or_linear(image):
    torch.manual_seed(0)
    network = UNet(widths=SMALL, out_channels=2)
    network.head.weight.data *= 100
    with torch.no_grad():
        bounded = network(image)
        network.linear = True
        assert network(image).abs().max() > 1
        torch.testing.assert_close(bounded, torch.tanh(network(image)))


def test_the_light_is_seen_away_from_the_border():
    """A channel that is the same in all pixels, as a direction is, must not be normalised away."""
    torch.manual_seed(0)
    network = UNet(widths=SMALL)
    image = torch.randn(1, 9, 256, 256)
    image[:, 6:] = 0
    other = image.clone()
    other[:, 6] = 1
    with torch.no_grad():
        first = network.encoder[0](image)
        change = (network.encoder[0](other) - first)[..., 32:-32, 32:-32].abs().mean()
    assert change > 0.1 * first.abs().mean()


@pytest.mark.parametrize("normals", [True, False])
def test_any_number_of_lights_in_batches(normals):
    torch.manual_seed(0)
    network = PerLight(normals=normals, widths=SMALL)
    rgb, mask = torch.rand(3, 128, 96), (torch.rand(128, 96) > 0.3).float()
    lights = torch.from_numpy(olat()[: LIGHTS_AT_ONCE + 2])
    _, visibility = network.analyse(rgb, mask, torch.nn.functional.normalize(torch.randn(3, 128, 96), dim=0))
    maps = visibility(lights)
    assert maps.shape == (LIGHTS_AT_ONCE + 2, 128, 96)
    assert 0 <= maps.min() < maps.max() <= 1
    assert (maps * (1 - mask)).max() == 0
    torch.testing.assert_close(visibility(lights[-1:]), maps[-1:], atol=1e-4, rtol=1e-4)


def test_exposure_does_not_matter():
    torch.manual_seed(0)
    network = PerLight(widths=SMALL)
    rgb, mask, normals = torch.rand(3, 128, 96), torch.ones(128, 96), torch.rand(3, 128, 96)
    lights = torch.from_numpy(olat()[:1])
    dim, bright = (network.analyse(exposure * rgb, mask, normals)[1](lights) for exposure in (0.1, 3))
    torch.testing.assert_close(dim, bright, atol=1e-4, rtol=1e-4)


def test_bad_latent_is_named():
    with pytest.raises(ValueError, match="latent: expected one of resb3, resb7, resb11, attention"):
        UNet(latent="resb5")
