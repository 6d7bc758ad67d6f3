"""Which of the people found in a picture is meant, and their mask without the others."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from relight.matting.people.region import Circle, DetectedPerson
from relight.matting.refine import PersonChoice, is_everybody
from relight.media.resampling import reduced_size

SAME_PERSON = 0.6  # the same, of two masks
COMPARED_SIDE = 256  # pixels, the longer side of the copy on which masks are compared
CERTAIN = 0.8  # certainty from which somebody is certainly there


@dataclass(frozen=True)
class Choice:
    """Who is meant among the people of a picture of `size` (H, W); `index` is None for all of them."""

    people: tuple[DetectedPerson, ...]
    index: int | None
    size: tuple[int, int]

    @classmethod
    def of(
        cls, people: Sequence[DetectedPerson], person: PersonChoice | Circle, size: tuple[int, int]
    ) -> "Choice":
        """Return the choice that `person` means; `relight.matting.people.finder.find` says what it may be."""
        return cls(tuple(people), None if is_everybody(person) else index_of(people, person, size), size)

    def mask(self) -> np.ndarray:
        """Return the mask (H, W) of who is meant, without the others."""
        return self.masks((0, 0), 1.0, self.size)[0]

    def masks(
        self, corner: Sequence[float], scale: float, size: tuple[int, int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the masks (h, w) of who is meant and of the others, in a crop of the picture.

        The crop begins at `corner` (top, left), and is scaled to `size`.
        """
        people = [each.within(corner, scale) for each in self.people]
        if self.index is None:
            return np.max([each.on(size) for each in people], axis=0), np.zeros(size, np.float32)
        chosen = people[self.index]
        mask, rivals = chosen.on(size), chosen.rivals_on(size)
        for other in people:
            if other is not chosen and other.certainty >= CERTAIN:
                theirs = other.on(size)
                mask = np.where(theirs > mask, np.minimum(mask, 1 - theirs), mask)
                rivals = np.maximum(rivals, theirs)
        return mask, rivals

    def landmarks(self, corner: Sequence[float], scale: float) -> np.ndarray:
        """Return the joints (P, N, 2), x and y, of who is meant in such a crop; of nobody if not known."""
        people = self.people if self.index is None else (self.people[self.index],)
        known = [each.landmarks for each in people if each.landmarks is not None]
        return (np.array(known) - [corner[1], corner[0]]) * scale if known else np.zeros((0, 33, 2))

    def box(self) -> tuple[int, int, int, int]:
        """Return top, left, bottom and right of who is meant, in pixels of the picture."""
        shrink = min(1.0, COMPARED_SIDE / max(self.size))
        mask = self.masks((0, 0), shrink, reduced_size(self.size, shrink))[0]
        rows, columns = np.nonzero(mask > 0.5)
        ends = (
            (rows.min(), columns.min(), rows.max() + 1, columns.max() + 1)
            if len(rows)
            else (0, 0, *mask.shape)
        )
        top, left, bottom, right = (round(end / shrink) for end in ends)
        return top, left, min(bottom, self.size[0]), min(right, self.size[1])


def as_circle(person: PersonChoice | Circle) -> PersonChoice | Circle:
    """Return the circle that (x, y, radius) means, and anything else unchanged."""
    if not isinstance(person, tuple | list) or len(person) != 3:
        return person
    x, y, radius = map(float, person)
    if not radius > 0:
        raise ValueError(f"person: expected a radius above 0, got {radius:g}")
    return Circle(np.array([x, y]), radius, np.array([0.0, -1.0]))


def index_of(found: Sequence[DetectedPerson], person: PersonChoice | Circle, size: tuple[int, int]) -> int:
    """Return which person is meant."""
    if isinstance(person, Circle):
        return int(np.argmin([each.circle.distance(person) for each in found]))
    if isinstance(person, Sequence | np.ndarray) and not isinstance(person, str) and np.shape(person) == (2,):
        x, y = (int(value) for value in person)
        if not (0 <= x < size[1] and 0 <= y < size[0]):
            raise ValueError(f"person: expected a point in the picture, got {x}/{y}")
        inside = [each.on(size) > 0.5 for each in found]
        far = [float(distance_transform_edt(~mask)[y, x]) if mask.any() else float("inf") for mask in inside]
        return int(np.argmin(far))
    number = 1 if person is None else person
    if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= len(found):
        raise ValueError(
            f"person: expected 1 to {len(found)}, as many as there are people, (x, y), "
            f"(x, y, radius) or 'all', got {person!r}"
        )
    return number - 1


def distinct(people: Sequence[DetectedPerson], size: tuple[int, ...]) -> list[DetectedPerson]:
    """Return each person once, as the most certain view shows them, or the larger one of two equal views."""
    shrink = COMPARED_SIDE / max(size)
    small = reduced_size(size, shrink)
    kept: list[DetectedPerson] = []
    masks: list[np.ndarray] = []
    for person in sorted(people, key=lambda each: (-round(each.certainty, 2), -each.area)):
        circle = person.circle
        circle = Circle(circle.centre * shrink, circle.radius * shrink, circle.up)
        mask = DetectedPerson(circle, person.mask).on(small) > 0.5
        if mask.any() and not any(
            (mask & theirs).sum() >= SAME_PERSON * min(mask.sum(), theirs.sum()) for theirs in masks
        ):
            kept.append(person)
            masks.append(mask)
    return kept
