import numpy as np
import pytest
import torch

from shadow.directions import from_spherical, olat
from shadow.networks import precision
from shadow.networks.backbone import encode_image, subject_window, take_blocks
from shadow.networks.field import MIRROR, VisibilityField, anchor_weights

SMALL = {"widths": (8, 8, 8, 8, 8), "encoder": (1, 1, 1, 1, 1), "decoder": (1, 1, 1, 1)}


@pytest.fixture(scope="module")
def field():
    return VisibilityField(**SMALL).eval()


def ball(size=64):
    x, y = torch.meshgrid(torch.linspace(-1.1, 1.1, size), torch.linspace(1.1, -1.1, size), indexing="xy")
    z = (1 - x**2 - y**2).clamp_min(0).sqrt()
    return torch.stack([x, y, z]) * (z > 0), (z > 0).float()


def trained(field):
    """The field with a head that is not zero, as training leaves it."""
    torch.manual_seed(0)
    other = VisibilityField(**SMALL).eval()
    torch.nn.init.normal_(other.backbone.head.weight, std=0.5)
    return other


def test_anchor_weights_sum_to_one_and_peak_at_the_anchor():
    anchors = torch.from_numpy(olat(behind=True))
    weights = anchor_weights(anchors, anchors)
    torch.testing.assert_close(weights.sum(dim=-1), torch.ones(96))
    assert (weights.argmax(dim=-1) == torch.arange(96)).all()


def test_untrained_field_faces_the_camera_and_is_the_sign_baseline(field):
    normals, mask = ball()
    lights = torch.from_numpy(olat(behind=True))
    own, _ = field.analyse(torch.rand(3, 64, 64), mask)
    torch.testing.assert_close(own, mask * torch.tensor([0.0, 0.0, 1.0]).view(3, 1, 1))
    given, visibility = field.analyse(torch.rand(3, 64, 64), mask, normals)
    torch.testing.assert_close(given, normals)
    maps = visibility(lights)
    cosine = torch.einsum("dc,chw->dhw", lights, normals)
    clear = (cosine.abs() > 0.02) & (mask > 0)
    torch.testing.assert_close((maps > 0.5)[clear], (cosine > 0)[clear])


def test_one_pass_is_the_photograph_alone(field):
    network, rgb, mask = trained(field), torch.rand(3, 64, 64), ball()[1]
    lights = torch.from_numpy(olat(behind=True))
    normals, visibility = network.analyse(rgb, mask, passes=1)
    with precision.autocast("cpu"), torch.no_grad():
        own = network(encode_image(rgb[None], mask[None, None]))
    torch.testing.assert_close(normals, own.normals[0] * mask, atol=1e-5, rtol=0)
    expected = network.log_visibility(own, lights[None])[0].exp() * mask
    torch.testing.assert_close(visibility(lights), expected, atol=1e-5, rtol=0)
    twice, _ = network.analyse(rgb, mask, passes=2)
    assert (twice - normals).abs().max() > 0.01


def test_mean_maps_at_blocks_are_those_of_an_analysis(field):
    network, rgb, mask = trained(field), torch.rand(2, 3, 64, 64), ball()[1]
    mask[:, 40:] = 0
    found = [network.infer(each, mask) for each in rgb]
    blocks = found[0][1].blocks[:1].expand(2, -1)
    means = network.mean_at(encode_image(rgb, mask.expand(2, 1, 64, 64)), blocks)
    inside = take_blocks(mask[None, None], blocks[:1])[0] > 0
    for (maps, silhouette), number in zip(found, range(2), strict=True):
        for mean, expected in zip(means, maps, strict=True):
            canvas = take_blocks(silhouette.scatter(expected)[None], blocks[:1])[0]
            torch.testing.assert_close(mean[number] * inside, canvas, atol=1e-5, rtol=1e-5)


def test_a_mirrored_person_is_mirrored(field):
    """Image left and image right are alike: whatever prefers one of them cancels in the mean of both."""
    network, rgb, mask = trained(field), torch.rand(3, 64, 64), ball()[1]
    mask[:, 40:] = 0
    lights = torch.from_numpy(olat(behind=True))
    normals, visibility = network.analyse(rgb, mask)
    mirrored, theirs = network.analyse(rgb.flip(-1), mask.flip(-1))
    torch.testing.assert_close(mirrored.flip(-1) * MIRROR.view(3, 1, 1), normals, atol=1e-4, rtol=0)
    maps, same = visibility(lights)[:, mask > 0], theirs(lights * MIRROR).flip(-1)[:, mask > 0]
    other = theirs(lights).flip(-1)[:, mask > 0]
    # Not to the digit: features of one set of anchors are brought to those of another.
    assert (same - maps).abs().mean() < 0.02 < 0.1 < (other - maps).abs().mean()


