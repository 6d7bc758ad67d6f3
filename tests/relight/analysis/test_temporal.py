import numpy as np
import pytest
import torch

import relight
from relight.analysis import temporal
from relight.analysis.camera import Camera
from relight.analysis.depth import WorldGeometry
from relight.analysis.light_field import ANCHORS, LightField
from relight.analysis.maps import AnalysisMaps
from relight.analysis.temporal import temporally_filtered
from shading.diffuse import RESIDUAL_BIAS
from shadow.framing import Framing, affine_sample
from shadow.networks.mirror import Pixels

SIZE = (128, 96)
TEXTURE = torch.nn.functional.interpolate(
    torch.rand(1, 3, 32, 24, generator=torch.Generator().manual_seed(1)), SIZE, mode="bicubic"
)[0].clamp(0, 1)


def canvas(shading, image=TEXTURE, framing=None, known=None):
    """A frame whose shading under every light is `shading` (h, w)."""
    if known is None:
        known = torch.zeros(SIZE, dtype=torch.bool)
        known[10:-10, 10:-10] = True
    maps, silhouette = shading * known, Pixels(known)
    values = silhouette.take(maps[None] + RESIDUAL_BIAS)  # of a surface that faces no light, from residuals
    count, anchors = len(silhouette.pixels), len(ANCHORS)
    residual = values.expand(anchors, -1)
    field = LightField(
        silhouette,
        torch.zeros(3, count),
        torch.ones(1, count),
        torch.zeros(anchors, count),
        residual,
        torch.ones(1, count),
    )
    framing = framing or Framing((48.0, 64.0), 1.0, SIZE, SIZE)
    up = torch.tensor([0.0, 0, 1])[:, None, None].expand(3, *SIZE)
    light = maps.expand(3, -1, -1) + 0.1
    space = WorldGeometry(Camera(SIZE, 100.0, (48.0, 64.0), 2.0, SIZE[0]), framing, lambda: maps[0])
    return AnalysisMaps(framing, known, image * known, up, field, image * known, light, space)


def shown(frame):
    return frame.shading(temporal.PROBE_LIGHTS[:1])[0]


def test_trembling_averages_out():
    random = torch.Generator().manual_seed(0)
    frames = [canvas(0.5 + 0.02 * torch.randn(SIZE, generator=random)) for _ in range(5)]
    steady = temporally_filtered(frames[2], frames[:2] + frames[3:])
    inside = np.s_[14:-14, 14:-14]
    assert shown(steady)[inside].std() < 0.6 * shown(frames[2])[inside].std()
    assert steady.light[(0, *inside)].std() < 0.6 * frames[2].light[(0, *inside)].std()
    np.testing.assert_allclose(shown(steady)[inside].mean(), 0.5, atol=2e-3)
    np.testing.assert_allclose(steady.normals.norm(dim=0), 1, atol=1e-5)


def test_a_moving_shadow_is_not_smeared():
    x = torch.arange(SIZE[1], dtype=torch.float32)
    frames = [canvas((0.8 * torch.sigmoid(2 * (x - 40 - 4 * t))).expand(SIZE)) for t in range(5)]
    own = shown(frames[2])
    steady = shown(temporally_filtered(frames[2], frames[:2] + frames[3:]))
    plain = sum(map(shown, frames)) / 5
    assert (steady - own).abs().max() < 0.05
    assert (plain - own).abs().max() > 0.3


@pytest.mark.parametrize("shift", [(0.0, 0.0), (5.3, -2.6), (-11.0, 7.4)])
def test_the_person_is_followed(shift):
    """By canvas pixels, whether the content moves on the canvas or the canvas moves on the plate."""
    bowl = (torch.linspace(-1, 1, SIZE[0])[:, None] ** 2 + torch.linspace(-1, 1, SIZE[1]) ** 2) / 2
    here = canvas(bowl)
    person = torch.cat([TEXTURE, here.known[None].float(), bowl[None]])
    matrix = torch.tensor([[1, 0, -shift[0]], [0, 1, -shift[1]]])
    moved = affine_sample(person, matrix, SIZE)
    there = canvas(moved[4], moved[:3], known=moved[3] > 0.5)
    inside = np.s_[25:-25, 25:-25]
    np.testing.assert_allclose(shown(temporally_filtered(here, [there]))[inside], bowl[inside], atol=0.02)


