"""Motion between pictures: where content went, how sure that is; the caller's OpenCV is left as it was."""

import numpy as np
import pytest
import torch
from scipy import ndimage

from relight.media import optical_flow
from relight.media.optical_flow import both_motions, motion

cv2 = pytest.importorskip("cv2")


def texture(size=(96, 128)):
    random = np.random.default_rng(0)
    grey = ndimage.gaussian_filter(random.uniform(size=size), 1.5)
    grey = (grey - grey.min()) / np.ptp(grey)
    return torch.from_numpy(np.float32([grey, grey, grey]))


def shifted(picture, x, y):
    return torch.from_numpy(ndimage.shift(picture.numpy(), (0, y, x), order=3, mode="nearest")).clamp(0, 1)


@pytest.mark.parametrize("shift", [(0, 0), (3.5, -2), (-8, 6)])
def test_content_is_found_where_it_went(shift):
    here = texture()
    there = shifted(here, *shift)
    way = motion(here, there)
    middle = np.s_[..., 20:-20, 20:-20]
    y, x = np.mgrid[:96, :128] + 0.5
    expected = np.stack([x + shift[0], y + shift[1]])
    np.testing.assert_allclose(way.positions[middle], expected[middle], atol=0.3)
    np.testing.assert_allclose(way.moved(there)[middle], here[middle], atol=0.05)
    assert way.certainty[middle].min() > 0.8


def test_both_motions_are_those_of_each_way():
    here = texture()
    there = shifted(here, 3, -2)
    for found, expected in zip(
        both_motions(here, there), (motion(here, there), motion(there, here)), strict=True
    ):
        assert torch.equal(found.positions, expected.positions)
        assert torch.equal(found.certainty, expected.certainty)


def test_what_the_other_picture_hides_is_uncertain():
    """A patch moves to the right by six pixels over a background that stays."""
    background, patch = texture((160, 200)), texture((300, 300))[:, 100:220, 100:200]
    here, there = background.clone(), background.clone()
    here[:, 20:140, 40:140], there[:, 20:140, 46:146] = patch, patch
    certainty = motion(here, there).certainty[0]
    hidden, moved, still = certainty[30:130, 141:145], certainty[40:120, 60:120], certainty[30:130, 170:190]
    assert hidden.mean() < 0.5
    assert min(moved.mean(), still.mean()) > 0.9


def test_a_motion_holds_for_larger_copies():
    here = texture()
    there = shifted(here, 4, -3)
    large, small = (192, 256), (96, 128)
    big = [torch.nn.functional.interpolate(p[None], large, mode="bicubic")[0] for p in (here, there)]
    way = motion(here, there).resized(large)
    assert way.positions.shape == (2, *large)
    assert way.certainty.shape == (1, *large)
    middle = np.s_[..., 40:-40, 40:-40]
    np.testing.assert_allclose(way.moved(big[1])[middle], big[0][middle], atol=0.06)
    np.testing.assert_allclose(way.resized(small).positions, motion(here, there).positions, atol=0.3)


def test_the_number_of_threads_changes_no_result_and_stays_the_callers():
    here, before = texture((400, 500)), cv2.getNumThreads()
    there = shifted(here, 5, 2)
    found = []
    try:
        for threads in (1, 4):
            cv2.setNumThreads(threads)
            found.append(motion(here, there).positions)
            assert cv2.getNumThreads() == threads
    finally:
        cv2.setNumThreads(before)
    assert torch.equal(*found)


def test_without_opencv_the_extra_is_named(missing):
    optical_flow.opencv.cache_clear()
    missing("cv2")
    with pytest.raises(ImportError, match=r"needs OpenCV: python -m pip install .*\[video\]"):
        motion(texture(), texture())
    optical_flow.opencv.cache_clear()
