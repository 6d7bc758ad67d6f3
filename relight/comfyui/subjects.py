"""The person of each image of a batch, analysed, and filtered in time where the batch is one shot."""

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from relight.media import optical_flow
from relight.pipeline.options import TEMPORAL_RADIUS
from relight.pipeline.persons import Persons
from relight.subject import Subject

IN_MEMORY = 8  # frames, of about 0.2 GB each; a longer batch is kept in files

Analyse = Callable[[int, Subject | None], Subject]


class SubjectBatch:
    """What a RELIGHT_SUBJECT socket carries: a `relight.Subject` for each image (`size`, (H, W)) of a batch.

    A few are kept in memory. Those of a longer batch are kept as `Subject.save` keeps them, in a temporary
    folder that disappears with the batch, and read one by one. `shown`: the first subject, as it was
    analysed: what the viewer's page shows.
    """

    def __init__(self, count: int, people: Iterator[tuple[Subject, Subject]]) -> None:
        """Take an iterator over the persons of `count` images, each as analysed and as filtered in time."""
        self._folder = tempfile.TemporaryDirectory(prefix="relight-") if count > IN_MEMORY else None
        self._people: list[Subject | Path] = []
        self.shown: Subject | None = None
        for number, (analysed, filtered) in enumerate(people):
            if self.shown is None and not analysed.is_empty:
                self.shown = analysed
            self.size = filtered.size
            self._people.append(filtered if self._folder is None else self._keep(number, filtered))

    def _keep(self, number: int, person: Subject) -> Path:
        assert self._folder is not None
        path = Path(self._folder.name) / f"{number}.safetensors"
        person.save(path, provenance={})
        return path

    def __len__(self) -> int:
        return len(self._people)

    def __iter__(self) -> Iterator[Subject]:
        return map(self.__getitem__, range(len(self)))

    def __getitem__(self, number: int) -> Subject:
        """Return the person of an image; a single one stands for all numbers."""
        person = self._people[number if len(self) > 1 else 0]
        return Subject.load(person, may_be_empty=True) if isinstance(person, Path) else person


def each_person(count: int, analyse: Analyse, is_shot: bool) -> Iterator[tuple[Subject, Subject]]:
    """Yield the person of each of `count` images: as analysed, and as filtered in time if they are a shot.

    `analyse(number, first)` analyses an image: in a shot, in the room of the first subject that was found.
    """
    first: Subject | None = None

    def in_room(number: int) -> Subject:
        nonlocal first
        person = analyse(number, first)
        if is_shot and first is None and not person.is_empty:
            first = person
        return person

    radius = TEMPORAL_RADIUS if is_shot and optical_flow.is_installed() else 0
    persons = Persons(range(count), in_room, radius)
    for number in range(count):
        filtered = persons.at(number)
        yield persons.analysed(number), filtered
