import numpy as np
import torch
from skimage.metrics import peak_signal_noise_ratio

from shadow import metrics


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
