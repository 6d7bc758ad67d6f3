"""Light that is found and not set: that of another person's photograph, and that of the background."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from relight.composite import cover
from relight.cutting import Cutter, Cutting
from relight.fitting import fit_lights
from relight.foreground import matte_of, plate_of
from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight
from relight.lights.files import write_lights
from relight.lights.plate import opaque
from relight.media import images, movies
from relight.media.sequences import Files, Sequence, Still
from relight.subject import Subject

PLATE = "plate"  # the name of the background's light
FITTED = "match"  # what the names of a reference's lights begin with
FAINT = 0.01  # share of all light that the weakest lights of a reference have together; they are left out
AROUND = 12  # frames before and after one whose backgrounds light it as well: a second in all
SMALL = 96  # rows of a moving background that its light is taken from


def match(
    subject: Subject, reference: np.ndarray, *, mask: np.ndarray | None = None
) -> list[DirectionalLight]:
    """The lights of a photograph of another person, for a subject to stand in.

    Parameters
    ----------
    subject: relight.Subject, who is to stand in these lights.
    reference: (H, W, 3|4), the photograph of somebody else, as `relight.Subject` takes it.
    mask: (H, W), the matte of that person; needed unless the reference has alpha.

    Returns
    -------
    DirectionalLights for `subject.relit`, the strongest first, named `match1`, `match2`...; none of a black
    picture. They are as bright as is needed to make the reference's albedo the reference: in them, what is as
    pale as something in the reference is as bright as that. The weakest, 1 % of the light, are left out and
    the rest is so much brighter. A tint that all of the reference has is taken for its colour (see
    `relight.fit_lights`).

    Raises
    ------
    TypeError: no Subject. TypeError, ValueError: as `relight.Subject`, of the reference.
    """
    if not isinstance(subject, Subject):
        raise TypeError(f"subject: expected a relight.Subject, got {type(subject).__name__}")
    return lights_in(reference, mask)


def lights_in(
    reference: np.ndarray, mask: np.ndarray | None = None, device: str | None = None
) -> list[DirectionalLight]:
    """The lights of a photograph, as `match` gives them; `device` is where the networks run."""
    lights = fit_lights(reference, Subject(reference, mask, device=device))
    if not lights:
        return []
    powers = np.array([light.power for light in lights])
    shares = powers.mean(axis=1).cumsum() / powers.mean(axis=1).sum()
    kept = int((shares < 1 - FAINT).sum()) + 1
    brighter = powers.sum(axis=0) / np.maximum(powers[:kept].sum(axis=0), 1e-9)
    powers = powers[:kept] * brighter
    # What each colour lacks differs: of two lights about alike the other may now be the stronger.
    order = np.argsort(-powers.mean(axis=1), kind="stable")
    return [
        replace(lights[index], colour=powers[index].tolist(), name=f"{FITTED}{number}")
        for number, index in enumerate(order, 1)
    ]


@dataclass(frozen=True)
class Matching:
    """What light a picture borrows.

    Parameters
    ----------
    plate: the background's, as `relight.EnvironmentLight.from_plate` finds it; the light's name is "plate".
    reference: a photograph of somebody, as an image or a file, whose lights are taken, as of `relight.match`.
    mask: that person's matte, as a mask or a file.

    Raises
    ------
    ValueError: a mask without a reference, a movie or a sequence.
    """

    plate: bool = False
    reference: Any = None
    mask: Any = None

    def __post_init__(self) -> None:
        if self.reference is None and self.mask is not None:
            raise ValueError("match_mask: expected a reference as well (--match FILE), whose matte it is")
        for path in (self.reference, self.mask):
            if isinstance(path, str | Path) and (movies.is_movie(path) or Sequence.of(path) is not None):
                raise ValueError(f"match: expected one picture's file, got {path}")

    def keeps(self, path: Path | None) -> Path | None:
        """The file of the background's light beside a lights file that is written; None without either."""
        return path.with_name(f"{path.stem}.{PLATE}.exr") if path is not None and self.plate else None

    def write_lights(self, path: Path, lights: Iterable[Any]) -> None:
        """As `relight.write_lights`; the background's light becomes a file beside it, which it names."""
        kept = []
        for light in lights:
            beside = self.keeps(path)
            if beside is not None and light.name == PLATE:
                images.write(beside, light.image.pixels)
                light = EnvironmentLight(beside, name=PLATE)
            kept.append(light)
        write_lights(path, kept)

    def check_names(self, names: Iterable[str]) -> None:
        """ValueError where a light has a name that borrowed light will have."""
        for name in names:
            taken = self.plate and name == PLATE
            if taken or (self.reference is not None and re.fullmatch(rf"{FITTED}\d+", name)):
                raise ValueError(f"lights: {name!r} names matched light; give the light another name")

    def person(self, cutting: Cutting | None = None) -> tuple[np.ndarray, np.ndarray | None] | None:
        """The reference and its matte, read and checked; None without one.

        A reference that has no matte gets one as the photograph does, by `cutting`. ValueError: there is no
        matte, or nobody in it.
        """
        if self.reference is None:
            return None
        reference, mask = self.reference, self.mask
        if isinstance(reference, str | Path):
            reference = images.read(reference)
        if isinstance(mask, str | Path):
            mask = images.read_mask(mask)
        try:
            pixels = plate_of(reference)
            alone = mask is None and (pixels.shape[-1] == 3 or pixels[..., 3].min() == 1)
            if alone and cutting is not None and cutting.model is not None:
                return Cutter(cutting, lambda number: reference, None).cut(0, None), None
            if alone:
                raise ValueError(
                    "the reference has no matte; expected one with alpha, or its matte (--match-mask FILE)"
                )
            matte_of(pixels, mask)
        except ValueError as error:
            raise ValueError(f"match: {error}") from error
        return reference, mask


