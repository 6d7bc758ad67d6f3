"""What of a plate is the person: mattes, edges, and what is behind them."""

import numpy as np
import pytest
import torch
from helpers.standins import Delighter, analysed, ball, image_of
from scipy.ndimage import gaussian_filter

import relight
from relight.analysis.foreground import Foreground

LEFT = relight.DirectionalLight(azimuth=-60, name="left")


def test_a_portrait_crop_is_not_darkened_at_the_frame():
    coverage, _ = ball(250, 170, centre=(0.5, 1.0), radius=0.9)  # cut by three sides of the frame
    assert coverage[-1].min() == 1
    grey = Delighter(lambda rgb, mask: torch.full_like(rgb, 0.5))
    image, normals = image_of(coverage, (0.4, 0.4, 0.4)), np.full((250, 170, 3), (0.0, 0.0, 1.0))
    subject = analysed(image, shader=grey, normals=normals)
    # One colour in one light, so one albedo. Black from beyond the frame would pass for shadow.
    np.testing.assert_allclose(subject.albedo[coverage > 0.5], 0.5, atol=0.01)
    np.testing.assert_allclose(subject.normals[-1], np.full((170, 3), (0, 0, 1)), atol=1e-4)


def test_a_transparent_corner_far_from_the_subject_is_harmless():
    coverage, _ = ball(200, 160, radius=0.2)
    coverage[:3, :3] = 0.2
    black = image_of(coverage)
    black[:3, :3, :3] = 0
    for image in (image_of(coverage), black):
        subject = relight.Subject(image)
        picture = subject.relit(LEFT)
        assert np.isfinite(subject.albedo).all()
        assert np.isfinite(picture).all()
        np.testing.assert_array_equal(picture[..., 3], coverage)


