"""The background darkens and tints with the person's light, if that is asked for."""

import numpy as np
import pytest

import relight

RED = relight.DirectionalLight(azimuth=-40, intensity=0.5, colour=(1, 0.4, 0.2), name="red")
BEHIND = np.full((200, 160, 3), 0.3, np.float32)


def behind(tmp_path, person, share, name="a.exr"):
    rgb, mask = person
    path = tmp_path / name
    lighting = relight.Lighting(RED, background=BEHIND, background_light=share)
    relight.render_shot(relight.Source(rgb, mask=mask), lighting, relight.Output(path, exr_type="float"))
    return relight.read(path)[2, 2, :3]


def test_it_follows_the_person_s_light_and_is_linear_in_the_share(tmp_path, person):
    none, half, whole = (behind(tmp_path, person, share) for share in (0, 0.5, 1))
    np.testing.assert_allclose(none, 0.3, rtol=1e-5)
    np.testing.assert_allclose(half, (none + whole) / 2, rtol=1e-4)
    assert whole[0] > whole[1] > whole[2]
    assert whole[2] < 0.9 * none[2]


def test_the_photograph_as_its_own_background_keeps_its_codes_only_without_it(tmp_path, person):
    rgb, mask = person
    codes = np.uint8(np.round(rgb.clip(0, 1) * 255))
    shown = []
    for share in (0, 1):
        path = tmp_path / f"{share}.png"
        lighting = relight.Lighting(RED, background_light=share)
        relight.render_shot(relight.Source(codes, mask=mask), lighting, path)
        shown.append(relight.read(path)[2:6, 2:6])
    np.testing.assert_allclose(shown[0], relight.media.images.scene_linear("a", codes)[2:6, 2:6], atol=1e-3)
    assert shown[1][..., 2].mean() < 0.9 * shown[0][..., 2].mean()


@pytest.mark.parametrize("share", [-0.1, 1.5, float("nan")])
def test_other_shares_are_refused_by_name(share):
    with pytest.raises(ValueError, match="background_light"):
        relight.Lighting(RED, background_light=share)