class PlateLight:
    """The light of a background: of a still once, of one that moves for each frame.

    That of a background that moves is the mean over a second, in a Hann window, so that it does not flicker.
    """

    def __init__(self, backdrops: Still | Files | movies.Movie, field_of_view: float) -> None:
        """`field_of_view` is the picture's, vertical, in degrees; the background covers the picture."""
        if isinstance(backdrops, movies.Movie):  # a second reader: going back starts a movie over
            backdrops = movies.Movie(backdrops.path, colour_space=backdrops.colour_space)
        self._backdrops, self._field_of_view = backdrops, field_of_view
        self._maps: dict[int, np.ndarray] = {}

    def check(self) -> None:
        """ValueError unless the background is an image, or many, and opaque: of many, the first."""
        first = self._backdrops.read((self._backdrops.numbers or [0])[0])
        if np.ndim(first) != 3:
            raise ValueError("match_plate: expected a background that is an image (--background FILE)")
        opaque(first)

    def sees(self, number: int) -> list[int]:
        """The frames of the background whose light a frame has."""
        if self._backdrops.numbers is None:
            return [0]
        there = set(self._backdrops.numbers)
        return [n for n in range(number - AROUND, number + AROUND + 1) if n in there]

    def at(self, number: int, size: tuple[int, ...]) -> EnvironmentLight:
        """The light of a frame, behind a picture of `size` (H, W). Raises as reading does, and as
        `EnvironmentLight.from_plate`."""
        seen = self.sees(number)
        self._maps = {n: found for n, found in self._maps.items() if n in seen}
        for n in seen:
            if n not in self._maps:
                self._maps[n] = self._map(n, size)
        if not seen:
            self._backdrops.read(number)  # says which frame is missing
        weights = [np.cos(np.pi / 2 * (n - number) / (AROUND + 1)) ** 2 for n in seen]
        return EnvironmentLight(np.average([self._maps[n] for n in seen], 0, weights), name=PLATE)

    def _map(self, number: int, size: tuple[int, ...]) -> np.ndarray:
        """The surroundings in a frame of the background."""
        pixels = opaque(self._backdrops.read(number))
        height, width = pixels.shape[:2]
        # What of a background is cut off, above and below the picture or beside it, lights the person too.
        cut = max(1.0, size[1] / size[0] * height / width)
        whole = np.degrees(2 * np.arctan(cut * np.tan(np.radians(self._field_of_view / 2))))
        if self._backdrops.numbers is not None and height > SMALL:
            pixels = cover(pixels, (SMALL, max(1, round(width * SMALL / height))))
        return EnvironmentLight.from_plate(pixels, min(float(whole), 170.0)).image.pixels