@pytest.mark.parametrize("behind", [(0.9, 0.9, 0.9), (0.01, 0.01, 0.01), (0.05, 0.5, 0.05)])
def test_strands_at_a_soft_edge_keep_their_own_colour(behind):
    """Dark and light strands, over a background that fits neither."""
    x = torch.arange(96).float()
    matte = ((70 - x) / 20).clamp(0, 1).expand(64, 96)
    strands = torch.where(torch.arange(64) // 4 % 2 == 0, 0.4, 0.08)
    own = (strands[:, None, None] * torch.tensor([1.0, 0.7, 0.4])).expand(64, 96, 3).numpy()
    alpha = matte[..., None].numpy()
    plate = np.float32(alpha * own + (1 - alpha) * np.float32(behind))
    person = Foreground.of(matte, matte, photographed=True)
    found = np.zeros_like(plate)
    found[person.box] = person.own_colour(plate).permute(1, 2, 0).numpy()
    soft = (matte.numpy() > 0.3) & (matte.numpy() < 0.98)
    assert np.sqrt(((found - own)[soft] ** 2).mean()) < 0.08


@pytest.mark.parametrize("behind", [(0.9, 0.9, 0.9), (0.01, 0.01, 0.01)])
def test_a_feathered_edge_shows_no_line_of_the_old_background(behind):
    coverage, normals = ball(240, 180, soft=2)
    front = np.array([0.4, 0.2, 0.1])
    photo = (coverage[..., None] * front + (1 - coverage[..., None]) * behind).astype(np.float32)
    grey = Delighter(lambda rgb, mask: torch.full_like(rgb, 0.5) * (mask > 0))
    subject = analysed(photo, coverage, grey, normals=normals, feather=4)
    feathered = gaussian_filter(coverage, 4, mode="nearest")
    np.testing.assert_allclose(subject.matte, feathered, atol=1e-5)
    # Over grey, against the exact composite: the person's one colour, in one light, by the feathered matte.
    colour = subject.albedo[np.unravel_index(np.argmax(feathered), feathered.shape)]
    line = (subject.albedo - colour) * feathered[..., None]
    assert np.sqrt((line[(feathered > 0.02) & (feathered < 0.98)] ** 2).mean()) < 0.003
    with pytest.raises(ValueError, match="feather: expected a number from 0 to 12, got 13"):
        relight.Subject(photo, mask=coverage, feather=13)


def test_lights_are_fitted_to_the_edge_before_it_was_feathered(tmp_path):
    coverage, normals = ball(240, 180, radius=0.15, soft=2)
    shade = 0.2 + 0.4 * normals @ np.float32([0.6, 0, 0.8]).clip(0)
    photo = (coverage[..., None] * shade[..., None] + (1 - coverage[..., None]) * 0.9).repeat(3, -1)
    one, feathered = (relight.Subject(photo, mask=coverage, normals=normals, feather=f) for f in (0, 6))
    feathered.save(tmp_path / "kept.safetensors")
    kept = relight.Subject.load(tmp_path / "kept.safetensors")
    expected = one.fit_lighting(photo)[1].sum(0)
    for subject in (feathered, kept):
        np.testing.assert_allclose(subject.fit_lighting(photo)[1].sum(0), expected, rtol=0.01)


def test_soft_edges_hold_neither_background_nor_black():
    coverage, normals = ball(480, 360, soft=16)
    front, back = np.array([0.4, 0.4, 0.4]), np.array([0.02, 0.9, 0.05])
    photo = (coverage[..., None] * front + (1 - coverage[..., None]) * back).astype(np.float32)
    grey = Delighter(lambda rgb, mask: torch.full_like(rgb, 0.5) * (mask > 0))
    subject = analysed(photo, coverage, grey, normals=normals)
    covered = coverage > 0
    # One colour in one light: the albedo is 0.5 to the last pixel of the edge, no green, no dark rim.
    np.testing.assert_allclose(subject.albedo[covered], 0.5, atol=0.02)
    picture = subject.relit(relight.DirectionalLight())
    filled = relight.over(picture, back)
    colour = picture[..., :3] / np.maximum(picture[..., 3:], 1e-6)
    edge = (coverage > 0.02) & (coverage < 0.98)
    assert np.ptp(colour[edge], axis=-1).max() < 0.05
    expected = colour * coverage[..., None] + back * (1 - coverage[..., None])
    np.testing.assert_allclose(filled, expected, atol=1e-5)


def test_a_hard_masks_rim_holds_no_background():
    coverage, normals = ball(480, 360)
    coverage[40:60, 100:102] = 1  # a feather in the hat, all rim
    blue = np.zeros((480, 360, 1)) + (np.arange(480) < 62)[:, None, None]
    front = np.where(blue > 0, (0.1, 0.1, 0.6), (0.4, 0.4, 0.4))
    photo = coverage[..., None] * front + (1 - coverage[..., None]) * (0.02, 0.9, 0.05)
    paint = Delighter(lambda rgb, mask: rgb * (mask > 0))
    mask = coverage > 0.3  # as segmentation networks and a magic wand cut: half-covered pixels count as whole
    albedo = analysed(photo.astype(np.float32), mask, paint, normals=normals).albedo
    ball_only = mask & (blue[..., 0] == 0)
    assert np.ptp(albedo[ball_only], axis=-1).max() < 0.01  # grey to the last pixel
    feather = albedo[40:60, 100:102]
    assert (feather[..., 2] > 3 * feather[..., 1]).all()  # and its own colour, having no other


@pytest.mark.parametrize("fade", [(0.92, 0.97), (0.85, 0.85), (0.8, 0.88), (0.65, 0.75)])
def test_a_translucent_matte_keeps_the_persons_colours(fade):
    coverage, normals = ball(240, 180, soft=4)
    rows = np.linspace(0, 1, 240, dtype=np.float32)[:, None]
    stripes = 0.3 + 0.2 * (np.sin(rows * 60) > 0) + np.zeros((240, 180))
    photo = coverage[..., None] * stripes[..., None] + (1 - coverage[..., None]) * (0.02, 0.9, 0.05)
    paint = Delighter(lambda rgb, mask: rgb * (mask > 0))
    photo = photo.astype(np.float32)
    mattes = coverage, coverage * (fade[0] + (fade[1] - fade[0]) * rows)
    solid, faded = (analysed(photo, matte, paint, normals=normals).albedo for matte in mattes)
    inside = coverage == 1
    np.testing.assert_allclose(faded[inside], solid[inside], atol=0.02)


def test_straight_and_premultiplied_sources_agree():
    coverage, normals = ball(200, 160, soft=8)
    premultiplied = image_of(coverage)
    codes = np.full((200, 160, 4), 188, np.uint8)  # straight: one colour everywhere, transparent or not
    linear = ((188 / 255 + 0.055) / 1.055) ** 2.4
    premultiplied[..., :3] = coverage[..., None] * linear
    codes[..., 3] = np.round(coverage * 255)
    from_floats = relight.Subject(premultiplied, normals=normals).relit(LEFT)
    from_codes = relight.Subject(codes, normals=normals).relit(LEFT)
    np.testing.assert_allclose(from_codes, from_floats, atol=5e-3)


def test_maps_are_continued_under_a_wide_soft_edge():
    coverage, _ = ball(480, 360, radius=0.3, soft=60)
    facing = np.where(coverage[..., None] > 0.5, (0.6, 0.0, 0.8), 0)  # known inside only
    normals = relight.Subject(image_of(coverage), normals=facing).normals
    np.testing.assert_allclose(normals[coverage > 0] @ (0.6, 0, 0.8), 1, atol=1e-3)


@pytest.mark.slow
def test_a_mask_replaces_the_alpha_and_may_be_integer():
    coverage, normals = ball(120, 90)
    smaller = ball(120, 90, radius=0.25)[0]
    picture = relight.Subject(image_of(coverage), mask=smaller, normals=normals).relit(LEFT)
    np.testing.assert_array_equal(picture[..., 3], smaller)
    codes = np.round(smaller * 255).astype(np.uint8)
    picture = relight.Subject(image_of(coverage), mask=codes, normals=normals).relit(LEFT)
    np.testing.assert_allclose(picture[..., 3], smaller, atol=1 / 255)
    whole = relight.Subject(image_of(coverage), mask=smaller > 0.5, normals=normals).relit(LEFT)
    assert set(np.unique(whole[..., 3])) == {0, 1}


def test_masks_of_either_byte_order_are_one(person):
    rgb, mask = person
    codes = (mask * 65535).astype(np.uint16)
    pictures = [relight.apply(rgb, LEFT, mask=each) for each in (codes, codes.astype(">u2"))]
    np.testing.assert_array_equal(*pictures)


def test_a_person_does_not_hold_the_memory_of_the_whole_matte():
    matte = torch.zeros(200, 300)
    matte[50:90, 100:130] = 1
    person = Foreground.of(matte, matte.clone(), photographed=True)
    assert person.matte.shape == (42, 32)
    for kept in (person.alpha, person.matte):
        assert kept.untyped_storage().nbytes() == kept.nbytes


@pytest.mark.parametrize("side", [16, 600])  # 600: so large that its memory is allocated page by page
def test_pixels_are_put_where_the_person_is(side):
    alpha = torch.zeros(side, side)
    alpha[side // 4 : side // 2, side // 8 : side // 3] = 1
    person = Foreground.of(alpha, alpha, photographed=True)
    values = torch.rand(len(person.pixels), 3)
    image = person.scatter(values)
    np.testing.assert_array_equal(image[alpha.numpy() > 0], values.numpy())
    assert image.shape == (side, side, 3)
    assert not image[alpha.numpy() == 0].any()
    image[0, 0] = 1  # and it can be written


def test_a_loose_matte_of_somebody_bright_does_not_shine_before_black():
    """The photograph bounds what a soft edge gives: the white of a sleeve is not put where black is seen."""
    plate = np.zeros((60, 80, 3), np.float32)
    plate[:, :40] = 0.9
    alpha = np.zeros((60, 80), np.float32)
    alpha[:, :40], alpha[:, 40:46] = 1, (0.8, 0.6, 0.4, 0.2, 0.04, 0.02)  # the edge is six pixels too far out
    person = Foreground.of(*[torch.from_numpy(alpha)] * 2, True)
    found = person.own_colour(plate).permute(1, 2, 0).numpy() * alpha[:, : person.alpha.shape[1], None]
    seen = plate[:, : found.shape[1]]
    assert (found - seen).max() < 1e-6
    np.testing.assert_allclose(found[:, 2:38], seen[:, 2:38], atol=1e-3)


def test_hairs_before_a_bright_wall_have_their_own_colour():
    """The composite over black shows neither the wall nor a dark contour."""
    size, random = (80, 80), np.random.default_rng(0)
    alpha = np.zeros(size, np.float32)
    alpha[:, :30] = 1
    for row in range(2, 78, 4):  # hairs 1.6 pixels thick, that grow from the person and fade
        fade = np.linspace(1, 0.3, 40)
        alpha[row, 30:70], alpha[row + 1, 30:70] = 0.9 * fade, 0.5 * fade
    tones = np.repeat(random.uniform(0.02, 0.3, 20), 4)[:, None, None]  # each hair has its own
    own = np.broadcast_to(np.float32(tones * [1, 0.7, 0.5]), (*size, 3))
    wall = 0.7 + 0.2 * np.sin(np.arange(80) / 9)[:, None, None] * np.ones((80, 80, 3))
    plate = np.float32(alpha[..., None] * own + (1 - alpha[..., None]) * wall)
    person, coverage = Foreground.of(*[torch.from_numpy(alpha)] * 2, True), alpha[:, 31:69, None]
    found = person.own_colour(plate).permute(1, 2, 0).numpy()[:, 31:69]
    error = (found - own[:, 31:69]) * coverage
    assert np.sqrt((error**2).mean()) < 0.009
    assert abs(error.mean()) < 0.003
