"""Mini-batches of photographs that the device makes, in processes that share the records."""

import numpy as np
import pytest
import torch
from helpers.sphere import sphere

pytest.importorskip("kornia")

from shadow.data import records
from shadow.training import minibatches
from shadow.training.minibatches import StackedPhotographs

CPU = torch.device("cpu")
RADII = [0.5, 0.6, 0.7, 0.8]


@pytest.fixture
def folder(tmp_path):
    for number, radius in enumerate(RADII):
        records.write(tmp_path / f"{number}.npz", sphere(radius=radius))
    return tmp_path


def made(folder, workers, start=0, count=6):
    photographs = StackedPhotographs([folder], 7, (128, 96), 4, start, 2, CPU)
    return [batch for batch, _ in zip(photographs.loader(workers), range(count), strict=False)]


@pytest.mark.parametrize("workers", [0, 2])
def test_a_resumed_run_sees_the_photographs_of_an_uninterrupted_one(folder, workers):
    whole, rest = made(folder, workers), made(folder, workers, start=3, count=3)
    for batch, again in zip(whole[3:], rest, strict=True):
        # The device draws the noise, so the directions tell which photograph it is.
        torch.testing.assert_close(again["directions"], batch["directions"])
    assert not torch.equal(whole[0]["directions"], whole[1]["directions"])


def test_the_workers_share_the_records(folder, monkeypatch):
    """Each record is drawn by one of them, and each is drawn."""
    shares = []
    for worker in range(2):
        info = type("Info", (), {"num_workers": 2, "id": worker})
        monkeypatch.setattr(minibatches, "get_worker_info", lambda info=info: info)
        read = []
        monkeypatch.setattr(
            minibatches.Records, "__getitem__", lambda all, number, read=read: read.append(number) or sphere()
        )
        next(iter(StackedPhotographs([folder], 7, (128, 96), 4, 0, 2, CPU)))
        shares.append(read)
    assert sorted(shares[0] + shares[1]) == list(range(len(RADII)))


def test_records_that_are_added_are_taken_in(folder, monkeypatch):
    monkeypatch.setattr(minibatches, "LOOK_SECONDS", 0.0)
    counts = []

    def first(index, count, seed):
        counts.append(count)
        return 0, np.random.default_rng(index)

    monkeypatch.setattr(minibatches, "numbered", first)
    batches = iter(StackedPhotographs([folder], 7, (128, 96), 4, 0, 2, CPU))
    next(batches)
    (folder / ".half-written.npz").write_bytes(b"")
    records.write(folder / "later.npz", sphere(size=96, radius=0.6))
    assert next(batches)["rgb"].shape == (2, 3, 128, 96)
    assert counts == [4, 4, 5, 5]
