"""The person of each frame of a shot, analysed: steadied by the frames around, or read where it is kept."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from typing import Any

import torch

from relight.depth import Camera
from relight.floor import Floor
from relight.foreground import matte_of, plate_of
from relight.nobody import Nobody
from relight.preparation import Preparation
from relight.steadying import AROUND
from relight.subject import Subject
from shadow.mattes import person_in
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

    def __init__(self, prepared: Preparation, steady: bool, device: str | None, in_room: bool) -> None:
        """`in_room`: the frames share one room, see `relight.depth.Camera`. Neither that nor `steady` means
        anything to a shot that is analysed already: it is as it was kept."""
        self._prepared, self._device = prepared, device
        self._in_room = in_room and prepared.kept is None
        self._there = prepared.numbers
        self._reach = AROUND if steady and prepared.kept is None else 0
        self._analysed: dict[int, Subject | Nobody | Exception] = {}

    def around(self, number: int) -> list[int]:
        """The frames that take part in one: it, and those that steady it; of a still 0, for all frames."""
        if self._there is None:
            return [0]
        near = range(number - self._reach, number + self._reach + 1)
        return [n for n in near if n == number or n in self._there]

    def made_of(self, number: int) -> list[int]:
        """The frames that one is made of: those around it, and the one that says where the room is."""
        first, _ = self._room
        return self.around(number) + ([] if first is None else [first])

    @cached_property
    def _room(self) -> tuple[int | None, Camera | None]:
        """The first frame of a moving person that shows them, and its camera; (None, None) for a still, or
        where nothing stands in the room.

        It depends on the source alone, so that runs over parts of a shot agree.
        """
        for number in self._there or () if self._in_room else ():
            with suppress(OSError, ValueError):
                plate, matte, _, _ = self._prepared.person(number)
                coverage = person_in(matte_of(plate_of(plate), matte))
                return number, Camera.of(coverage, self._prepared.height, self._prepared.field_of_view)
        return None, None

    @property
    def camera(self) -> Camera | None:
        """That of the room that the frames share, if they do."""
        return self._room[1]

    def check(self, floor: Floor, number: int) -> None:
        """ValueError where the person cannot stand on the floor in the frame that says where the room is, or
        of a still in any. A shot that is analysed already says so frame by frame."""
        first, _ = self._room
        if self._prepared.kept is None and (first is not None or self._there is None):
            plate, matte, _, _ = self._prepared.person(number if first is None else first)
            floor.check(plate, matte)

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
            plate, matte, normals, depth = self._prepared.person(number)
            coverage = plate[..., 3:] if matte is None else matte
            if self._there is not None and coverage.size and coverage.max() <= 0.5:
                return Nobody(plate.shape[:2])
            return Subject(
                plate, matte, normals=normals, depth=depth, height=self._prepared.height,
                field_of_view=self._prepared.field_of_view, camera=self._room[1], device=self._device,
            )  # fmt: skip
        except (OSError, ValueError) as error:
            return error
