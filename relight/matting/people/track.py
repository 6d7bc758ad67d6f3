"""Follow one person through the frames of a shot, by place, size and the colours that they wear.

The first frame in which somebody is found with certainty says who is followed. Each frame after it takes
the person nearest to where they were last. The more frames ago that was, the farther they may have moved.
Somebody farther away must be found with certainty and wear the same colours. Otherwise nobody is there:
neither a passer-by nor a piece of furniture takes the place of somebody who has left.

The place in a frame depends on all frames before it. The machines of a farm therefore share a file of places.
"""

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from relight.matting.people.choice import CERTAIN, index_of
from relight.matting.people.region import Circle, DetectedPerson, planes, sampled
from relight.matting.refine import PersonChoice
from relight.media.resampling import resize
from relight.media.scenes import is_cut, reduced
from shadow import files

SUFFIX = ".json"
VERSION = 1
REACH = 0.5  # distance of circles, see `Circle.distance`, that somebody moves in one frame at most
LONGEST_REACH = 2.0  # distance from where they were at most, however long ago that was
SAME_CLOTHES = 0.12  # RMS difference of encoded colours up to which somebody far away may be the same
OTHER_CLOTHES = 0.18  # from which somebody near by is another one
RECENT = 4  # frames of which is kept who is in them: one is cut out soon after they were followed to it
COLOURS_SIDE = 64  # pixels, of the copy from which the colours are taken


class Place(NamedTuple):
    """Where the person is in a frame, how certain it is that somebody is there, and their colours."""

    circle: Circle
    certainty: float
    colours: np.ndarray  # (3, 3) encoded RGB of their upper, middle and lower third


@dataclass(frozen=True)
class Seen:
    """Who is in a frame, and a copy (h, w, 3) of it in which scenes are compared."""

    people: Sequence[DetectedPerson]
    colours: Sequence[np.ndarray]  # of each of them
    scene: np.ndarray
    size: tuple[int, int]

    @classmethod
    def of(cls, encoded: np.ndarray, people: Sequence[DetectedPerson]) -> "Seen":
        """Look at a frame (H, W, 3), encoded in [0, 1]."""
        picture = planes(encoded)
        size = encoded.shape[0], encoded.shape[1]
        scene = reduced(encoded)
        colours = [
            clothes(sampled(picture, p.circle.square(COLOURS_SIDE), COLOURS_SIDE)[0], p.mask) for p in people
        ]
        return cls(people, colours, scene, size)

    def place(self, index: int) -> Place:
        """Return the place of one of the people."""
        person = self.people[index]
        return Place(person.circle, person.certainty, self.colours[index])


class Track:
    """Where the person who is followed is in each frame of a shot.

    `look` returns who is seen in a frame. It is given where the person is expected, or None, and may raise
    OSError or ValueError for a frame that cannot be read. `person` says who is meant, see
    `relight.matting.people.finder.find`. `corrections`: {frame: (x, y)}, points on the person. From there on
    they are followed again.
    """

    def __init__(
        self,
        look: Callable[[int, Circle | None], Seen],
        numbers: Sequence[int],
        person: PersonChoice | Circle = None,
        corrections: Mapping[int, tuple[int, int]] | None = None,
    ) -> None:
        self._look, self._numbers, self._person = look, numbers, person
        self._corrections = dict(corrections or {})
        self._places: dict[int, Place | None] = {}
        self._scene: np.ndarray | None = None
        self._near: dict[int, Circle | None] = {}  # where the person was expected in a frame
        self._recent: dict[int, Seen] = {}  # who is in the last few frames

    def seen(self, number: int) -> Seen:
        """Return who is seen in a frame, as they were when the person was followed to it.

        Raises what `look` raises.
        """
        self.at(number)
        if number not in self._recent:
            return self._look(number, self._near.get(number))
        return self._recent[number]

    def at(self, number: int) -> Circle | None:
        """Return the circle of the person in a frame; None where they are not.

        Raises ValueError if `person` says somebody who is in none of the frames.
        """
        if not self._places:
            self._begin()
        for each in self._numbers[len(self._places) : self._numbers.index(number) + 1]:
            self._places[each] = self._next(each)
        place = self._places[number]
        return None if place is None else place.circle

    def _begin(self) -> None:
        """Find the first frame with the person, and follow them back to the first frame of all."""
        uncertain, refused = None, None
        for position, number in enumerate(self._numbers):
            seen = self._seen(number)
            if seen is None or not seen.people:
                continue
            person = self._corrections.get(number, self._person)
            try:
                place = seen.place(index_of(seen.people, person, seen.size))
            except ValueError as error:  # nobody here is the third, for example
                refused = refused or error
                continue
            if place.certainty >= CERTAIN or person is not None:
                return self._begin_at(position, place, seen.scene)
            uncertain = uncertain or (position, place, seen.scene)
        if uncertain is not None:
            return self._begin_at(*uncertain)
        if refused is not None:
            raise refused
        self._places = dict.fromkeys(self._numbers)

    def _begin_at(self, position: int, place: Place, scene: np.ndarray) -> None:
        """Take a place in a frame, and follow the person back through the frames before it."""
        found: dict[int, Place | None] = {self._numbers[position]: place}
        last, there_at, before = place, self._numbers[position], scene
        for number in reversed(self._numbers[:position]):
            seen = self._seen(number, last.circle)
            found[number] = None
            if seen is None or is_cut(before, seen.scene):
                break
            before = seen.scene
            if (there := _followed(seen, last, there_at - number)) is not None:
                found[number], last, there_at = there, there, number
        self._places = {number: found.get(number) for number in self._numbers[: position + 1]}
        self._scene = scene

    def _next(self, number: int) -> Place | None:
        """Follow the person to the frame after those that are known."""
        last = next((n for n in reversed(self._places) if self._places[n] is not None), None)
        before = None if last is None else self._places[last]
        seen = self._seen(number, None if before is None else before.circle)
        if seen is None:
            return None
        scene, self._scene = self._scene, seen.scene
        if not seen.people:
            return None
        if (point := self._corrections.get(number)) is not None:
            return seen.place(index_of(seen.people, point, seen.size))
        if before is None or (scene is not None and is_cut(scene, seen.scene)):
            place = seen.place(0)  # the largest, as in the first frame
            return place if place.certainty >= CERTAIN else None
        assert last is not None
        return _followed(seen, before, number - last)

    def _seen(self, number: int, near: Circle | None = None) -> Seen | None:
        with suppress(OSError, ValueError):  # that frame is reported when it is its turn
            seen = self._look(number, near)
            self._near[number], self._recent[number] = near, seen
            if len(self._recent) > RECENT:
                del self._recent[next(iter(self._recent))]
            return seen
        return None

    def certainty(self, number: int) -> float:
        """Return how certain it is that the person is in a frame, 0 to 1; raises as `at` does."""
        self.at(number)
        place = self._places[number]
        return 0.0 if place is None else place.certainty

    def write(self, path: files.AnyPath, report: Callable[[int, int], None] | None = None) -> None:
        """Write the places in all frames to a .json file. `report` takes the frames done and their number."""
        path = files.check_writable(path, (SUFFIX,))  # first: following takes half a second a frame
        for done, number in enumerate(self._numbers, 1):
            self.at(number)
            if report is not None:
                report(done, len(self._numbers))
        frames = {
            str(number): None if place is None else [*_rounded(place.circle), round(place.certainty, 3)]
            for number, place in self._places.items()
        }
        with files.replacing(path) as file:
            file.write_text(json.dumps({"track": VERSION, "frames": frames}, indent=1), encoding="utf-8")