def test_a_new_framing_is_no_motion():
    person = torch.cat([TEXTURE, torch.linspace(0, 1, SIZE[1]).expand(1, *SIZE)])
    plate = torch.nn.functional.interpolate(person[None], (256, 192), mode="bicubic")[0].clamp(0, 1)
    framings = [Framing((96.0, 128.0), 0.5, SIZE, (256, 192)), Framing((110.0, 115.0), 0.6, SIZE, (256, 192))]
    here, there = (canvas(crop[3], crop[:3], f) for f in framings for crop in [f.crop(plate)])
    inside = np.s_[25:-25, 25:-25]
    assert np.abs(shown(there) - shown(here))[inside].max() > 0.1
    np.testing.assert_allclose(
        shown(temporally_filtered(here, [there]))[inside], shown(here)[inside], atol=0.01
    )


def test_each_limb_is_followed():
    """Two halves of the person that move apart: both find themselves in the other frame."""
    ramp = torch.linspace(0.1, 0.9, SIZE[0])[:, None].expand(SIZE)
    there_image, there_shading = torch.empty_like(TEXTURE), torch.empty(SIZE)
    for columns, shift in ((slice(0, 48), 6), (slice(48, 96), -5)):
        there_image[..., columns] = TEXTURE[..., columns].roll(shift, dims=-2)
        there_shading[:, columns] = ramp[:, columns].roll(shift, dims=0)
    here, there = canvas(ramp), canvas(there_shading, there_image)
    steady = shown(temporally_filtered(here, [there]))
    for columns in (slice(16, 40), slice(56, 80)):
        middle = np.s_[30:-30, columns]
        np.testing.assert_allclose(steady[middle], ramp[middle], atol=0.01)


def test_what_a_limb_hides_in_the_other_frame_is_kept():
    """A limb that covers a part of the chest in the other frame adds nothing to the chest."""
    here = canvas(torch.full(SIZE, 0.6))
    image, shading = TEXTURE.clone(), torch.full(SIZE, 0.6)
    image[:, 40:80, 30:60], shading[40:80, 30:60] = TEXTURE[:, 80:120, 60:90].flip(1), 0.35
    steady = shown(temporally_filtered(here, [canvas(shading, image)]))
    assert (steady[45:75, 35:55] - 0.6).abs().mean() < 0.03


def test_where_the_others_know_nothing_the_frame_is_kept():
    half = torch.zeros(SIZE, dtype=torch.bool)
    half[10:-10, 10:48] = True
    frame, other = canvas(torch.full(SIZE, 0.5)), canvas(torch.full(SIZE, 0.54), known=half)
    steady = shown(temporally_filtered(frame, [other]))
    np.testing.assert_allclose(steady[20:-20, 60:-12], 0.5, atol=1e-6)
    assert 0.505 < steady[64, 30] < 0.52
    np.testing.assert_array_equal(shown(temporally_filtered(frame, [])), shown(frame))


@pytest.mark.slow
def test_a_temporally_filtered_subject_is_linear_and_steadier():
    random = np.random.default_rng(0)
    y, x = (np.mgrid[:160, :120] + 0.5 - [[[80]], [[60]]]) / 55
    alpha = (np.hypot(x, y) < 1).astype(np.float32)[..., None]
    clean = (0.2 + 0.3 * np.stack([x**2, y**2, 0.5 + 0 * x], -1)) * alpha
    frames = []
    for _ in range(3):
        noisy = (clean + random.normal(0, 0.03, clean.shape) * alpha).clip(0)
        frames.append(relight.Subject(np.concatenate([noisy, alpha], axis=-1).astype(np.float32)))
    steady = frames[1].temporally_filtered([frames[0], frames[2]])
    key, fill = relight.DirectionalLight(azimuth=-50, angle=20), relight.DirectionalLight(elevation=60)
    both = steady.relit([key, fill])
    np.testing.assert_allclose(
        both[..., :3], (steady.relit(key) + steady.relit(fill))[..., :3], rtol=1e-5, atol=1e-6
    )
    np.testing.assert_array_equal(both[..., 3], alpha[..., 0])
    mean = sum(frame.lighting(key) for frame in frames) / 3
    before, after = (np.abs(subject.lighting(key) - mean).mean() for subject in (frames[1], steady))
    assert after < 0.7 * before
    assert not np.array_equal(steady.albedo, frames[1].albedo)
    np.testing.assert_array_equal(frames[1].temporally_filtered([]).relit(key), frames[1].relit(key))


@pytest.mark.slow
def test_frames_whose_albedo_is_given_are_filtered_by_such_alone(person):
    rgb, mask = person
    given = relight.Subject(rgb, mask, albedo=np.full_like(rgb, 0.5))
    found = relight.Subject(rgb, mask)
    for frame, other in ((given, found), (found, given)):
        with pytest.raises(ValueError, match="around: expected an albedo given for all of the frames"):
            frame.temporally_filtered([other])
    np.testing.assert_allclose(given.temporally_filtered([given]).albedo, given.albedo, atol=1e-5)
