"""Where the losses look: near borders of cast shadow and at faces, as often as the recipe says."""

import pytest
import torch

from shadow.training import tasks
from shadow.training.attention import BORDER_PIXELS, attention
from shadow.training.recipes import Recipe


@pytest.fixture
def batch():
    """A wall that faces the camera; one of two lights is hidden from its left half, another from none."""
    mask = torch.zeros(1, 1, 64, 48)
    mask[..., 4:60, 4:44] = 1
    normals = torch.zeros(1, 3, 64, 48)
    normals[:, 2] = 1
    visibility = torch.ones(1, 2, 64, 48)
    visibility[:, 0, :, :24] = 0
    regions = torch.zeros(1, 2, 64, 48)
    regions[:, 0, 10:20] = 1
    lights = torch.tensor([[[0.0, 0, 1], [0, 0, 1]]])
    return {
        "mask": mask, "normals": normals, "visibility": visibility, "regions": regions, "directions": lights
    }  # fmt: skip


def test_by_default_all_pixels_of_the_subject_count_alike(batch):
    assert torch.equal(attention(batch, Recipe(1)), batch["mask"])


def test_borders_and_faces_are_looked_at_more_often(batch):
    seen = attention(batch, Recipe(1, borders=5, faces=3))[0, 0]
    assert seen[40, 24 - BORDER_PIXELS] == seen[40, 23 + BORDER_PIXELS] == 1 + 4 / 2  # under one light of two
    assert seen[40, 23 - 2 * BORDER_PIXELS] == 1
    assert seen[15, 35] == 3
    assert seen[0].max() == 0
    assert attention(batch, Recipe(1, faces=3))[0, 0, 40].max() == 1
    torch.manual_seed(0)
    rows = tasks.random_blocks(seen[None, None]) // 24
    face = ((rows >= 5) & (rows < 10)).float().mean()
    assert face == pytest.approx(float(seen[10:20].sum() / seen.sum()), abs=0.05)


def test_attached_shadow_is_no_border(batch):
    batch["normals"][:, 2, :, :24] = -1
    assert torch.equal(attention(batch, Recipe(1, borders=5)), batch["mask"])


def test_the_loss_of_normals_by_angle():
    truth = torch.tensor([0.0, 0, 1]).view(1, 3, 1, 1)
    far = torch.tensor([1.0, 0, 0]).view(1, 3, 1, 1)
    inside = torch.ones(1, 1, 1, 1)
    assert tasks.normals_error(far, truth, inside) == pytest.approx(2**0.5, abs=1e-3)
    assert tasks.normals_error(far, truth, inside, 1.0) == pytest.approx(torch.pi / 2, abs=1e-3)
