import numpy as np
import pytest
import torch

import shading
from shading import diffuse
from shadow.directions import from_spherical, olat
from shadow.networks.backbone import encode_image

LIGHTS = torch.from_numpy(olat(behind=True))


@pytest.fixture(scope="module")
def subject():
    """A sphere on the canvas: image, mask, normals, and a visibility that knows nothing of occluders."""
    step = torch.linspace(-1.3, 1.3, 128)
    y, x = torch.meshgrid(-step, step[16:112], indexing="ij")
    mask = (x**2 + y**2 < 1).float()
    normals = torch.stack([x, y, (1 - x**2 - y**2).clamp_min(0).sqrt()]) * mask
    rgb = torch.rand(3, 128, 96, generator=torch.Generator().manual_seed(0)) * mask
    visibility = lambda lights: (torch.einsum("dc,chw->dhw", lights, normals) > 0).float()  # noqa: E731
    return rgb, mask, normals, visibility


def trained(network, scale=0.05):
    """The network with a head that says something."""
    torch.manual_seed(1)
    head = network.unet.head if hasattr(network, "unet") else network.backbone.head
    torch.nn.init.normal_(head.weight, std=scale)
    torch.nn.init.normal_(head.bias, std=scale)
    return network.eval()


NETWORKS = [
    lambda: diffuse.ShadingField(128),
    lambda: diffuse.PerLightShading(128, "resb3"),
]


@pytest.mark.parametrize("make", NETWORKS)
def test_where_the_residual_is_zero_shading_is_the_base_image(subject, make):
    rgb, mask, normals, visibility = subject
    analysed = make().eval().analyse(*subject)
    lights = LIGHTS[:5]
    expected = diffuse.base(normals[None], visibility(lights)[None], lights[None])[0]
    torch.testing.assert_close(analysed.shading(lights), expected * mask)
    if analysed.albedo is not None:  # and the albedo is the photograph, exposed
        photograph = encode_image(rgb[None], mask[None, None])[0, :3]
        torch.testing.assert_close(analysed.albedo, photograph.clamp(0, 1) ** 2.2 * mask)


@pytest.mark.parametrize("make", NETWORKS)
def test_shading_is_held_to_the_unit_interval_and_to_the_mask(subject, make):
    analysed = trained(make(), 0.5).analyse(*subject)
    shade = analysed.shading(LIGHTS[::12])
    assert shade.min() == 0
    assert shade.max() == 1  # of a head this wild
    assert shade[:, subject[1] == 0].abs().max() == 0


@pytest.mark.parametrize("make", NETWORKS)
def test_a_light_is_shaded_alike_alone_and_among_others(subject, make):
    analysed = trained(make()).analyse(*subject)
    together = analysed.shading(LIGHTS[:10])
    for index in (0, 7):
        torch.testing.assert_close(analysed.shading(LIGHTS[index : index + 1])[0], together[index])


def test_the_gain_has_no_colour(subject):
    rgb, mask, *rest = subject
    rgb = (1 + rgb) * mask * torch.tensor([1, 0.8, 0.6]).view(3, 1, 1)
    photograph = encode_image(rgb[None], mask[None, None])[0, :3] ** 2.2
    albedo = trained(diffuse.ShadingField(128), 0.03).analyse(rgb, mask, *rest).albedo
    gain = (albedo / photograph.clamp_min(1e-3))[:, mask > 0]
    assert gain[0].log().std() > 0.05  # from pixel to pixel
    assert (gain[0] / gain[2]).log().std() < 0.01


def test_the_base_image_is_linear_in_visibility():
    normals = torch.nn.functional.normalize(torch.randn(2, 3, 8, 8), dim=1)
    lights = torch.nn.functional.normalize(torch.randn(2, 4, 3), dim=-1)
    visibility = torch.rand(2, 4, 8, 8)
    whole = diffuse.base(normals, visibility, lights)
    torch.testing.assert_close(diffuse.base(normals, 0.25 * visibility, lights), 0.25 * whole)
    facing = diffuse.base(normals, None, lights)
    torch.testing.assert_close(facing * visibility, whole)
    torch.testing.assert_close(diffuse.base(None, visibility, lights), visibility)
    head_on = diffuse.base(normals, None, normals[:, :, 3, 3][:, None])
    torch.testing.assert_close(head_on[:, 0, 3, 3], torch.ones(2))


def test_residuals_change_smoothly_with_the_light(subject):
    analysed = trained(diffuse.ShadingField(128)).analyse(*subject)
    lights = torch.from_numpy(from_spherical(np.linspace(-60, 60, 241), 20))  # half a degree a step
    shade = analysed.shading(lights)
    # Nothing but the base's own steps, where the light passes a point's horizon.
    smooth = shade[:, 64, 48]
    assert (smooth[1:] - smooth[:-1]).abs().max() < 0.03


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"normals": False},
        {"visibility": None},
        {"normals": False, "visibility": None},
        {"visibility": "baseline"},
    ],
)
def test_ablations_see_only_what_they_are_given(subject, options):
    rgb, mask, normals, visibility = subject
    network = trained(diffuse.PerLightShading(128, "resb3", **options))
    before = network.analyse(rgb, mask, normals, visibility).shading(LIGHTS[::24])
    blind = lambda lights: torch.zeros(len(lights), *mask.shape)  # noqa: E731
    without = network.analyse(rgb, mask, normals, blind).shading(LIGHTS[::24])
    assert torch.equal(before, without) == (options.get("visibility", "inferred") != "inferred")
    flat = torch.zeros_like(normals)
    without = network.analyse(rgb, mask, flat, visibility).shading(LIGHTS[::24])
    assert torch.equal(before, without) == (options.get("normals") is False)


@pytest.mark.parametrize(
    ("options", "channels"),
    [
        ({}, 10),
        ({"normals": False}, 7),
        ({"visibility": None}, 9),
        ({"normals": False, "visibility": None}, 6),
        ({"visibility": "baseline"}, 10),
    ],
)
def test_ablations_have_no_channels_for_what_they_lack(options, channels):
    first = diffuse.PerLightShading(128, "resb3", **options).unet.encoder[0][0][0]
    assert first.in_channels == channels


def test_unknown_ablation_is_refused():
    with pytest.raises(ValueError, match="expected inferred, baseline or None"):
        diffuse.PerLightShading(visibility="guessed")


@pytest.mark.parametrize("options", [{"normals": False}, {"visibility": None}, {"visibility": "baseline"}])
def test_a_field_lacks_no_input(options):
    with pytest.raises(ValueError, match="normals, visibility: expected both"):
        diffuse.ShadingField(128, **options)


def test_given_visibility_is_used(person):
    rgb, mask = person
    lights = olat()[:3]
    lit = np.ones((3, *mask.shape), np.float32)
    bright, dark = (shading.infer(rgb, mask, lights, visibility=v) for v in (lit, 0 * lit))
    assert bright[:, mask > 0.5].mean() > dark[:, mask > 0.5].mean() + 0.3
    with pytest.raises(ValueError, match="visibility: expected"):
        shading.infer(rgb, mask, lights, visibility=lit[:2])


@pytest.mark.slow
def test_given_normals_shade(person):
    rgb, mask = person
    toward = np.full((*mask.shape, 3), (0, 0, 1.0))
    left = np.full((*mask.shape, 3), (-1.0, 0, 0))
    light = from_spherical([0], [0])
    facing, averted = (
        shading.infer(rgb, mask, light, normals=n)[0, mask > 0.5].mean() for n in (toward, left)
    )
    assert facing > averted + 0.5
