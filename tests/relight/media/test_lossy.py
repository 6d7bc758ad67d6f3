"""JPEG and WebP: their quality, and what a WebP holds beside colours."""

import numpy as np
import pytest

import relight
from relight.media import images
from relight.media.content_hash import HASH_ATTRIBUTE


@pytest.fixture
def picture():
    smooth = np.linspace(40, 220, 64)[:, None] + np.linspace(-30, 30, 48)[:, None, None]
    codes = (smooth + np.random.default_rng(0).normal(0, 3, (48, 64, 4))).clip(0, 255).astype(np.uint8)
    codes[..., 3] = np.where(np.arange(64) < 32, 255, 0)
    return codes


def test_webp_keeps_alpha_and_colours_and_its_hash(here, picture):
    relight.write("a.webp", picture, metadata={HASH_ATTRIBUTE: "ab" * 16})
    found = relight.read("a.webp")
    np.testing.assert_array_equal(found[..., 3] > 0.5, picture[..., 3] > 127)
    shown = images.scene_linear("picture", picture)
    assert np.abs(found[:, :30, :3] - shown[:, :30, :3]).mean() < 0.02
    assert images.read_content_hash("a.webp") == "ab" * 16


@pytest.mark.parametrize("suffix", [".webp", ".jpg"])
def test_a_lower_quality_gives_a_smaller_file(here, picture, suffix):
    sizes = []
    for quality in (None, 98, 50):
        relight.write(f"a{suffix}", picture[..., :3], quality=quality)
        sizes.append((here / f"a{suffix}").stat().st_size)
    assert sizes[0] == sizes[1] > 1.2 * sizes[2]


def test_what_a_webp_cannot_hold_is_refused(here):
    with pytest.raises(ValueError, match="webp holds at most 16383 pixels a side"):
        relight.write("a.webp", np.zeros((1, 16400, 3), np.uint8))


def test_a_shot_is_reduced_to_its_longest_side(here, stub):
    codes = np.full((40, 60, 4), 200, np.uint8)
    codes[:, 30:, 3] = 0
    relight.write("me.png", codes)
    lights, paths = relight.DirectionalLight(azimuth=0), ["small.png", "small.webp", "full.exr"]
    stub.render("me.png", [lights], paths, longest_side=30, quality=80)
    assert [relight.read(path).shape[:2] for path in paths] == [(20, 30), (20, 30), (40, 60)]
