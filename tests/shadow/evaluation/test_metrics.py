import numpy as np
import pytest
import torch
from skimage.filters import threshold_otsu
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from shadow.evaluation import metrics


def maps(seed):
    random = np.random.default_rng(seed)
    return torch.from_numpy(random.random((5, 20, 30)) > 0.4).float(), torch.from_numpy(
        random.random((20, 30)) > 0.5
    )


def test_rmse_and_psnr_agree_with_scikit_image():
    (estimate, mask), (truth, _) = maps(0), maps(1)
    error = metrics.rmse(estimate, truth, mask)
    reference = [
        peak_signal_noise_ratio(t[mask].numpy(), e[mask].numpy(), data_range=1)
        for e, t in zip(estimate, truth, strict=True)
    ]
    np.testing.assert_allclose(metrics.psnr(error), reference, rtol=1e-5)


def test_dice_by_counting():
    (estimate, mask), (truth, _) = maps(2), maps(3)
    both = ((estimate * truth)[:, mask]).sum(dim=1)
    expected = 2 * both / (estimate[:, mask].sum(dim=1) + truth[:, mask].sum(dim=1))
    torch.testing.assert_close(metrics.dice(estimate, truth, mask), expected)


def test_dice_of_two_dark_maps_is_one():
    dark = torch.zeros(1, 4, 4)
    assert metrics.dice(dark, dark, torch.ones(4, 4)) == 1


def test_pixels_outside_the_mask_do_not_count():
    (estimate, mask), (truth, _) = maps(4), maps(5)
    for metric in (metrics.rmse, metrics.dice):
        torch.testing.assert_close(
            metric(estimate, truth, mask), metric(torch.where(mask, estimate, 1 - estimate), truth, mask)
        )


def test_angular_error():
    angle = np.radians(30)
    estimate = torch.tensor([np.sin(angle), 0, np.cos(angle)]).float().view(3, 1, 1).expand(3, 4, 4)
    truth = torch.tensor([0.0, 0, 1]).view(3, 1, 1).expand(3, 4, 4)
    mask = torch.ones(4, 4)
    np.testing.assert_allclose(metrics.angular_error(estimate, truth, mask), 30, rtol=1e-5)
    assert metrics.angular_error(truth, truth, mask) == 0


def test_ssim_of_the_bounding_box_agrees_with_scikit_image():
    pytest.importorskip("kornia")
    random = np.random.default_rng(6)
    truth = torch.from_numpy(random.random((2, 3, 40, 50), np.float32))
    estimate = (truth + 0.3 * torch.from_numpy(random.standard_normal(truth.shape, np.float32))).clamp(0, 1)
    mask = torch.zeros(40, 50, dtype=torch.bool)
    mask[5:30, 20] = mask[12, 9:44] = True  # a cross, whose box is rows 5 to 29 and columns 9 to 43
    box = (..., slice(5, 30), slice(9, 44))
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False, "data_range": 1}
    pairs = zip(estimate[box].flatten(0, 1).numpy(), truth[box].flatten(0, 1).numpy(), strict=True)
    expected = np.reshape([structural_similarity(*pair, **options) for pair in pairs], (2, 3))
    scores = metrics.ssim(estimate, truth, mask)
    np.testing.assert_allclose(scores, expected, atol=1e-4)
    assert metrics.ssim(truth[0, 0], truth[0, 0], mask) == pytest.approx(1)
    with pytest.raises(ValueError, match="smaller than 11 x 11"):
        metrics.ssim(truth, truth, mask & (torch.arange(50) < 19))


@pytest.mark.parametrize("spread", [0.02, 0.1, 0.3])
def test_otsu_agrees_with_scikit_image(spread):
    random = np.random.default_rng(7)
    centres = random.choice([0.25, 0.7], size=(60, 40), p=[0.3, 0.7])
    grey = (centres + spread * random.standard_normal((60, 40))).astype(np.float32)
    assert metrics.otsu(torch.from_numpy(grey)) == pytest.approx(threshold_otsu(grey), abs=1e-4)


def test_otsu_of_two_values_separates_them_and_of_one_is_it():
    assert 0 <= metrics.otsu(torch.tensor([0.0, 0, 1, 1, 1])) < 1
    assert metrics.otsu(torch.full((3, 3), 0.4)) == pytest.approx(0.4)


def test_depth_is_scored_in_per_cent_and_by_what_is_in_front():
    truth = torch.zeros(40, 40)
    truth[:, 10:20] = -0.1  # an arm before the body
    truth[:, 30:] = 0.02  # too little to be a border
    mask = torch.ones(40, 40, dtype=torch.bool)
    assert metrics.depth_error(truth + 7, truth, mask) == pytest.approx(0, abs=1e-4)
    assert metrics.depth_error(torch.zeros(40, 40), truth, mask) == pytest.approx(4, abs=0.5)
    assert metrics.depth_order(0.01 * truth, truth, mask) == 1
    assert metrics.depth_order(-truth, truth, mask) == 0
    assert metrics.depth_order(torch.zeros(40, 40), truth, mask) == 0.5
    mask[:, :24] = False
    assert metrics.depth_order(truth, truth, mask).isnan()
