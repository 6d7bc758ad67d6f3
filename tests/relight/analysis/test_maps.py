import torch

from relight.analysis.maps import bounded, photographed_light

SIZE = (48, 36)


def test_thephotographed_light_is_the_grey_gain_where_materials_meet():
    """A striped coat, lit on the left and in shadow on the right."""
    albedo = torch.tensor([0.5, 0.3, 0.1]).view(3, 1, 1).repeat(1, *SIZE)
    albedo[:, ::2] = torch.tensor([0.1, 0.2, 0.6]).view(3, 1, 1)
    light = torch.full(SIZE, 1.2)
    light[:, 18:] = 0.3
    found = photographed_light(albedo * light, albedo, torch.ones(SIZE, dtype=torch.bool))
    torch.testing.assert_close(found[0], found[1], rtol=0, atol=0)
    torch.testing.assert_close(found[0], found[2], rtol=0, atol=0)
    beside = torch.ones(SIZE[1], dtype=torch.bool)
    beside[17:19] = False  # the mean of two lights over 3 x 3 pixels
    torch.testing.assert_close(found[0, :, beside], light[:, beside], rtol=0.04, atol=0)


def test_black_cloth_is_in_light_of_mean_strength():
    albedo = torch.full((3, *SIZE), 0.4)
    albedo[:, :10] = 1e-3
    light = torch.full(SIZE, 0.8)
    light[:10] = 8  # a guess, where the photograph is black
    found = photographed_light(albedo * light, albedo, torch.ones(SIZE, dtype=torch.bool))
    torch.testing.assert_close(found[:, :9], torch.full((3, 9, SIZE[1]), 0.8), rtol=0.05, atol=0)
    assert (found > 0).all()


def test_an_albedo_that_is_too_light_keeps_its_colour():
    albedo = torch.tensor([[1.6, 0.8], [0.8, 0.4], [0.4, -0.1]])
    torch.testing.assert_close(bounded(albedo), torch.tensor([[1.0, 0.8], [0.5, 0.4], [0.25, 0.0]]))
    torch.testing.assert_close(bounded(albedo.T, dim=1), bounded(albedo).T)