class KeptTrack:
    """A track that `Track.write` wrote."""

    def __init__(self, path: Path) -> None:
        """Read the file. Raises OSError if it cannot be read, and ValueError for another file."""
        self._path = path
        text = path.read_text(encoding="utf-8-sig", errors="replace")
        try:
            content = json.loads(text)
            version, frames = content["track"], content["frames"]
            self._circles = {int(number): _circle(values) for number, values in frames.items()}
            self._certainties = {
                int(n): 0.0 if found is None else float(found[3]) for n, found in frames.items()
            }
        except (KeyError, TypeError, AttributeError, RecursionError, ValueError) as error:
            raise ValueError(f"{path}: expected a track, as `relight track` writes it") from error
        if version != VERSION:
            raise ValueError(f"{path}: expected a track of version {VERSION}, got {version!r}")

    def at(self, number: int) -> Circle | None:
        """Return the circle of the person in a frame; None where they are not.

        Raises ValueError for a frame that the file lacks.
        """
        if number not in self._circles:
            raise ValueError(f"{self._path}: has no frame {number}; write the track of all frames again")
        return self._circles[number]

    def certainty(self, number: int) -> float:
        """Return how certain it is that the person is in a frame, 0 to 1; raises as `at` does."""
        self.at(number)
        return self._certainties[number]


def _circle(values: Iterable[float] | None) -> Circle | None:
    if values is None:
        return None
    x, y, radius, _ = map(float, values)
    if not all(map(math.isfinite, (x, y, radius))) or radius <= 0:
        raise ValueError(f"expected finite numbers and a radius above 0, got {values}")
    return Circle(np.array([x, y]), radius, np.array([0.0, -1.0]))


def _rounded(circle: Circle) -> tuple[float, float, float]:
    x, y = circle.centre.tolist()
    return round(x, 2), round(y, 2), round(circle.radius, 2)


def _followed(seen: Seen, last: Place, frames: int) -> Place | None:
    """Return the place of the person who was at `last`, that many frames before."""
    if not seen.people:
        return None
    places = [seen.place(index) for index in range(len(seen.people))]
    distances = [place.circle.distance(last.circle) for place in places]
    changes = [float(np.sqrt(((place.colours - last.colours) ** 2).mean())) for place in places]
    reach = min(REACH * frames, LONGEST_REACH)
    possible = [
        (distance + change / SAME_CLOTHES, index)
        for index, (place, distance, change) in enumerate(zip(places, distances, changes, strict=True))
        if (distance <= reach and change <= OTHER_CLOTHES)
        or ((distance <= 2 * reach or place.certainty >= CERTAIN) and change <= SAME_CLOTHES)
    ]
    return places[min(possible)[1]] if possible else None


def clothes(canvas: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return the mean colours (3, 3) of the upper, middle and lower third of a mask on a canvas (h, w, 3)."""
    inside = resize(mask, canvas.shape[:2], "triangle") > 0.5
    rows = np.nonzero(inside.any(axis=1))[0]
    if not len(rows):
        return np.zeros((3, 3))
    ends = np.linspace(rows[0], rows[-1] + 1, 4).round().astype(int)
    means = []
    for top, bottom in pairwise(ends):
        part = canvas[top:bottom][inside[top:bottom]]
        means.append(part.mean(axis=0) if len(part) else np.zeros(3))
    return np.array(means)
