"""The reference frame of a shot: the person's place and size in it, and its light, count for all frames.

It is the frame in which the person is largest and whole, among the first ones of the shot. What is looked at
is cheap: mattes that are given, or the circles of who is followed. Where each matte costs seconds, as with a
screen or a network of another kind, nothing is looked at beforehand: the first frame with a person counts.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, Self

import numpy as np

from relight.matting.people.region import Circle
from relight.pipeline.preview import EVERY

AMONG = 24  # first frames of a shot, of which every fourth is looked at: a preview has the same ones
LARGE = 0.5  # share of the largest person's area from which another counts as large


class Look(NamedTuple):
    """How a person stands in a picture."""

    number: int  # of the frame
    area: float  # share of the picture
    sides: int  # of the picture at which the person is cut

    @classmethod
    def at_matte(cls, number: int, matte: np.ndarray) -> Self | None:
        """Look at a matte (H, W) in [0, 1]; None if nobody is in it."""
        inside = matte > 0.5
        if not inside.any():
            return None
        edges = inside[0], inside[-1], inside[:, 0], inside[:, -1]
        return cls(number, float(inside.mean()), sum(bool(edge.any()) for edge in edges))

    @classmethod
    def at_circle(cls, number: int, circle: Circle, size: Sequence[int]) -> Self:
        """Look at the circle around a person in a picture of `size` (H, W)."""
        (x, y), radius = circle.centre, circle.radius
        beyond = x < radius, y < radius, x + radius > size[1], y + radius > size[0]
        return cls(number, float(np.pi * radius**2 / (size[0] * size[1])), sum(map(bool, beyond)))


def looked_at(numbers: Sequence[int]) -> list[int]:
    """Return the frames that are looked at, of those that a shot or its preview has."""
    return [number for number in numbers if number - numbers[0] in range(0, AMONG, EVERY)]


def best_first(
    numbers: Iterable[int], look: Callable[[int], Look | None]
) -> tuple[list[int], dict[int, Exception]]:
    """Return frames with a person, the best reference first, and the errors of those that cannot be read."""
    looks: list[Look] = []
    problems: dict[int, Exception] = {}
    for number in numbers:
        try:
            seen = look(number)
        except (OSError, ValueError) as error:
            problems[number] = error
            continue
        looks += [] if seen is None else [seen]
    large = LARGE * max((each.area for each in looks), default=0)
    ranked = sorted(looks, key=lambda each: (each.area < large, each.sides, -each.area, each.number))
    return [each.number for each in ranked], problems
