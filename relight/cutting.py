"""The person cut out of frames that show them before anything: a network's matte, or a rough mask refined."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from relight import matting
from shadow.files import AnyPath

WARM = 5  # frames that a recurrent network sees before the first one that is asked for
ALIKE = 0.03  # encoded colour, RMS over red, green and blue, within which a pixel of two frames is the same


@dataclass(frozen=True)
class Cutting:
    """How a person without a matte gets one.

    Parameters
    ----------
    model: as of `relight.matte`; None where there is a rough mask.
    options: how its file is fed, as of `relight.matting.load`.
    person: which of several, as of `relight.matte`.
    refine: pixels of a band around the matte's edge that closed-form matting solves anew.
    """

    model: AnyPath | None = None
    options: dict[str, Any] = field(default_factory=dict)
    person: Any = None
    refine: int | None = None

    @classmethod
    def parse(cls, model: str | None, person: str | None, refine: int | None) -> Self | None:
        """From the texts `model.onnx,mean=0.5/0.5/0.5,std=1/1/1` and `2` or `640/300`; None without any.

        ValueError for other texts.
        """
        if model is None and refine is None:
            if person is not None:
                raise ValueError("--person: expected --matte as well, whose people it chooses from")
            return None
        path, *words = (model or "").split(",")
        return cls(path or None, dict(map(_option, words)), _person(person), refine)


class Cutter:
    """Cuts the person out of the frames of a shot.

    Frames are steady: by a recurrent network's states, else by averaging a frame's matte with those before
    and after it where their colours agree.
    """

    def __init__(self, cutting: Cutting, read: Callable[[int], Any], numbers: Any) -> None:
        """`read` gives a frame's photograph; `numbers` are the frames that there are, None of a still."""
        self._cutting, self._read, self._numbers = cutting, read, numbers
        self._matter = None
        if cutting.model is not None:
            self._matter = matting.load(cutting.model, **cutting.options)
        self._found: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def sees(self, number: int) -> list[int]:
        """The other frames that a frame's matte depends on."""
        if self._numbers is None or self._matter is None:
            return []
        if self._matter.recurrent:
            return [n for n in range(number - WARM, number) if n in self._numbers]
        return [n for n in (number - 1, number + 1) if n in self._numbers]

    def cut(self, number: int, mask: np.ndarray | None) -> np.ndarray:
        """The person of a frame (H, W, 4), linear and premultiplied; in a shot nobody may be there.

        Raises as `relight.matte` does.
        """
        pixels = matting.opaque(self._read(number))
        if self._matter is None:
            if mask is None:
                raise ValueError("refine_matte: expected a mask or a matte to refine")
            found = np.asarray(mask, np.float32)
        else:
            found = self._steady(number)
            if self._numbers is None and found.max() <= 0.5:
                raise ValueError(
                    f"matte: {self._cutting.model} found nobody: nowhere above {found.max():.2g}"
                )
        if found.max() > 0.5 and self._matter is not None:
            found = matting.chosen(found, self._cutting.person)
        if found.max() > 0.5 and self._cutting.refine is not None:
            found = matting.refined(pixels, found, self._cutting.refine)
        return matting.cut_out(pixels, found)

    def _steady(self, number: int) -> np.ndarray:
        """The matte of a frame, averaged with its neighbours' unless the network remembers them."""
        assert self._matter is not None
        near = [number, *([] if self._matter.recurrent else self.sees(number))]
        self._found = {n: found for n, found in self._found.items() if abs(n - number) <= 2}
        for n in near:
            if n not in self._found:
                self._found[n] = self._seen(n)
        seen, found = self._found[number]
        total, weights = found.copy(), np.ones_like(found)
        for n in near[1:]:
            other, theirs = self._found[n]
            if other.shape == seen.shape:
                weight = np.exp(-((other - seen) ** 2).mean(axis=-1) / (2 * ALIKE**2))
                total, weights = total + weight * theirs, weights + weight
        return total / weights

    def _seen(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """A frame, sRGB-encoded, and what the network alone finds in it."""
        assert self._matter is not None
        if self._matter.recurrent and number - 1 not in self._found:
            self._matter.forget()
            for before in self.sees(number):
                self._matter(matting.encoded(matting.opaque(self._read(before))))
        seen = matting.encoded(matting.opaque(self._read(number)))
        return seen, matting.everywhere_not(self._matter(seen), self._cutting.model or "")


def _option(text: str) -> tuple[str, Any]:
    """`mean=0.5/0.5/0.5` as a name and a value."""
    name, _, value = text.partition("=")
    read: dict[str, Callable[[str], Any]] = {
        "family": str,
        "fit": str,
        "order": str,
        "size": int,
        "output": int,
        "mean": lambda text: tuple(map(float, text.split("/"))),
        "std": lambda text: tuple(map(float, text.split("/"))),
        "sigmoid": lambda text: {"yes": True, "no": False}[text],
    }
    try:
        return name, read[name](value)
    except (KeyError, ValueError) as error:
        raise ValueError(
            "--matte: expected MODEL,family=...,size=320,mean=0/0/0,std=1/1/1,order=rgb,fit=stretch,output=0,"
            f"sigmoid=yes or no, or fewer of these; got {text!r}"
        ) from error


def _person(text: str | None) -> Any:
    """`2` as a number, `640/300` as a point."""
    if text is None:
        return None
    try:
        values = tuple(map(int, text.split("/")))
        return values[0] if len(values) == 1 else (values[0], values[1])
    except (ValueError, IndexError) as error:
        raise ValueError(f"--person: expected a number, or a point as X/Y, got {text!r}") from error
