import numpy as np
import pytest
import torch

from relight.analysis import old_light
from relight.analysis.old_light import OldLight

SUN, SKY = (1.0, 0.9, 0.75), (0.8, 0.95, 1.15)
SKIN, WHITE, BLACK = (0.5, 0.32, 0.22), (0.85, 0.85, 0.85), (0.03, 0.03, 0.03)
DENIM = (0.06, 0.1, 0.25)


def canvas(sun=SUN, sky=SKY, contrast=1.0, size=96):
    """Three materials in bands, with a cast shadow that crosses each: what `OldLight.fit` takes, and albedo.

    The gain that infers the albedo is exact, and grey.
    """
    generator = torch.Generator().manual_seed(0)
    albedo = torch.empty(3, size, size)
    for band, paint in zip(albedo.split(size // 3, dim=1), (SKIN, WHITE, BLACK), strict=True):
        texture = 1 + 0.1 * torch.rand(band.shape[1:], generator=generator)
        band[:] = torch.tensor(paint).view(3, 1, 1) * texture
    x = torch.linspace(-0.9, 0.9, size).expand(size, size)
    normals = torch.stack([x, torch.zeros_like(x), (1 - x**2).sqrt()])
    shadow = torch.arange(size) // (size // 6) % 2
    key = 0.8 * normals[2] * shadow
    light = key * torch.tensor(sun).view(3, 1, 1) + 0.2 * torch.tensor(sky).view(3, 1, 1)
    photograph = albedo * light**contrast
    level = (light**contrast).mean(dim=0, keepdim=True).expand(3, -1, -1)
    encoded = (photograph * 2).clamp(0, 4) ** (1 / 2.2)
    return (encoded, level, photograph / level, normals, torch.ones(size, size, dtype=torch.bool)), albedo


def spread(albedo, truth):
    """RMS of the error in log-chromaticity, without a tint of the whole."""
    wrong = albedo.log() - truth.log()
    wrong = wrong[::2] - wrong[1:2]
    return float((wrong - wrong.flatten(1).mean(dim=1)[:, None, None]).square().mean().sqrt())


def test_the_colours_of_sun_and_sky_leave_the_albedo():
    seen, truth = canvas()
    _, light, albedo, normals, known = seen
    tint = OldLight.fit(*seen).tint(light, albedo, normals, known)
    assert spread(albedo, truth) > 0.1
    assert spread(albedo / tint, truth) < 0.03


def test_lightness_stays_and_white_and_black_are_grey():
    seen, truth = canvas()
    _, light, albedo, normals, known = seen
    found = albedo / OldLight.fit(*seen).tint(light, albedo, normals, known)
    weights = torch.tensor([0.2126, 0.7152, 0.0722])
    lightness = [torch.einsum("c,chw->hw", weights, colours) for colours in (found, albedo)]
    torch.testing.assert_close(*lightness, rtol=1e-3, atol=1e-5)
    cloth = found[:, truth.amax(dim=0) == truth.amin(dim=0)]
    cloth = cloth / cloth.mean(dim=1, keepdim=True)  # the tint of the whole picture stays
    assert float((cloth.amax(dim=0) / cloth.amin(dim=0)).mean()) < 1.06


def test_lamps_on_two_sides_are_told_by_the_normals():
    seen, truth = canvas()
    _, _, _, normals, known = seen
    left, right = normals[0].clamp_min(0), (-normals[0]).clamp_min(0)
    light = sum(side * torch.tensor(c).view(3, 1, 1) for side, c in ((left, SUN), (right, SKY))) + 0.3
    level = light.mean(dim=0, keepdim=True).expand(3, -1, -1)
    albedo = truth * light / level
    old = OldLight.fit((2 * truth * light) ** (1 / 2.2), level, albedo, normals, known)
    assert spread(albedo / old.tint(level, albedo, normals, known), truth) < 0.6 * spread(albedo, truth)


def test_a_light_of_one_colour_changes_nothing():
    seen, _ = canvas(SUN, SUN)
    assert OldLight.fit(*seen) == OldLight()
    assert (OldLight().tint(*seen[1:5]) == 1).all()


def test_a_flat_photograph_changes_nothing():
    _, _, _, normals, known = canvas()[0]
    flat = torch.tensor(SKIN).view(3, 1, 1).expand(3, *known.shape).contiguous()
    assert OldLight.fit(flat, torch.ones_like(flat), flat, normals, known) == OldLight()


@pytest.mark.parametrize("pixels", [0, 1, 20])
def test_a_few_pixels_change_nothing(pixels):
    encoded, light, albedo, normals, known = canvas()[0]
    few = torch.from_numpy(np.arange(known.numel()).reshape(known.shape) < pixels)
    if not pixels:  # all of them too dark
        few, encoded = known, encoded * 0
    assert OldLight.fit(encoded, light, albedo, normals, few) == OldLight()


def test_saturation_that_a_tone_curve_adds_in_shadow_goes():
    """A curve's toe takes a larger share of the small channels, so that skin in shadow is orange."""
    _, truth = canvas(size=192)
    _, light, _, normals, known = canvas(SUN, SUN, size=192)[0]
    truth = torch.where(truth.amax(dim=0) / truth.amin(dim=0) > 1.5, truth, torch.tensor(DENIM).view(3, 1, 1))
    photograph = (truth * light) ** 2 / (truth * light + 0.1)
    albedo = photograph / light
    old = OldLight.fit((2 * photograph) ** (1 / 2.2), light, albedo, normals, known)
    shadow, skin = light[0] < 0.3, truth[0] > truth[2]
    before, after = (
        abs(float(ratio[skin & shadow].log().mean() - ratio[skin & ~shadow].log().mean()))
        for ratio in (
            colour[0] / colour[2] for colour in (albedo, albedo / old.tint(light, albedo, normals, known))
        )
    )
    assert before > 0.2
    assert after < 0.85 * before


def test_a_tone_curve_is_seen_where_lamps_explain_little():
    """A print of many colours leaves most differences between pixels unexplained."""
    _, light, _, normals, known = canvas(SUN, SUN, size=192)[0]
    generator = torch.Generator().manual_seed(0)
    cloth = (0.06 * torch.randn(light.shape, generator=generator)).exp()
    skin = torch.tensor(SKIN).view(3, 1, 1).log()
    albedo = (skin * light**-0.1).exp() * cloth  # more saturated in shadow
    old = OldLight.fit((2 * albedo * light).clamp(0, 1) ** (1 / 2.2), light, albedo, normals, known)
    assert old.ambient == pytest.approx((0, 0), abs=1e-6)
    assert old.saturation == pytest.approx(0.1, abs=0.03)


def test_what_is_dark_loses_the_saturation_of_a_tone_curve_and_nothing_gains_any():
    """A gain of dark cloth as the photograph shows it would be as blue as a lamp, even in full light."""
    (_, light, _, normals, known), truth = canvas()
    albedo = torch.where(truth[0] > truth[2], truth, 0.5 * torch.tensor(DENIM).view(3, 1, 1))
    tint = OldLight(saturation=0.3, bright_level=0.8 * float(light.max())).tint(light, albedo, normals, known)
    before, after = ((c.amax(dim=0) / c.amin(dim=0)).log() for c in (albedo, albedo / tint))
    kept = after / before
    assert kept.max() < 1 + 1e-4
    lit, skin = light[0] > 0.95 * light.max(), truth[0] > truth[2]
    assert kept[lit & skin].min() > 0.99
    assert kept[lit & ~skin].max() < 0.8
    assert kept[light[0] < 0.3].max() < kept[lit].max() - 0.2


def test_saturated_cloth_neither_tells_the_light_nor_is_changed_by_it():
    """A camera cuts saturated colours to its gamut, and what is left of the small channels is no colour."""
    seen, _ = canvas()
    encoded, light, albedo, normals, known = seen
    before = OldLight.fit(*seen)
    cloth = torch.arange(known.shape[1]) % 4 < 2
    shadow = light.mean(dim=0) < light.mean()
    albedo = albedo.clone()
    albedo[:, :, cloth] = torch.tensor([0.5, 0.02, 0.02]).view(3, 1, 1)
    albedo[2] = torch.where(cloth & shadow, 0.01, albedo[2])  # bluer in the sun
    encoded = torch.where(cloth, encoded.clamp_min(0.1), encoded)
    found = OldLight.fit(encoded, light, albedo, normals, known)
    assert found.ambient == pytest.approx(before.ambient, abs=0.03)
    assert (found.tint(light, albedo, normals, known)[:, :, cloth] - 1).abs().max() < 0.01


def test_colours_sharpen_the_shadow_of_a_network_that_blurs_it(monkeypatch):
    """The share by brightness is soft at a shadow's edge; the colours of sun and sky are not."""
    from scipy.ndimage import gaussian_filter

    sun, sky = (1.0, 0.75, 0.5), (0.7, 0.95, 1.35)
    (_, level, albedo, normals, known), truth = canvas(sun, sky, size=192)
    soft = torch.from_numpy(gaussian_filter(level[0].numpy(), 4)).expand(3, -1, -1)
    albedo = albedo * level / soft
    red, green, blue = np.log(np.divide(sky, sun))
    old = OldLight(ambient=(red - green, blue - green), ambient_level=0.2)
    after = spread(albedo / old.tint(soft, albedo, normals, known), truth)
    monkeypatch.setattr(old_light, "by_colour", lambda share, *_: share)
    before = spread(albedo / old.tint(soft, albedo, normals, known), truth)
    assert before > 0.08
    assert after < 0.9 * before
