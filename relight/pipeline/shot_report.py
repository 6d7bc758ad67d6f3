"""A report of a shot: for each frame what tells a supervisor where to look."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TypedDict, cast

import numpy as np

from relight.matting.people.track import OTHER_CLOTHES, SAME_CLOTHES, clothes
from relight.media import colour
from relight.media.resampling import resize, size_within
from relight.media.sequences import FrameRange
from relight.pipeline.persons import FramePerson
from relight.subject import Subject
from shadow import files

SUFFIX = ".json"
VERSION = 1
UNSURE = 0.88  # mean confidence below that of the light stage's bodies, 0.91 to 0.93
SIDE = 128  # pixels, the longer side of the copies whose colours are compared
JUMP = 0.5  # share by which the area changes where somebody in somewhat other colours is another one


class Entry(TypedDict, total=False):
    """What is kept of a frame, see `ShotReport`; `colours`: those of the person, see `clothes`."""

    certainty: float | None
    area: float
    confidence: float | None
    unsure: bool
    neighbours: list[int] | None
    colours: list[list[float]] | None
    made_from: str
    error: str


class ShotReport:
    """The report of a shot, written after every frame, so that an interruption loses none.

    {frame: entry}, with these entries. certainty: that a person is there, 0 to 1; null where the matte was
    given. area: share of the picture that the person covers. area_jump: its change since the last frame with
    a person, 0.5 for half as much again. neighbours: the frames with which the maps were averaged; null for
    an analysis that was kept. likely_other_person: whether colours, or colours and area, are rather those of
    somebody else than in the last frame. confidence: the probability, mean over the person, that shadows are
    right, see `Subject.confidence`; unsure: whether it is below 0.88. error: why there is no frame.
    """

    def __init__(self, path: Path, resume: bool) -> None:
        """`resume`: whether the entries of an earlier run that have the same hash are kept."""
        self._path = path
        self._entries: dict[int, Entry] = self._read() if resume else {}

    def _read(self) -> dict[int, Entry]:
        try:
            content = json.loads(self._path.read_text(encoding="utf-8"))
            if content["report"] != VERSION:
                return {}
            return {int(number): cast(Entry, dict(entry)) for number, entry in content["frames"].items()}
        except (OSError, KeyError, TypeError, AttributeError, RecursionError, ValueError):
            return {}  # another file, or none: it is written again

    def has(self, number: int, made: str) -> bool:
        """Return whether there is an entry of a frame that was made from exactly these inputs."""
        return self._entries.get(number, {}).get("made_from") == made

    def write(self, number: int, person: FramePerson, made: str) -> None:
        """Add a frame, and write the report."""
        subject, certainty, neighbours = person
        area, colours = _area_and_colours(subject)
        sure = None if subject.is_empty else round(subject.mean_confidence, 3)
        self._entries[number] = {
            "certainty": None if certainty is None else round(certainty, 3),
            "area": round(area, 5),
            "confidence": sure,
            "unsure": sure is not None and sure < UNSURE,
            "neighbours": neighbours,
            "colours": None if colours is None else colours.astype(float).round(3).tolist(),
            "made_from": made,
        }
        self._write_all()

    def write_only(self, numbers: FrameRange, problems: Mapping[int, str]) -> None:
        """Write the report of these frames alone."""
        entries = {number: self._entries.get(number, {}) for number in numbers}
        self._entries = entries | {number: {"error": problem} for number, problem in problems.items()}
        self._write_all()

    def _write_all(self) -> None:
        """Write all entries, and what follows from each and the one before it."""
        frames: dict[str, Mapping[str, object]] = {}
        last: Entry | None = None
        for number, entry in sorted(self._entries.items()):
            shown = entry if entry.get("area") else None
            frames[str(number)] = {**entry, **(_compared(shown, last) if "area" in entry else {})}
            last = shown or last
        with files.replacing(self._path) as beside:
            beside.write_text(json.dumps({"report": VERSION, "frames": frames}, indent=1), encoding="utf-8")


def _compared(entry: Entry | None, last: Entry | None) -> dict[str, object]:
    """Return what a frame and the last one with a person say together."""
    if entry is None or last is None:
        return {"area_jump": None, "likely_other_person": False}
    jump = entry["area"] / last["area"] - 1
    change = 0.0
    if entry["colours"] is not None and last["colours"] is not None:
        change = math.sqrt(np.square(np.subtract(entry["colours"], last["colours"])).mean())
    other = change > OTHER_CLOTHES or (change > SAME_CLOTHES and abs(math.log1p(jump)) > math.log1p(JUMP))
    return {"area_jump": round(jump, 3), "likely_other_person": other}


def _area_and_colours(person: Subject) -> tuple[float, np.ndarray | None]:
    """Return the share of the picture that a person covers, and their colours, see `clothes`."""
    if person.is_empty:
        return 0.0, None
    picture = person.photographed()
    small = resize(picture, size_within(picture.shape, SIDE), "box")
    alpha = small[..., 3]
    colours = colour.encode(small[..., :3] / np.maximum(alpha, 1e-3)[..., None], white=1)
    return float(picture[..., 3].mean()), clothes(colours, alpha)
