import torch

from relight.analysis.maps import _photographed_light

SIZE = (48, 36)


def test_the_photographed_light_has_its_colours():
    """A coat lit warmly on the left and by a blue sky on the right."""
    generator = torch.Generator().manual_seed(0)
    albedo = 0.2 + 0.5 * torch.rand(3, *SIZE, generator=generator)
    light = torch.ones(3, *SIZE) * torch.tensor([1.2, 1.0, 0.7]).view(3, 1, 1)
    light[:, :, 18:] = 0.3 * torch.tensor([0.7, 1.0, 1.4]).view(3, 1, 1)
    found = _photographed_light(albedo * light, albedo, torch.ones(SIZE, dtype=torch.bool))
    beside = torch.ones(SIZE[1], dtype=torch.bool)
    beside[16:20] = False  # of two lights: the mean over 3 x 3 pixels
    torch.testing.assert_close(found[:, :, beside], light[:, :, beside], rtol=0.03, atol=0)


def test_a_colour_that_a_material_hardly_has_is_in_light_of_the_strength_of_the_others():
    albedo = torch.tensor([0.5, 0.1, 1e-4]).view(3, 1, 1).expand(3, *SIZE)
    light = torch.full((3, *SIZE), 0.4)
    light[2] = 8  # a guess, of a channel in which eight bits say nothing
    found = _photographed_light(albedo * light, albedo, torch.ones(SIZE, dtype=torch.bool))
    torch.testing.assert_close(found[2], found[0], rtol=0.05, atol=0)
    assert (found > 0).all()
