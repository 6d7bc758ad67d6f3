import io
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from scipy import ndimage

import relight
from relight.analysis.denoising import denoised
from relight.analysis.upsampling import encode_guide
from relight.media.colour import encode
from relight.media.images import scene_linear
from shadow.data.records import Records
from shadow.framing import Framing

SIZE = (128, 96)
SENSOR_NOISE = 4  # codes
PIPING = np.arange(SIZE[1]) % 24 < 3
BETWEEN = np.isin(np.arange(SIZE[1]) % 24, range(6, 21))  # columns away from the piping
DATA = Path(__file__).parents[2] / "data"
BLACK, SKIN, DENIM, ORANGE = (0.03, 0.03, 0.03), (0.5, 0.32, 0.22), (0.08, 0.12, 0.3), (0.8, 0.25, 0.05)


def cloth(paint, light, quality=75):
    """Woven cloth with orange piping, in light above and in shadow below.

    Returns codes (H, W, 3), the light (3, H, W) and the true albedo (H, W, 3).
    With a `quality` the codes have a sensor's noise and are those of a JPEG.
    """
    generator = torch.Generator().manual_seed(0)
    weave = 1 + 0.15 * torch.randn(SIZE, generator=generator)
    truth = torch.tensor(paint).view(3, 1, 1) * weave.clamp_min(0.3)
    truth[:, :, PIPING] = torch.tensor(ORANGE).view(3, 1, 1)
    levels = torch.full((1, *SIZE), 1.2)
    levels[:, SIZE[0] // 2 :] = light
    encoded = 255 * encode((truth * levels).permute(1, 2, 0).numpy())
    if not quality:
        return np.uint8(np.round(encoded)), levels.expand(3, -1, -1), truth.permute(1, 2, 0).numpy()
    noise = np.random.default_rng(0).normal(0, SENSOR_NOISE, encoded.shape)
    data = io.BytesIO()
    Image.fromarray(np.uint8((encoded + noise).clip(0, 255).round())).save(data, "jpeg", quality=quality)
    codes = np.array(Image.open(data))
    return codes, levels.expand(3, -1, -1), truth.permute(1, 2, 0).numpy()


def mended(codes, light):
    """The person's colour (H, W, 3), with all of the plate on a canvas of its own size."""
    colour = torch.from_numpy(scene_linear("codes", codes)).flatten(0, 1)
    framing = Framing((SIZE[1] / 2, SIZE[0] / 2), 1.0, SIZE, SIZE)
    image = encode_guide(colour).T.unflatten(1, SIZE)
    known, pixels = torch.ones(SIZE, dtype=torch.bool), torch.arange(len(colour))
    return denoised(colour, 1.0, pixels, framing, image, known, light).view(*SIZE, 3).numpy()


def shadow_error(colour, light, truth):
    """RMS of the chroma's error, encoded, and the ratio of lightness, away from the shadow's edge."""
    albedo, truth = (
        np.float32(image[SIZE[0] // 2 + 8 :, BETWEEN])
        for image in (colour / light.permute(1, 2, 0).numpy(), truth)
    )
    wrong = encode(albedo) - encode(truth)
    chroma = wrong - wrong.mean(axis=-1, keepdims=True)
    return float(np.sqrt((chroma**2).mean())), float(albedo.mean() / truth.mean())


@pytest.mark.parametrize("quality", [75, 90])
def test_black_cloth_in_an_old_shadow_stays_black_and_uniform(quality):
    codes, light, truth = cloth(BLACK, 0.08, quality)
    before, _ = shadow_error(scene_linear("codes", codes), light, truth)
    after, lightness = shadow_error(mended(codes, light), light, truth)
    assert before > 0.01
    assert after < 0.5 * before
    assert lightness == pytest.approx(1, abs=0.15)


@pytest.mark.parametrize("paint", [SKIN, DENIM])
def test_colour_in_shadow_stays(paint):
    codes, light, truth = cloth(paint, 0.15, quality=None)
    after, lightness = shadow_error(mended(codes, light), light, truth)
    assert after < 0.02
    assert lightness == pytest.approx(1, abs=0.05)


def test_channels_that_a_camera_cut_to_black_become_those_of_a_dye():
    """Denim in shadow, of codes 2, 6, 33: its albedo would be sixty times as blue as red."""
    codes = np.full((*SIZE, 3), (2, 6, 33), np.uint8)
    light = torch.full((3, *SIZE), 0.07)
    before, after = (colour / 0.07 for colour in (scene_linear("codes", codes), mended(codes, light)))
    assert (before[..., 0] < 0.01).all()
    assert (after.argmax(axis=-1) == 2).all()
    assert (after.min(axis=-1) > 0.02).all()
    np.testing.assert_allclose(after.mean(axis=-1), before.mean(axis=-1), rtol=1e-4)


@pytest.mark.parametrize("cut", [(60, 9, 1), (2, 12, 15), (1, 14, 9)])
def test_channels_near_black_do_not_turn_the_hue(cut):
    """Rust, teal and green cloth in shadow: a channel raised alone would be larger than the middle one."""
    codes = np.full((*SIZE, 3), cut, np.uint8)
    after = mended(codes, torch.full((3, *SIZE), 0.1))[0, 0]
    before = scene_linear("codes", codes)[0, 0]
    assert after.min() / after.mean() > 2 * before.min() / before.mean()
    turned, hue = ((colour - colour.min()) / np.ptp(colour) for colour in (after, before))
    np.testing.assert_allclose(turned, hue, atol=0.01)


def test_dark_cloth_with_clear_codes_keeps_its_colour_in_shadow():
    """Its codes, 24 and more, tell a channel that is darker than most dyes."""
    codes = np.full((*SIZE, 3), (24, 40, 70), np.uint8)
    light = torch.full((3, *SIZE), 0.4)
    before, after = scene_linear("codes", codes), mended(codes, light)
    assert before[..., 0].max() / 0.4 < 0.025
    np.testing.assert_allclose(after, before, rtol=0.02)


def test_lightness_is_uniform_near_black_and_keeps_texture_elsewhere():
    rng = np.random.default_rng(0)
    light = torch.full((3, *SIZE), 0.1)
    for low, high, least, most in ((2, 9, 0.0, 0.5), (60, 90, 0.99, 1.01)):
        codes = np.uint8(np.repeat(rng.integers(low, high, (*SIZE, 1)), 3, axis=2))
        variation = [
            np.float32(encode(colour)).mean(axis=-1).std()
            for colour in (scene_linear("codes", codes), mended(codes, light))
        ]
        assert least < variation[1] / variation[0] < most


def test_nothing_changes_where_the_light_is_bright():
    codes, light, _ = cloth(BLACK, 0.08)
    lit = np.s_[: SIZE[0] // 2 - 1]
    np.testing.assert_array_equal(mended(codes, light)[lit], scene_linear("codes", codes)[lit])


def test_a_person_in_black_has_less_colour_in_shadow():
    """Through the networks: the albedo against the photograph over the same light."""
    record = Records([DATA])[0]
    key = record.directions[:, 0] > 0.8
    light = record.visibility[:, key].mean(axis=1, keepdims=True) + 0.03
    clean = record.image(np.float32(record.albedo * 0.1 * light)).permute(1, 2, 0).numpy()
    noise = np.random.default_rng(0).normal(0, SENSOR_NOISE, clean.shape)
    codes = np.uint8((255 * encode(clean) + noise).clip(0, 255).round())
    subject = relight.Subject(codes, record.mask)
    light = np.maximum(subject.upsampled(subject.record.maps.light), 1e-6)
    dark = ndimage.binary_erosion(record.mask, iterations=4) & (light.mean(axis=-1) < 0.3)
    noisy = scene_linear("codes", codes) / light
    wrong = [
        encode(np.float32(image)) - encode(np.float32(clean / light)) for image in (noisy, subject.albedo)
    ]
    before, after = (np.abs(error - error.mean(axis=-1, keepdims=True))[dark].mean() for error in wrong)
    assert after < 0.6 * before


def test_a_given_albedo_leaves_the_photograph_alone():
    photograph = np.full((64, 48, 4), 0.002, np.float32)
    photograph[..., 3] = 1
    photograph[8:56, 12:36, 0] = 0.004
    matte = np.zeros((64, 48), np.float32)
    matte[8:56, 12:36] = 1
    subject = relight.Subject(photograph[..., :3], matte, np.full((64, 48, 3), 0.03, np.float32))
    colour = subject.record.colour
    assert torch.allclose(colour, torch.tensor([0.004, 0.002, 0.002]).expand_as(colour), atol=1e-6)
