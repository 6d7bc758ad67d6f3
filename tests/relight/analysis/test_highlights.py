"""Highlights on skin leave the albedo; what is pale by itself stays."""

import numpy as np
import pytest
import torch

import relight
from relight.analysis import highlights, skin
from relight.media.colour import luminance

SIZE = 128, 96
SKIN_COLOUR = torch.tensor([0.5, 0.28, 0.2])
PATCH = np.s_[..., 40:60, 40:56]


def face(patch):
    """Albedo and photograph of skin with a bright patch, `patch` of it skin, the rest white."""
    albedo = SKIN_COLOUR[:, None, None].repeat(1, *SIZE)
    grey = float(luminance(SKIN_COLOUR.numpy()))
    albedo[PATCH] = torch.lerp(torch.full((3,), grey), SKIN_COLOUR, patch)[:, None, None]
    image = (albedo * 0.6) ** (1 / 2.2)
    image[PATCH] = (albedo[PATCH] * 1.4) ** (1 / 2.2)
    return albedo, image


def paleness(albedo):
    red, green, _ = albedo[PATCH].mean(dim=(1, 2))
    return float(red / green)


def tint(albedo, image, places=None):
    """That of a face which covers the canvas, or of skin at `places` (h, w)."""
    places = torch.ones(SIZE) if places is None else places
    return highlights.tint(albedo, image, skin.Skin(places > 0.9, places, places))


def test_a_pale_patch_becomes_skin_of_its_lightness():
    albedo, image = face(0.4)
    after = albedo / tint(albedo, image)
    true = float(SKIN_COLOUR[0] / SKIN_COLOUR[1])
    assert paleness(albedo) < 1.3 < 1.45 < paleness(after) <= true + 0.01
    before, now = (luminance(each.permute(1, 2, 0).numpy()) for each in (albedo, after))
    np.testing.assert_allclose(now, before, rtol=0.01)


def test_white_cloth_and_what_is_not_at_skin_stay():
    albedo, image = face(0.4)
    assert tint(albedo, image, torch.zeros(SIZE)).allclose(torch.ones(()), atol=1e-4)
    albedo, image = face(0.0)  # neutral, as collars and teeth
    assert tint(albedo, image)[PATCH].allclose(torch.ones(()), atol=1e-3)


def test_a_blue_patch_on_skin_is_no_highlight():
    albedo, image = face(0.4)
    albedo[PATCH] = torch.tensor([0.2, 0.3, 0.6])[:, None, None]
    assert tint(albedo, image)[PATCH].allclose(torch.ones(()), atol=1e-2)


@pytest.mark.parametrize("cloth", [(0.3, 0.3, 0.3), (0.42, 0.36, 0.3)])
def test_a_sleeve_where_an_arm_is_stays(cloth):
    """Beige and grey cloth is paler than the face, and folds make it brighter."""
    albedo, image = face(1.0)
    places = torch.ones(SIZE)
    places[64:] = 0.7  # an arm
    sleeve = np.s_[..., 64:, :]
    albedo[sleeve] = torch.tensor(cloth)[:, None, None]
    image[sleeve] = (albedo[sleeve] * 0.6) ** (1 / 2.2)
    fold = np.s_[..., 96:104, 40:48]
    image[fold] = (albedo[fold] * 1.4) ** (1 / 2.2)
    assert tint(albedo, image, places)[fold].allclose(torch.ones(()), atol=0.02)


def test_what_has_not_the_colour_of_skin_at_a_face_is_hair_or_a_mask():
    albedo, image = face(0.4)
    blue = albedo.flip(0)
    assert tint(blue, image).equal(torch.ones_like(blue))


def test_without_its_network_no_skin_is_known(person):
    known = torch.ones(SIZE, dtype=torch.bool)
    assert skin.find(torch.full((3, *SIZE), 0.5), known) is None
    assert relight.Subject(*person).record.face is None


class Standing:
    """In place of the landmark network: somebody upright, seen or not."""

    def __init__(self, presence, turned=False):
        self.presence, self.turned = presence, turned

    def __call__(self, canvas):
        points = np.full((39, 5), 5, np.float32)
        points[:, :2] = 128
        places = {0: (128, 60), 9: (122, 72), 10: (134, 72), 11: (150, 100), 12: (106, 100)}
        places |= {1: (132, 52), 2: (136, 52), 3: (140, 52), 4: (124, 52), 5: (120, 52), 6: (116, 52)}
        for row, (x, y) in places.items():
            points[row, :2] = 256 - x if self.turned else x, y
        points[13:33, 3] = -5  # limbs are not seen
        return {"points": points[None], "presence": np.array([[self.presence]])}


@pytest.mark.parametrize("presence", [0.1, 0.9])
def test_a_face_is_where_the_landmarks_are(presence):
    known = torch.zeros(SIZE, dtype=torch.bool)
    known[8:120, 20:76] = True
    found = skin.find(torch.full((3, *SIZE), 0.5), known, Standing(presence))
    if presence < 0.5:
        assert found is None
        return
    rows, columns = found.face.nonzero(as_tuple=True)
    assert 20 < rows.float().mean() < 60
    assert abs(float(columns.float().mean()) - 48) < 6
    assert (found.sure <= found.places + 1e-6).all()
    assert found.places[~known].max() == 0


def test_a_face_that_is_turned_away_is_not_where_its_landmarks_are():
    known = torch.zeros(SIZE, dtype=torch.bool)
    known[8:120, 20:76] = True
    found = skin.find(torch.full((3, *SIZE), 0.5), known, Standing(0.9, turned=True))
    assert not found.face.any()
    assert found.places.max() == 0
