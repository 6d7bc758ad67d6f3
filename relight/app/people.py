"""Who is in a photograph, for a page that outlines them, and what is odd about whom it lights."""

import functools
import os
from dataclasses import dataclass

import cv2
import numpy as np

from relight.app import drawing
from relight.app.messages import PersonOutline, Points
from relight.matting.people import finder
from relight.matting.people.choice import CERTAIN
from relight.matting.people.region import DetectedPerson
from relight.matting.refine import encoded_srgb
from relight.media.resampling import reduced_size

EVERYONE = "everyone"
OUTLINED_SIDE = 512  # pixels, the longer side of the copy on which people are outlined
SMOOTH = 1.0  # pixels of that copy by which an outline's corners may differ from the mask's edge
LEAST_AREA = 16  # square pixels of that copy: smaller parts of a mask are not outlined
SMALL = 0.01  # share of the picture: less of a person is a small part
PART = 0.4  # share of the person whom the pose networks see: less in the matte is a small part


@dataclass(frozen=True)
class Found:
    """Who is in a picture (H, W, 3), encoded in [0, 1], the largest first.

    turns: quarter turns, clockwise, after which somebody stands upright in it; 0 if it seems to be upright.
    """

    picture: np.ndarray
    people: list[DetectedPerson]
    turns: int

    def outlines(self) -> list[PersonOutline]:
        """Return each person's number, from 1, and closed lines around them, in shares of the picture."""
        shrink = min(1.0, OUTLINED_SIDE / max(self.picture.shape[:2]))
        size = reduced_size(self.picture.shape, shrink)
        return [
            {"number": number, "lines": lines}
            for number, person in enumerate(self.people, 1)
            if (lines := _lines(person.within((0, 0), shrink).on(size) > 0.5))
        ]

    def oddity(self, person: int | str, matte: np.ndarray) -> str | None:
        """Return what is odd about the matte (H, W) of a person: turned, uncertain or small; or None."""
        if self.turns:
            return "turned"
        chosen = self.people if person == EVERYONE else [self.people[int(person) - 1]]
        if max(each.certainty for each in chosen) < CERTAIN:
            return "uncertain"
        seen = sum(float(each.on((matte.shape[0], matte.shape[1])).sum()) for each in chosen)
        return "small" if matte.sum() < max(SMALL * matte.size, PART * seen) else None


def found() -> Found:
    """Return who is in the reduced copy in the working folder, who is looked for once."""
    return _found(os.getcwd(), os.stat(drawing.REDUCED).st_mtime_ns)


@functools.lru_cache(maxsize=1)
def _found(folder: str, written: int) -> Found:
    """Look for people in the copy in `folder`, the working folder, of that time."""
    picture = encoded_srgb(drawing.reduced()[..., :3])
    network = finder.load()
    people = network.people(picture)
    return Found(picture, people, network.turns_to_upright(picture, people))


def _lines(mask: np.ndarray) -> list[Points]:
    """Return the outer contours of a mask (h, w), as places in shares of width and height."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    scale = np.array(mask.shape[::-1], float)
    smooth = [
        cv2.approxPolyDP(contour, SMOOTH, closed=True)
        for contour in contours
        if cv2.contourArea(contour) >= LEAST_AREA
    ]
    return [((line[:, 0] + 0.5) / scale).round(4).tolist() for line in smooth]
