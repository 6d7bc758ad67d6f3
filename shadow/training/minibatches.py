"""Mini-batches of random photographs: made by workers on the processor, or on the device of the training."""

import itertools
import os
import time
import zlib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset, IterableDataset, default_collate, get_worker_info

from shadow.data.batches import Draw, Stack
from shadow.data.photographs import Sample, sample
from shadow.data.records import Record, Records

Batch = dict[str, Any]  # the tensors of Sample, each with a batch axis, and what the training loop adds
LOOK_SECONDS = 20.0  # between two looks for records that were added
STACK_WORKERS = 4  # of a GPU: one process launches too few kernels to keep it busy


def numbered(index: int, count: int, seed: int) -> tuple[int, np.random.Generator]:
    """Return which of `count` records photograph number `index` shows, and its random numbers.

    They do not depend on the number of workers, so that a resumed run sees the same photographs as an
    uninterrupted run. Each record is seen once before any is seen again.
    """
    epoch, position = divmod(index, count)
    order = np.random.default_rng((seed, epoch)).permutation(count)
    return int(order[position]), np.random.default_rng((seed, epoch, position))


@dataclass(eq=False)
class Photographs(Dataset):
    """Photographs of the records, from number `start` on."""

    records: Records
    seed: int
    size: tuple[int, int]
    lights: int | None
    start: int
    count: int
    augment: bool = True

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> Sample:
        number, rng = numbered(self.start + index, len(self.records), self.seed)
        return sample(self.records[number], rng, self.size, self.lights, self.augment)

    def loader(self, batch: int, device: torch.device, workers: int | None) -> DataLoader:
        """Return mini-batches, made by 1 worker for a CPU, and by one for each core for a GPU."""
        gpu = device.type == "cuda"
        workers = (os.cpu_count() or 1 if gpu else 1) if workers is None else workers
        return DataLoader(
            self, batch, num_workers=workers, pin_memory=gpu, worker_init_fn=_one_thread,
            collate_fn=_collated_in_half if gpu else None,
        )  # fmt: skip


@dataclass(eq=False)
class StackedPhotographs(IterableDataset):
    """Endless mini-batches of photographs, from number `start` on, made on the device that holds the records.

    Each worker holds a share of the records, and takes in what is added to their folders meanwhile.
    """

    paths: Sequence[str | Path]
    seed: int
    size: tuple[int, int]
    lights: int | None
    start: int
    batch: int
    device: torch.device

    def loader(self, workers: int | None) -> DataLoader:
        """Return the mini-batches, made by so many processes, or in this one with 0 workers."""
        gpu = self.device.type == "cuda"
        workers = (STACK_WORKERS if gpu else 1) if workers is None else workers
        context = "spawn" if gpu and workers else None  # CUDA does not survive a fork
        return DataLoader(
            self, None, num_workers=workers, worker_init_fn=_one_thread, multiprocessing_context=context
        )

    def __iter__(self) -> Iterator[Batch]:
        info = get_worker_info()
        workers, number = (1, 0) if info is None else (info.num_workers, info.id)
        first = self.start + number  # the loader takes a mini-batch of each worker in turn
        share = _Share(self, first % workers, workers)
        for count in itertools.count(first // workers):
            share.look()
            yield share.stack.photographs(
                [share.draw(index) for index in range(count * self.batch, (count + 1) * self.batch)]
            )


class _Share:
    """The records that one worker holds. A share of few records that has none takes all."""

    def __init__(self, photographs: StackedPhotographs, number: int, count: int) -> None:
        self.photographs, self.number, self.count = photographs, number, count
        # The shares have other lights: their seeds differ.
        self.seed = photographs.seed + 613 * number
        self.taken: set[tuple[Path, str | None]] = set()
        self.stack = Stack(self._new() or self._new(every=True), photographs.size, photographs.device)
        self.looked = time.monotonic()

    def look(self) -> None:
        """Take in the records of this share that were added, if it is time to look for some."""
        if time.monotonic() - self.looked <= LOOK_SECONDS:
            return
        if new := self._new():
            self.stack.extend(new)
        self.looked = time.monotonic()

    def draw(self, index: int) -> Draw:
        number, rng = numbered(index, len(self.stack), self.seed)
        return self.stack.draw(number, rng, self.photographs.lights)

    def _new(self, every: bool = False) -> list[Record]:
        """Read this share's records that are not taken, or those of every share."""
        records = Records(self.photographs.paths)
        own = [
            index
            for index, (file, member) in enumerate(records.entries)
            if (file, member) not in self.taken
            and (every or zlib.crc32(f"{file.name}:{member}".encode()) % self.count == self.number)
        ]
        self.taken.update(records.entries[index] for index in own)
        with ThreadPoolExecutor() as readers:
            return list(readers.map(records.__getitem__, own))


def _collated_in_half(samples: list[Sample]) -> Batch:
    """Collate samples with their images in float16: half as many bytes for one process to copy to the GPU."""
    halved = [
        {key: value.half() if value.ndim == 3 else value for key, value in each.items()} for each in samples
    ]
    return default_collate(halved)


def _one_thread(_worker: int) -> None:
    torch.set_num_threads(1)
