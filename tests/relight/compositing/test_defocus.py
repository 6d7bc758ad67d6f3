"""The blur of a background is that of a lens: a point becomes a disc, and no light is lost."""

import numpy as np
import pytest

import relight
from relight.compositing.defocus import defocused


@pytest.mark.parametrize("share", [0.02, 0.1])
def test_a_point_becomes_a_disc_of_the_same_light(share):
    picture = np.zeros((240, 320, 3), np.float32)
    picture[120, 160] = 6, 3, 1
    blurred = defocused(picture, share)
    np.testing.assert_allclose(blurred.sum(axis=(0, 1)), (6, 3, 1), rtol=0.02)
    lit = blurred[..., 0] > 0.1 * blurred[..., 0].max()
    radius = np.sqrt(lit.sum() / np.pi)
    assert radius == pytest.approx(share * 240, rel=0.3)


def test_a_plain_background_and_no_blur_change_nothing():
    plain = np.full((50, 37, 3), 0.3, np.float32)
    np.testing.assert_allclose(defocused(plain, 0.1), plain, rtol=1e-5)
    noise = np.random.default_rng(0).random((20, 20, 3), np.float32)
    assert defocused(noise, 0) is noise


def test_the_word_blur_is_the_photograph_out_of_focus():
    lighting = relight.Lighting(relight.DirectionalLight(azimuth=10), background="blur")
    assert (lighting.background, lighting.background_blur) == ("plate", 0.02)
    with pytest.raises(ValueError, match="background_blur"):
        relight.Lighting(relight.DirectionalLight(azimuth=10), background_blur=0.5)


def test_a_shot_blurs_what_is_behind_the_person_and_not_the_person(tmp_path, person):
    rgb, mask = person
    key = relight.DirectionalLight(azimuth=-40, name="key")
    checks = np.indices((200, 160)).sum(axis=0) % 2 * np.ones((3, 1, 1))
    pictures = []
    for share in (0.0, 0.05):
        lighting = relight.Lighting(key, background=checks.transpose(1, 2, 0), background_blur=share)
        relight.render_shot(relight.Source(rgb, mask=mask), lighting, tmp_path / "a.exr")
        pictures.append(relight.read(tmp_path / "a.exr"))
    sharp, blurred = pictures
    assert sharp[:10].std() > 0.4
    assert blurred[:10].std() < 0.1
    inside = mask == 1
    np.testing.assert_allclose(blurred[inside], sharp[inside], atol=2e-3)
