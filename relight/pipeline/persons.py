"""The person of each frame of a shot: analysed, and filtered in time."""

import warnings
from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, TypeGuard

import torch

from relight.analysis.camera import Camera
from relight.analysis.foreground import person_matte
from relight.analysis.old_light import OldLight
from relight.compositing.floor import Floor
from relight.errors import EmptyMatteError
from relight.pipeline.frame import FrameInputs, FrameReader
from relight.subject import Subject
from shadow import inputs


class FramePerson(NamedTuple):
    """The person of a frame, and how they were found."""

    subject: Subject
    certainty: float | None  # that they are there, 0 to 1; None where nobody is followed
    neighbours: list[int] | None  # the frames with which they were filtered; None for an analysis cache


class Persons:
    """The persons of a shot, filtered in time; the last few are kept, to filter the next ones.

    `numbers`: the frames that there are; None for a still, whose person is shown at any number. `analyse`
    returns the person of one frame; its OSError or ValueError is raised again for that frame alone. `radius`:
    number of frames before and after, with which a frame is filtered; 0 leaves all as they are. So does None,
    for an analysis cache, of which any frame is at hand. `is_cut` says of two frames that were analysed
    whether a cut is between them, across which nothing is averaged. `reference` returns the reference frame.
    """

    def __init__(
        self,
        numbers: Sequence[int] | None,
        analyse: Callable[[int], Subject],
        radius: int | None,
        is_cut: Callable[[int, int], bool] = lambda before, after: False,
        reference: Callable[[], int | None] = lambda: None,
    ) -> None:
        self.is_still, self.numbers = numbers is None, (0,) if numbers is None else numbers
        self._analyse, self._radius, self._is_cut, self._reference = analyse, radius, is_cut, reference
        self._analysed: dict[int, Subject | Exception] = {}

    @property
    def reference(self) -> int | None:
        """The reference frame, see `relight.pipeline.reference`; None for a still, or without a person."""
        return self._reference()

    def source_frame(self, number: int) -> int:
        """Return the frame whose person is shown at a number: 0 for a still."""
        return 0 if self.is_still else number

    def around(self, number: int) -> list[int]:
        """Return the frames that contribute to a frame: itself, and its neighbours in the temporal filter."""
        number, radius = self.source_frame(number), self._radius or 0
        near = range(number - radius, number + radius + 1)
        return [n for n in near if n == number or n in self.numbers]

    def near(self, number: int, distance: int) -> list[int]:
        """Return the frames up to a distance from one whose persons are at hand when it is made."""
        there = self.numbers if self._radius is None else self.around(number)
        return [each for each in there if abs(each - self.source_frame(number)) <= distance]

    def first_found(self, preferred: int | None = None) -> int:
        """Return the first frame that shows a person, `preferred` before all; the first of all if none does.

        Raises as `analyse` does.
        """
        numbers = [*([] if preferred is None else [preferred]), *self.numbers]
        return next((each for each in numbers if not self.analysed(each).is_empty), numbers[0])

    def at(self, number: int) -> Subject:
        """Return the person of a frame, filtered. Raises as `analyse` does."""
        return self.filtered(number)[0]

    def filtered(self, number: int) -> tuple[Subject, list[int]]:
        """Return the person of a frame, and the frames with which they were filtered. Raises as `analyse`."""
        number, around = self.source_frame(number), self.around(number)
        self._analysed = {n: result for n, result in self._analysed.items() if n in around}
        results = {n: self._result(n) for n in around}
        person = self.analysed(number)
        cuts = [after for before, after in pairwise(around) if self._is_cut(before, after)]
        first = max((cut for cut in cuts if cut <= number), default=around[0])
        last = min((cut - 1 for cut in cuts if cut > number), default=around[-1])
        others = {n: each for n, each in results.items() if n != number and first <= n <= last}
        neighbours = {n: each for n, each in others.items() if _shows_somebody(each)}
        if neighbours:
            person = person.temporally_filtered(neighbours.values())
        return person, [*neighbours]

    def analysed(self, number: int) -> Subject:
        """Return the person of a frame, not filtered. Raises as `analyse` does."""
        result = self._result(self.source_frame(number))
        if isinstance(result, Exception):
            raise result
        return result

    def shown(self, number: int, *, filtered: bool = True) -> Subject:
        """Return the person of a frame; raises ValueError if the frame shows no person."""
        person = self.at(number) if filtered else self.analysed(number)
        if person.is_empty:
            shown = f"frame {self.source_frame(number)}: shows no person"
            raise ValueError(f"{shown}; choose another (frame=NUMBER)")
        return person

    def _result(self, number: int) -> Subject | Exception:
        if number not in self._analysed:
            try:
                self._analysed[number] = self._analyse(number)
            except (OSError, ValueError) as error:
                self._analysed[number] = error
        return self._analysed[number]


