import json

import pytest
import torch
from helpers.cutouts import write_sources

pytest.importorskip("kornia")

from shadow.data.backdrops import Backdrops
from shadow.data.composites import Composite, Composites
from shadow.networks import checkpoints
from shadow.networks.matting import MattingNetwork
from shadow.training import matting
from shadow.training.recipes import Recipe


@pytest.fixture(autouse=True)
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    people, behind = write_sources(tmp_path_factory.mktemp("sources"))
    return matting.Sources([people], behind)


class Answer(torch.nn.Module):
    """A network that answers with given logits."""

    def __init__(self, logits):
        super().__init__()
        self.logits = logits

    def forward(self, rgb, mask):
        return self.logits, torch.nn.functional.avg_pool2d(self.logits, 8)


def batch():
    alpha = torch.zeros(1, 1, 64, 64)
    alpha[..., 16:48, 16:48] = 1
    return Composite(torch.rand(1, 3, 64, 64), alpha, alpha, torch.ones_like(alpha), torch.ones_like(alpha))


def test_the_true_matte_has_the_least_loss():
    truth = batch()
    logits = 20 * (2 * truth.alpha - 1)
    right = matting.loss(Answer(logits), truth)
    assert right < 0.02
    assert matting.loss(Answer(logits.roll(2, 3)), truth) > right + 0.2
    assert matting.loss(Answer(-logits), truth) > matting.loss(Answer(logits.roll(2, 3)), truth)


def test_nothing_counts_beyond_the_frame():
    truth = batch()
    valid = truth.valid.clone()
    valid[..., 56:] = 0
    logits = 20 * (2 * truth.alpha - 1)
    wrong = logits.clone()
    wrong[..., 58:] = 20
    seen = truth._replace(valid=valid)
    assert matting.loss(Answer(wrong), seen) - matting.loss(Answer(logits), seen) < 0.01
    assert matting.loss(Answer(wrong), truth) - matting.loss(Answer(logits), truth) > 0.1


@pytest.mark.slow
def test_a_run_learns_resumes_and_is_scored(sources, tmp_path):
    recipe = {"size": 128, "batch": 2, "learning_rate": 2e-3, "warm_up": 2, "average": 0.5, "clip": 1.0}
    path = matting.fit(Recipe(steps=2, **recipe), sources, tmp_path, workers=0)
    path = matting.fit(Recipe(steps=4, **recipe), sources, tmp_path, validation=sources, workers=0)
    network = checkpoints.load(path, {"matting": MattingNetwork}, package="shadow")
    assert network.size == 128
    rows = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert [row["step"] for row in rows] == [2, 4]
    assert rows[-1]["images"] == 8
    assert 0 < rows[-1]["iou"] <= 1
    assert 0 < rows[-1]["rough iou"] < 1
    assert list(tmp_path.glob("samples-*.png"))


def test_training_mends_a_mask(sources):
    """A few steps on a few pictures bring the mattes nearer to the truth than the rough masks are."""
    torch.manual_seed(0)
    network = MattingNetwork(widths=(16, 24, 32, 32, 32), encoder=(1,) * 5, decoder=(1,) * 4)
    made = Composites(sources.cutouts, Backdrops(sources.backdrops), 0, 64, 0, 8)
    drawn = [made[number] for number in range(len(made))]
    pictures = Composite(*(torch.stack(planes) for planes in zip(*drawn, strict=True)))
    optimiser = torch.optim.Adam(network.parameters(), 3e-3)
    before = matting.loss(network, pictures).item()
    for _ in range(40):
        optimiser.zero_grad()
        matting.loss(network, pictures).backward()
        optimiser.step()
    assert matting.loss(network, pictures).item() < 0.85 * before
