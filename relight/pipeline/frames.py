"""The person of each frame of a shot: analysed and temporally filtered, or read from the analysis cache."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cached_property

import torch

from relight.analysis.camera import Camera
from relight.analysis.foreground import person_matte
from relight.analysis.temporal import RADIUS
from relight.compositing.floor import Floor
from relight.empty_subject import EmptySubject
from relight.pipeline.inputs import FrameInputs, ShotInputs
from relight.pipeline.options import Compute
from relight.subject import Subject
from shadow.networks.precision import using

MAX_THREADS = 1024


@contextmanager
def computing(compute: Compute) -> Iterator[None]:
    """Run networks in the given precision, and torch on the given threads; None leaves them as they are.

    Machines of one kind that agree on both make bit-identical frames. Raises ValueError for other values.
    """
    threads = compute.threads
    if threads is not None and not 1 <= threads <= MAX_THREADS:
        raise ValueError(f"threads: expected 1 to {MAX_THREADS}, got {threads}")
    before = torch.get_num_threads()
    with using(compute.precision):
        try:
            torch.set_num_threads(threads or before)
            yield
        finally:
            torch.set_num_threads(before)


class FrameAnalyser:
    """Returns the person of a frame; the last few frames are kept, to filter the next ones in time.

    Parameters
    ----------
    inputs
        ShotInputs. Frames of an analysis cache are returned as they were stored.
    device
        Where the networks run.
    shared_world
        Whether the frames share one world space, see `relight.analysis.camera.Camera`.
    temporal_filter
        Whether frames are filtered in time; as the source's options say unless given.
    """

    def __init__(
        self,
        inputs: ShotInputs,
        device: str | None,
        *,
        shared_world: bool = False,
        temporal_filter: bool | None = None,
    ) -> None:
        self._inputs, self._device = inputs, device
        self._shared_world = shared_world and inputs.cache is None
        self._numbers = inputs.numbers
        filtered = inputs.source.temporal_filter if temporal_filter is None else temporal_filter
        self._radius = RADIUS if filtered and inputs.cache is None else 0
        self._analysed: dict[int, Subject | EmptySubject | Exception] = {}
        self._kept: tuple[int, FrameInputs] | None = None  # a frame that is read before it is analysed

    def around(self, number: int) -> list[int]:
        """Return the frames that contribute to a frame: itself and its neighbours in the temporal filter.

        It is [0] for a still.
        """
        if self._numbers is None:
            return [0]
        near = range(number - self._radius, number + self._radius + 1)
        return [n for n in near if n == number or n in self._numbers]

    def content_hash(self, number: int, as_read: bool = False) -> str:
        """Return a hash of the inputs of a frame, including the frame that defines the world space.

        See `ShotInputs.content_hash`.
        """
        first, _ = self._world
        around = self.around(number) + ([] if first is None else [first])
        return self._inputs.content_hash(number, around, as_read)

    @cached_property
    def _world(self) -> tuple[int | None, Camera | None]:
        """Return the first frame that shows a moving person, and its camera.

        Both are None for a still, or if nothing has a place in the world.

        It depends on the source alone, so that runs over parts of a shot agree.
        """
        for number in self._numbers or () if self._shared_world else ():
            with suppress(OSError, ValueError):
                coverage = self._coverage(number)
                return number, Camera.of(coverage, self._inputs.height, self._inputs.field_of_view)
        return None, None

    @property
    def camera(self) -> Camera | None:
        """The camera of the world space that the frames share, if they do."""
        return self._world[1]

    def check(self, floor: Floor, number: int) -> None:
        """Raise ValueError if the person cannot stand on the floor.

        The still, or the frame that defines the world space, is checked. An analysis cache is checked frame
        by frame.
        """
        first, _ = self._world
        if self._inputs.cache is None and (first is not None or self._numbers is None):
            floor.check(self._coverage(number if first is None else first))

    def at(self, number: int) -> Subject | EmptySubject:
        """Return the person of a frame. Raises the errors of reading and of `relight.Subject`."""
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
        return subject.temporally_filtered([other for other in others if other is not subject])

    def person(self, number: int) -> Subject:
        """Return the person of a frame. Raises as `at`, and ValueError if the frame shows no person."""
        subject = self.at(number)
        if isinstance(subject, EmptySubject):
            raise ValueError(f"frame {number}: shows no person; choose another (--frame)")
        return subject

    def size(self, number: int) -> tuple[int, int]:
        """Return the size (H, W) of a frame's picture, in pixels."""
        known = self._analysed.get(0 if self._numbers is None else number)
        if self._inputs.cache is None and (known is None or isinstance(known, Exception)):
            height, width = self._kept_frame(number).plate.shape[:2]
            return height, width
        return self.at(number).size

    def _frame(self, number: int) -> FrameInputs:
        """Return a frame's inputs; those kept of another frame are dropped."""
        kept, self._kept = self._kept, None
        return kept[1] if kept is not None and kept[0] == number else self._inputs.frame(number)

    def _kept_frame(self, number: int) -> FrameInputs:
        """Return a frame's inputs, and keep them for its analysis."""
        self._kept = (number, self._frame(number))
        return self._kept[1]

    def _coverage(self, number: int) -> torch.Tensor:
        """Return the matte (H, W) of a frame's person."""
        frame = self._kept_frame(number)
        return person_matte(frame.plate, frame.matte)

    def _analyse(self, number: int) -> Subject | EmptySubject | Exception:
        """Analyse one frame without its neighbours; return the person, or the error."""
        inputs = self._inputs
        try:
            if inputs.cache is not None:
                return inputs.cache.read(number)
            camera = self.camera  # before the frame is read, for it may be the one that defines the world
            plate, matte, normals, depth = self._frame(number)
            coverage = plate[..., 3:] if matte is None else matte
            if self._numbers is not None and coverage.size and coverage.max() <= 0.5:
                return EmptySubject(plate.shape[:2])
            if camera is not None and camera.size != plate.shape[:2]:
                camera = None  # a frame of another size has a world of its own
            return Subject(
                plate, matte, normals=normals, depth=depth, height=inputs.height,
                field_of_view=inputs.field_of_view, camera=camera, device=self._device,
            )  # fmt: skip
        except (OSError, ValueError) as error:
            return error