def test_maps_are_in_range_and_zero_outside(field):
    _, mask = ball()
    own, visibility = trained(field).analyse(torch.rand(3, 64, 64), mask)
    length = own.norm(dim=0)
    torch.testing.assert_close(length[mask > 0], torch.ones(int(mask.sum())))
    assert length[mask == 0].max() == 0
    maps = visibility(torch.from_numpy(olat()))
    assert maps.min() >= 0
    assert maps.max() <= 1
    assert maps[:, mask == 0].abs().max() == 0


def test_a_light_does_not_depend_on_its_company(field):
    _, mask = ball()
    _, visibility = trained(field).analyse(torch.rand(3, 64, 64), mask)
    lights = torch.from_numpy(olat())
    torch.testing.assert_close(visibility(lights)[10:12], visibility(lights[10:12]))


def test_neighbouring_lights_have_neighbouring_maps(field):
    """No flicker: a light that moves by half a degree changes no pixel by much."""
    _, mask = ball()
    _, visibility = trained(field).analyse(torch.rand(3, 64, 64), mask)
    maps = visibility(torch.from_numpy(from_spherical(np.linspace(90, -90, 361), 20)))
    assert (maps[1:] - maps[:-1]).abs().max() < 0.15


def test_exposure_does_not_matter(field):
    _, mask = ball()
    rgb, network, lights = torch.rand(3, 64, 64) + 0.05, trained(field), torch.from_numpy(olat())
    (normals, visibility), (brighter, the_same) = (
        network.analyse(exposure * rgb, mask) for exposure in (1, 7)
    )
    torch.testing.assert_close(brighter, normals, atol=1e-3, rtol=1e-3)
    torch.testing.assert_close(the_same(lights), visibility(lights), atol=1e-3, rtol=1e-3)


def test_blocks_are_what_the_whole_map_holds(field):
    """Training looks at chosen 2 x 2 blocks: the same numbers as in the full maps, in the same places."""
    network = trained(field)
    image, blocks = torch.rand(1, 4, 64, 64), torch.tensor([[0, 33, 1023, 500]])
    whole, chosen = network(image), network(image, blocks)
    for full, part in zip(whole, chosen, strict=True):
        torch.testing.assert_close(take_blocks(full, blocks), part)
    y, x = divmod(500, 32)
    corner = whole.cast[:, :, 2 * y : 2 * y + 2, 2 * x : 2 * x + 2]
    torch.testing.assert_close(chosen.cast[..., 3], corner.flatten(2))


def test_windows_hold_the_subjects_and_a_margin():
    mask = torch.zeros(2, 384, 288)
    mask[0, 60:300, 100:150] = 1
    mask[1, 70:310, 120:170] = 0.01  # a soft matte counts
    assert subject_window(mask) == (slice(32, 320), slice(64, 192))
    mask[0, 310:313] = 1  # the margin would be cut
    assert subject_window(mask) == (slice(32, 352), slice(0, 288))
    whole = slice(0, 128), slice(0, 96)
    assert subject_window(torch.ones(1, 128, 96)) == subject_window(torch.zeros(1, 128, 96)) == whole


def test_the_empty_canvas_is_not_read(field):
    """So a subject that stands 32 pixels elsewhere is the same to the network."""
    network, rgb, mask = trained(field), torch.rand(1, 3, 192, 192), torch.zeros(1, 1, 192, 192)
    mask[..., 40:100, 50:90] = 1
    blocks = torch.tensor([[30 * 96 + 30]])
    moved = (32, 64)
    maps = network(encode_image(rgb, mask), None)
    there = network(encode_image(rgb.roll(moved, (2, 3)), mask.roll(moved, (2, 3))), None)
    for here, image in zip(maps, there, strict=True):
        torch.testing.assert_close(image, here.roll(moved, (2, 3)))
    for full, part in zip(maps, network(encode_image(rgb, mask), blocks), strict=True):
        torch.testing.assert_close(take_blocks(full, blocks), part)
    assert maps.cast[..., 40:100, 50:90].std() > 0
    assert (maps.cast[..., 150:, :] == 0).all()
