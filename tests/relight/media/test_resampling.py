"""Resampling, and filling what is unknown of an image."""

import numpy as np
import OpenImageIO as oiio
import pytest

from relight.media.buffers import to_array, to_buffer
from relight.media.resampling import fill_unknown, resize


@pytest.mark.parametrize("size", [(17, 90), (128, 96), (3, 1), (40, 31)])
@pytest.mark.parametrize("channels", [(), (1,), (5,)])
def test_the_triangle_filter_agrees_with_openimageios(size, channels):
    image = np.random.default_rng(1).uniform(-1, 2, (40, 30, *channels)).astype(np.float32)
    region = oiio.ROI(0, size[1], 0, size[0], 0, 1, 0, int(np.prod(channels)))
    pixels = to_buffer(image.reshape(40, 30, -1))
    expected = to_array(oiio.ImageBufAlgo.resize(pixels, "triangle", roi=region))
    resized = resize(image, size, "triangle")
    assert resized.dtype == np.float32
    assert resized.shape == (*size, *channels)
    np.testing.assert_allclose(resized, expected.reshape(resized.shape), atol=2e-5)


@pytest.mark.parametrize("size", [(63, 47), (64, 48), (1, 9), (130, 129)])
def test_filling_agrees_with_openimageios_push_pull_and_keeps_what_is_known(size):
    rng = np.random.default_rng(0)
    image, known = rng.uniform(0, 1, (*size, 3)).astype(np.float32), rng.uniform(size=size) < 0.05
    known[0, 0] = True
    weighted = np.concatenate([image * known[..., None], known[..., None]], axis=-1)
    expected = to_array(oiio.ImageBufAlgo.fillholes_pushpull(to_buffer(weighted)))[..., :3]
    image[~known] = np.nan  # takes no part
    filled = fill_unknown(image, known)
    np.testing.assert_allclose(filled, expected, atol=1e-6)
    assert (filled[known] == image[known]).all()


def test_filling_an_image_of_which_nothing_is_known_gives_zero():
    image = np.ones((3, 5, 3), np.float32)
    assert not fill_unknown(image, np.zeros((3, 5), bool)).any()