def _shows_somebody(result: Subject | Exception) -> TypeGuard[Subject]:
    return not isinstance(result, Exception) and not result.is_empty


class FrameAnalyser:
    """Analyses the person of one frame, in the world space that the frames of a shot share.

    `analyse` is called with the arguments of `relight.Subject`, and returns the person.
    """

    def __init__(self, frames: FrameReader, device: str | None, analyse: Callable[..., Subject]) -> None:
        self._frames, self._device, self._analyse = frames, device, analyse
        self._read: tuple[int, FrameInputs] | None = None  # a frame that is read before it is analysed
        self._first_light: OldLight | None = None  # that of the first frame with a person, once analysed

    @cached_property
    def world(self) -> tuple[int | None, Camera | None]:
        """The reference frame of a moving person, and its camera; None for a still.

        It is the best one of `FrameReader.references`, or else the first with a person. It depends on the
        source alone, so that runs over parts of a shot agree. Warns of frames that cannot be read. Raises
        ValueError if the frame that is asked for shows nobody.
        """
        if self._frames.is_still:
            return None, None
        best, problems = self._frames.references
        # The first of the frames that cannot be read.
        unreadable = next((f"frame {number}: {error}" for number, error in problems.items()), None)
        wanted = self._frames.source.reference
        for number in best if wanted is not None else dict.fromkeys([*best, *self._frames.numbers]):
            try:
                coverage = self._coverage(number)
                camera = Camera.of(coverage, self._frames.height, self._frames.field_of_view)
            except EmptyMatteError:
                continue
            except (OSError, ValueError) as error:
                unreadable = unreadable or f"frame {number}: {error}"
                continue
            if unreadable is not None:
                warnings.warn(
                    f"{unreadable}; so positions and the old light of the shot are those of frame {number}",
                    stacklevel=2,
                )
            return number, camera
        if wanted is not None:
            raise ValueError(unreadable or f"reference: frame {wanted} shows no person; choose another")
        return None, None

    def check_standing(self, floor: Floor, number: int) -> None:
        """Raise ValueError if the person cannot stand on the floor.

        The still, or the frame that defines the world space, is checked.
        """
        first, _ = self.world
        if first is not None or self._frames.is_still:
            matte = self._coverage(number if first is None else first)
            floor.check(matte)

    def __call__(self, number: int) -> Subject:
        """Return the person of a frame. Raises the errors of reading and of `relight.Subject`."""
        first, camera = self.world  # both before the frame is read, for it may be the first one
        old_light = None if number == first or first is None else self._old_light(first)
        plate, matte, normals, depth = self._frame(number)
        coverage = plate[..., 3:] if matte is None else matte
        if not self._frames.is_still and coverage.size and coverage.max() <= 0.5:
            if hint := inputs.faint(coverage.max()):
                warnings.warn(f"mask: a frame is empty (no value above 0.5){hint}", stacklevel=2)
            return Subject.nobody((plate.shape[0], plate.shape[1]))
        if camera is not None and camera.size != plate.shape[:2]:
            camera = None  # a frame of another size has a world of its own
        subject = self._analyse(
            plate, matte, normals=normals, depth=depth, height=self._frames.height,
            field_of_view=self._frames.field_of_view, camera=camera, old_light=old_light,
            feather=self._frames.source.feather, device=self._device,
        )  # fmt: skip
        if number == first:
            self._first_light = subject.old_light
        return subject

    def _old_light(self, first: int) -> OldLight:
        """Return the old light of a shot, that of its first frame: fits of single frames would flicker.

        A first frame that cannot be analysed leaves the colour in the albedo of all, with a warning.
        """
        if self._first_light is None:
            try:
                self(first)
            except (OSError, ValueError) as error:
                warnings.warn(
                    f"frame {first}: {error}; so the colour of the old light stays in the albedo of the shot",
                    stacklevel=2,
                )
            self._first_light = self._first_light or OldLight()
        return self._first_light

    def _frame(self, number: int) -> FrameInputs:
        """Return a frame's inputs; those that were read of another frame are dropped."""
        read, self._read = self._read, None
        return read[1] if read is not None and read[0] == number else self._frames.read(number)

    def _frame_to_analyse(self, number: int) -> FrameInputs:
        """Return a frame's inputs, and hold them for its analysis."""
        self._read = (number, self._frame(number))
        return self._read[1]

    def _coverage(self, number: int) -> torch.Tensor:
        """Return the matte (H, W) of a frame's person."""
        frame = self._frame_to_analyse(number)
        return person_matte(frame.plate, frame.matte)
