"""Mattes for the frames of a shot: inferred by a network, or a rough mask refined."""

import contextlib
import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self, cast

import numpy as np
import torch
import torch.nn.functional as F

from relight.matting import cutout_network, networks, refine, silhouette_files
from relight.matting.people.choice import as_circle
from relight.matting.people.finder import FoundPerson
from relight.matting.people.region import Circle
from relight.matting.people.track import REACH, KeptTrack, Track
from relight.matting.refine import PersonChoice
from relight.media import optical_flow
from relight.media.optical_flow import Motion
from relight.media.option_texts import split_file_and_settings
from relight.media.resampling import size_within
from relight.media.scenes import is_cut, reduced
from relight.media.sequences import Held
from shadow.files import AnyPath

WARM_UP_FRAMES = 5  # that a recurrent network sees before the first one that is asked for
COLOUR_SIGMA = 0.06  # difference of encoded colour, RMS over the channels, at which a neighbour counts 60 %
MOTION_SIDE = 1024  # pixels, the longer side of the copies in which the motion between frames is found


@dataclass(frozen=True)
class MattingOptions:
    """How a matte is inferred or refined."""

    model: AnyPath | None = None  # see `relight.matte`; None where a rough mask is refined
    options: networks.ModelOptions = field(default_factory=networks.ModelOptions)
    person: PersonChoice = None  # which of several people, see `relight.matte`
    track: Path | None = None  # a file that says where the person is in each frame, see `KeptTrack`
    refine: int | None = None  # pixels of the band along the edge that closed-form matting solves again
    is_rough: bool = False  # whether the mask of a person who is found does, without what cuts them out

    @classmethod
    def parse(
        cls,
        model: AnyPath | None,
        person: PersonChoice = None,
        refine: int | None = None,
        track: AnyPath | None = None,
        is_rough: bool = False,
    ) -> Self | None:
        """Read the model and its format from text, `model.onnx,mean=0.5/0.5/0.5,std=1/1/1`.

        None where there is nothing to infer or refine. Raises ValueError for other texts.
        """
        if model is None and refine is None:
            if person is not None:
                raise ValueError(
                    "person: expected a matting model as well (matte=MODEL), whose people it is among"
                )
            return None
        path, words = split_file_and_settings(str(model or ""))
        kept = None if track is None else Path(track)
        options = cast(networks.ModelOptions, dict(map(_option, words)))
        return cls(path or None, options, person, kept, refine, is_rough)


@dataclass(frozen=True)
class _InferredFrame:
    """A frame (H, W, 3), encoded in [0, 1], and the matte (H, W) that the network infers from it alone."""

    seen: np.ndarray
    matte: np.ndarray

    @functools.cached_property
    def scene(self) -> np.ndarray:
        """A copy on which scenes are compared."""
        return reduced(self.seen)

    @functools.cached_property
    def small(self) -> torch.Tensor:
        """A copy (3, h, w) in which the motion is found."""
        size = size_within(self.seen.shape, MOTION_SIDE)
        return F.interpolate(self.planes[None], size, mode="area")[0]

    @property
    def planes(self) -> torch.Tensor:
        """The frame as planes (3, H, W)."""
        return torch.from_numpy(np.moveaxis(self.seen, 2, 0))


