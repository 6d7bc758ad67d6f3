"""Filling what is unknown of an image."""

import numpy as np
import OpenImageIO as oiio
import pytest

from relight.media.buffers import to_array, to_buffer
from relight.media.resampling import fill_unknown


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
