"""The person of each frame of a shot, analysed: steadied by the frames around, or read where it is kept."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch

from relight.preparation import Preparation
from relight.steadying import AROUND
from relight.subject import Nobody, Subject
from shadow.networks.precision import using


@contextmanager
def computing(precision: str | None, threads: int | None) -> Iterator[None]:
    """Within this block networks run in that precision, and torch on so many threads; None leaves it to them.

    Machines that agree on both make the same frames to the bit. ValueError for other values.
    """
    if threads is not None and not 1 <= threads <= 1024:
        raise ValueError(f"threads: expected 1 to 1024, got {threads}")
    before = torch.get_num_threads()
    with using(precision):
        try:
            torch.set_num_threads(threads or before)
            yield
        finally:
            torch.set_num_threads(before)


class People:
    """The person of each frame; of a moving one the last few frames are kept, to steady the next."""

    def __init__(self, prepared: Preparation, steady: bool, device: str | None) -> None:
        """`steady` means nothing to a shot that is analysed already: it is as it was kept."""
        self._prepared, self._device = prepared, device
        self._there = prepared.numbers
        self._reach = AROUND if steady and prepared.kept is None else 0
        self._analysed: dict[int, Subject | Nobody | Exception] = {}

    def around(self, number: int) -> list[int]:
        """The frames that take part in one: it, and those that steady it; of a still 0, for all frames."""
        if self._there is None:
            return [0]
        near = range(number - self._reach, number + self._reach + 1)
        return [n for n in near if n == number or n in self._there]

    def at(self, number: int) -> Any:
        """A Subject, or the like of one; raises as reading and `Subject` do."""
        around = self.around(number)
        number = number if number in around else 0
        self._analysed = {n: found for n, found in self._analysed.items() if n in around}
        for n in around:
            if n not in self._analysed:
                self._analysed[n] = self._analyse(n)
        subject = self._analysed[number]
        if isinstance(subject, Exception):
            raise subject
        others = [found for found in self._analysed.values() if isinstance(found, Subject)]
        if not isinstance(subject, Subject) or len(others) == 1:
            return subject
        return subject.steadied([other for other in others if other is not subject])

    def _analyse(self, number: int) -> "Subject | Nobody | Exception":
        """The Subject of a frame, nobody, or what is wrong with it."""
        try:
            if self._prepared.kept is not None:
                return self._prepared.kept.read(number)
            plate, matte, normals = self._prepared.person(number)
            coverage = plate[..., 3:] if matte is None else matte
            if self._there is not None and coverage.size and coverage.max() <= 0.5:
                return Nobody(plate.shape[:2])
            return Subject(plate, matte, normals=normals, device=self._device)
        except (OSError, ValueError) as error:
            return error