class SequenceMatting:
    """Infers or refines the mattes of a shot.

    They are temporally stable: by the state of a recurrent network, otherwise by averaging each matte with
    those before and after it, moved along the optical flow, where the frames' colours agree.
    """

    def __init__(
        self, options: MattingOptions, read: Callable[[int], Held], numbers: Sequence[int] | None
    ) -> None:
        """Take the function that reads a frame, and the numbers of the frames; None for a still."""
        self._options, self._read, self._numbers = options, read, numbers
        if options.model != networks.AUTO:  # which is loaded for the first frame without a matte of its own
            _ = self._model
        self._found: dict[int, _InferredFrame] = {}
        self._motions: dict[tuple[int, int], Motion] = {}  # between small copies of two frames

    @functools.cached_property
    def _model(self) -> networks.MattingModel | None:
        """The model; raises as `networks.load` does."""
        options = self._options
        if options.model is None:
            return None
        if options.is_rough and options.model == networks.AUTO:
            return FoundPerson(options.person, is_rough=True)
        return networks.load(options.model, person=options.person, **options.options)

    def track(self, corrections: Mapping[int, tuple[int, int]] | None = None) -> Track | None:
        """Return who is followed through the shot; None for a still, for everybody, and for another model.

        `corrections`: see `Track`.
        """
        model, person = self._model, self._options.person
        if not isinstance(model, FoundPerson) or self._numbers is None or refine.is_everybody(person):
            return None
        return Track(
            lambda number, near: model.seen(self._encoded(number), near),
            list(self._numbers),
            as_circle(person),
            corrections,
        )

    @functools.cached_property
    def _track(self) -> Track | KeptTrack | None:
        """The track of the file, or one of its own."""
        return self.track() if self._options.track is None else KeptTrack(self._options.track)

    @property
    def is_followed(self) -> bool:
        """Whether one person is followed through the shot."""
        return self._track is not None

    def circle(self, number: int) -> Circle | None:
        """Return the circle of the person who is followed in a frame; None where they are not."""
        assert self._track is not None
        return self._track.at(number)

    def certainty(self, number: int) -> float | None:
        """Return how certain it is that the person who is followed is in a frame; None where nobody is."""
        return None if self._track is None else self._track.certainty(number)

    def _encoded(self, number: int) -> np.ndarray:
        """Return a frame (H, W, 3), sRGB-encoded in [0, 1]."""
        return refine.encoded_srgb(refine.opaque_photograph(self._read(number), "plate"))

    @property
    def network(self) -> str | Path | None:
        """What cuts people out: the name of a network, or the path of one; None if nobody is looked for."""
        if self._options.model != networks.AUTO:
            return None
        if given := self._options.options.get("silhouette"):
            return Path(given)
        return silhouette_files.NETWORK if silhouette_files.are_fetched() else cutout_network.identity()

    def frames_read(self, number: int) -> list[int]:
        """Return the other frames on which a frame's matte depends, the one that says whom to follow too."""
        looks = self._options.model == networks.AUTO and self._options.track is None
        return [*self.frames_for(number), *((self._numbers or ())[:1] if looks else ())]

    def frames_for(self, number: int) -> list[int]:
        """Return the neighbours of a frame on which its matte depends."""
        if self._numbers is None or self._options.model is None:
            return []
        if self._options.model != networks.AUTO and self._model is not None and self._model.recurrent:
            return [n for n in range(number - WARM_UP_FRAMES, number) if n in self._numbers]
        if not optical_flow.is_installed():
            return []
        return [n for n in (number - 1, number + 1) if n in self._numbers]

    def matte(self, number: int, mask: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return a frame's photograph (H, W, 3), linear, and its matte (H, W).

        A frame of a shot may have no person. Raises as `relight.matte` does.
        """
        pixels = refine.opaque_photograph(self._read(number), "plate")
        if self._model is None:
            if mask is None:
                raise ValueError("refine_matte: expected a mask or a matte to refine")
            found = np.asarray(mask, np.float32)
        else:
            found = self._filtered(number)
            if self._numbers is None:
                found = networks.checked_matte(found, self._options.model or "")
        if found.max() > 0.5 and self._model is not None and not self._model.selects:
            found = refine.select_person(found, self._options.person)
        if found.max() > 0.5 and self._options.refine is not None:
            from relight.matting import outline  # whose parts of SciPy take long to load

            found = outline.refine_matte(pixels, found, self._options.refine)
        return pixels, found

    def _filtered(self, number: int) -> np.ndarray:
        """Return the matte of a frame, averaged with its neighbours unless the network is recurrent."""
        assert self._model is not None
        near = [number, *([] if self._model.recurrent else self.frames_for(number))]
        self._found = {n: found for n, found in self._found.items() if abs(n - number) <= 2}
        self._motions = {pair: way for pair, way in self._motions.items() if number in pair}
        for n in near:
            if n not in self._found:
                try:
                    self._found[n] = self._inferred(n)
                except (OSError, ValueError):  # that frame is reported when it is its turn
                    if n == number:
                        raise
        found = self._found[number]
        total, weights = found.matte.copy(), np.ones_like(found.matte)
        for n in near[1:]:
            other = self._found.get(n)
            if other is None or is_cut(found.scene, other.scene) or other.seen.shape != found.seen.shape:
                continue
            if self._shows_the_same(n, number):
                weight, theirs = _moved(found, other, self._motion(number, n))
                total, weights = total + weight * theirs, weights + weight
        return total / weights

    def _motion(self, number: int, other: int) -> Motion:
        """Return the motion from a frame to one beside it; that back is kept for the other's turn."""
        if (number, other) not in self._motions:
            pair = optical_flow.both_motions(self._found[number].small, self._found[other].small)
            self._motions[number, other], self._motions[other, number] = pair
        return self._motions[number, other]

    def _shows_the_same(self, number: int, other: int) -> bool:
        """Return whether two neighbouring frames show the same person at about the same place, or nobody."""
        if self._track is None:
            return True
        here, there = self._track.at(number), self._track.at(other)
        if here is None or there is None:
            return here is there
        return here.distance(there) <= REACH

    def _inferred(self, number: int) -> _InferredFrame:
        assert self._model is not None
        if self._model.recurrent and number - 1 not in self._found:
            self._model.reset()
            for before in self.frames_for(number):
                with contextlib.suppress(OSError, ValueError):  # that frame was reported in its turn
                    self._model(self._encoded(before))
        seen = self._encoded(number)
        if self._track is None or not isinstance(self._model, FoundPerson):
            matte = self._model(seen)
        elif (circle := self._track.at(number)) is None:
            return _InferredFrame(seen, np.zeros(seen.shape[:2], np.float32))
        else:
            people = self._track.seen(number).people if isinstance(self._track, Track) else None
            matte = self._model.matte(seen, circle, people)
        return _InferredFrame(seen, networks.reject_full_matte(matte, self._options.model or ""))


def _moved(frame: _InferredFrame, other: _InferredFrame, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return the weight (H, W) of another frame in this one, and its matte (H, W), moved along the motion.

    `motion` is that between their small copies.
    """
    way = motion.resized(frame.seen.shape[:2])
    *moved, theirs = way.moved(torch.cat([other.planes, torch.from_numpy(other.matte)[None]]))
    squared = ((torch.stack(moved) - frame.planes) ** 2).mean(dim=0)
    weight = way.certainty[0] * torch.exp(-squared / (2 * COLOUR_SIGMA**2))
    return weight.numpy(), theirs.numpy()


def _option(text: str) -> tuple[str, object]:
    """Parse `mean=0.5/0.5/0.5` as a name and a value."""
    name, _, value = text.partition("=")
    read: dict[str, Callable[[str], object]] = {
        "family": str,
        "fit": str,
        "order": str,
        "size": int,
        "output": int,
        "mean": lambda text: tuple(map(float, text.split("/"))),
        "std": lambda text: tuple(map(float, text.split("/"))),
        "sigmoid": lambda text: {"yes": True, "no": False}[text],
        "silhouette": str,
    }
    try:
        return name, read[name](value)
    except (KeyError, ValueError) as error:
        raise ValueError(
            "--matte: expected MODEL,family=...,size=320,mean=0/0/0,std=1/1/1,order=rgb,fit=stretch,output=0,"
            f"sigmoid=yes or no, or fewer of these, or auto,silhouette=FILE; got {text!r}"
        ) from error
