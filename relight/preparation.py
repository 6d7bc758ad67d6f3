"""What a frame is made of, from files to what `relight.Subject` takes: read, cut out, placed in the picture.

Stills and videos are prepared alike. A source is an image in memory, a file, a sequence or a movie.
"""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from relight.composite import place
from relight.cutting import Cutter, Cutting
from relight.keying import key as cut_out
from relight.lights.environment import FIELD_OF_VIEW, EnvironmentLight
from relight.lights.light import Light, by_name, checked_number
from relight.lights.moving import MovingLight
from relight.matching import Matching, PlateLight
from relight.media import images, movies
from relight.media.identity import identity
from relight.media.sequences import Files, Still
from relight.media.sequences import Sequence as Frames
from relight.rendering import Background, check_free
from relight.shot import Shot, is_shot
from shadow import normals as normals_module
from shadow.directions import CAMERA

ENVIRONMENT = "environment"  # as a background: what a camera sees of the environments among the lights
BACKGROUND = "background"  # as a size: the background's own
LARGEST = 2**28  # pixels of a picture: 4 GiB as floats

Source = np.ndarray | str | Path
Surface = np.ndarray | Callable | str | os.PathLike  # what normals may be given as


@dataclass(frozen=True)
class Placement:
    """Where the photograph lies in the picture; see `relight.place`.

    Parameters
    ----------
    size: (H, W) of the picture in pixels; "background" for its own; None for the photograph's.
    mode: "fit", "fill" or "centre". scale: of the photograph, on top of that. offset: (right, up) in pixels.

    Raises
    ------
    TypeError, ValueError: as `relight.place` does.
    """

    size: tuple[int, int] | str | None = None
    mode: str = "fit"
    scale: float = 1.0
    offset: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        size = (1, 1) if self.size is None or isinstance(self.size, str) else self.size
        if isinstance(self.size, str) and self.size != BACKGROUND:
            raise ValueError(f"size: expected (height, width) or {BACKGROUND!r}, got {self.size!r}")
        if np.prod(size, dtype=object) > LARGEST:
            raise ValueError(f"size: expected up to {LARGEST} pixels in all, got {size}")
        place(np.zeros((1, 1), np.float32), size, mode="centre", offset=self.offset)  # what is wrong is said
        place(np.zeros((1, 1), np.float32), (1, 1), mode=self.mode, scale=self.scale)

    def of(self, photograph: tuple[int, ...], backdrop: Any) -> tuple[int, ...] | None:
        """(H, W) of the picture that a photograph (H, W) is placed in; None where it stays as it is."""
        if self.size is None and self.scale == 1 and tuple(self.offset) == (0, 0):
            return None
        if self.size is None:
            return photograph
        if not isinstance(self.size, str):
            return self.size
        if getattr(backdrop, "ndim", 0) != 3:
            raise ValueError("size: 'background' expected a background that is an image")
        return backdrop.shape[:2]

    def __call__(self, image: np.ndarray, frame: tuple[int, ...] | None) -> np.ndarray:
        """An image (h, w, C) or mask (h, w) in the frame."""
        if frame is None:
            return image
        return place(image, (frame[0], frame[1]), mode=self.mode, scale=self.scale, offset=self.offset)


class Person(NamedTuple):
    """The person of one frame, prepared: what `relight.Subject` takes."""

    plate: np.ndarray
    matte: np.ndarray | None
    normals: Surface | None
    depth: np.ndarray | str | os.PathLike | None


class Preparation:
    """The frames of a shot: persons, and what is behind them.

    Parameters
    ----------
    source: the photograph, as an image or a file; or a sequence, such as `plate.%04d.exr` or
        `plate.####.exr`; or a movie, whose frames count from 1; or a folder of what `relight.analyse_shot`
        kept of them, and then all that decides the person was said there.
    mask: the person's matte, as a mask, or a file, sequence or movie of the same frame numbers; needed unless
        the source has alpha.
    key: "green" or "blue": cut the person out of a screen, see `relight.key`; the mask then says where there
        is one.
    cutting: Cutting: how a person without a matte gets one, or a rough mask is refined.
    colour_space: of the source, where its files do not say; see `relight.read`.
    normals: camera-frame normals of the photograph: an array; an image file or a sequence of them; or
        whatever else `shadow.normals.load` takes. Placed with the photograph.
    axes: of these normals, see `shadow.directions.from_axes`.
    depth: of the photograph: an array; an image file or a sequence of them, see
        `relight.media.images.read_depth`; or an ONNX file, as of `relight.Subject`. Placed with it.
    height: as of `relight.Subject`.
    background: as of `relight.apply`; or a file, sequence or movie; or "environment": what a camera of
        `field_of_view` sees of the environments among the lights.
    field_of_view: of the picture's camera, vertical, in degrees.
    placement: Placement of the photograph in the picture.
    matching: Matching: what light the picture borrows, of its background above all.

    Raises
    ------
    FileNotFoundError: no such file or frames. TypeError, ValueError: bad arguments.
    """

    def __init__(
        self,
        source: Source,
        *,
        mask: Source | None = None,
        key: str | None = None,
        cutting: Cutting | None = None,
        colour_space: str | None = None,
        normals: Surface | None = None,
        axes: str = CAMERA,
        depth: Source | os.PathLike | None = None,
        height: float | None = None,
        background: Background | MovingLight | str | Path | None = None,
        field_of_view: float = FIELD_OF_VIEW,
        placement: Placement | None = None,
        matching: Matching | None = None,
    ) -> None:
        self.placement, self._key = placement or Placement(), key
        self._matching = matching or Matching()
        model = None if cutting is None or cutting.model is None else Path(cutting.model)
        self._options = (key, cutting, model, colour_space, axes, field_of_view, height, self.placement)
        self.field_of_view = checked_number("field_of_view", field_of_view, 1e-3, 170)
        self.height = None if height is None else checked_number("height", height, 0.01, 100)
        self._surfaces, self._depths = _surfaces(normals, axes), _depths(depth)
        self.kept: Shot | None = None
        if is_shot(source):
            decided = {
                "mask": mask, "key": key, "matte": cutting, "colour_space": colour_space, "normals": normals,
                "depth": depth, "height": height,
            }  # fmt: skip
            _refuse_decided(source, decided | {"size": None if placement in (None, Placement()) else 1})
            self.kept = Shot(source)
        self._plates: Any = self.kept or _opened(
            source, lambda path: images.read(path, colour_space=colour_space), movies.Movie, colour_space
        )
        self._mattes = _opened(mask, images.read_mask, _MatteMovie, "lin_rec709")
        self._cutter = None
        if cutting is not None:
            if key is not None or (cutting.model is not None and mask is not None):
                raise ValueError("matte: expected one of mask, key and matte (--mask, --key, --matte)")
            self._cutter = Cutter(cutting, self._plates.read, self._plates.numbers)
        self._sees_lights = isinstance(background, str) and background == ENVIRONMENT
        self._backdrops = _opened(None if self._sees_lights else background, images.read, movies.Movie)
        self.has_background = background is not None
        self._plate_light = PlateLight(self._backdrops, self.field_of_view)
        if self._matching.plate:
            self._plate_light.check()

    @property
    def options(self) -> str:
        """Differs where a preparation was told something else, the sources and the background apart."""
        return identity(self._options)

    def files(self, numbers: Iterable[int]) -> list[Path]:
        """The files that the persons of frames are read from, matte and normals included."""
        wanted, sources = list(numbers), (self._plates, self._mattes, self._surfaces, self._depths)
        found = [source.file(n) for n in wanted for source in sources]
        if self._cutter is not None:
            found += [self._plates.file(m) for n in wanted for m in self._cutter.sees(n)]
            model = self._options[2]
            found += [model] if model is not None and model.is_file() else []
        return [path for path in found if path is not None]

    @property
    def numbers(self) -> Sequence[int] | None:
        """The frames that there are of a moving person; None of a still."""
        return self._plates.numbers or self._mattes.numbers or self._surfaces.numbers or self._depths.numbers

    @property
    def span(self) -> tuple[int, int] | None:
        """The first and the last frame that the sources have, the person's before the background's."""
        for source in (self._plates, self._mattes, self._surfaces, self._depths, self._backdrops):
            if source.numbers:
                return source.numbers[0], source.numbers[-1]
        return None

    @property
    def rate(self) -> Fraction | float | None:
        """Frames a second, if the source says."""
        return self._plates.rate

    def check_lights(self, lights: Iterable[Light]) -> None:
        """ValueError where the background is to be the lights' environment and there is none, or where a
        light has the name of the background's layer."""
        named = by_name(lights)
        if self._sees_lights and not any(isinstance(light, EnvironmentLight) for light in named.values()):
            raise ValueError("background: 'environment' expected an environment among the lights")
        if self.has_background:
            check_free(named)
        self._matching.check_names(named)

    def identity(self, number: int, around: Iterable[int]) -> str:
        """Differs where a frame is made of something else: what is read for it and for the frames `around`,
        which steady it, and all that this preparation was told."""
        sources = (self._plates, self._mattes, self._surfaces, self._depths)
        persons = [source.identity(n) for n in around for source in sources]
        if self._cutter is not None:
            persons += [self._plates.identity(m) for n in around for m in self._cutter.sees(n)]
        places = [number]
        if self.placement.size == BACKGROUND and self._backdrops.numbers:
            places.append(self._backdrops.numbers[0])
        if self._matching.plate:
            places += self._plate_light.sees(number)
        backdrops = [self._backdrops.identity(n) for n in places]
        options = (*self._options, self._matching.plate)
        return identity(options, self.has_background, self._sees_lights, persons, backdrops)

    def person(self, number: int) -> Person:
        """The person of a frame; of a still, of any number.

        Raises as reading, `relight.key` and `relight.place` do; ValueError for a photograph without a matte.
        """
        plate, matte = self._plates.read(number), self._mattes.read(number)
        if self._cutter is not None:
            plate, matte = self._cutter.cut(number, matte), None
        elif self._key is not None:
            plate, matte = cut_out(plate, self._key, mask=matte), None
        elif matte is None and np.shape(plate)[2:] == (3,):
            raise ValueError(
                "mask: the image has no alpha channel, so give the person's matte (--mask FILE), "
                "have it made (--matte MODEL), or cut the person out of a screen (--key green, of apply "
                "and video)"
            )
        behind = None
        if self.placement.size == BACKGROUND:  # a still lies in all frames as in the background's first
            first = (self._backdrops.numbers or [number])[0]
            behind = self._backdrops.read(first if self.numbers is None else number)
        frame = self.placement.of(np.shape(plate)[:2], behind)
        surface, depth = self._surfaces.read(number), self._depths.read(number)
        if frame is not None and isinstance(depth, np.ndarray) and depth.ndim == 2:
            depth = self.placement(np.repeat(depth[..., None], 3, axis=-1), frame)[..., 0]
        if frame is not None and isinstance(surface, np.ndarray):
            surface = self.placement(surface, frame)
        matte = None if matte is None else self.placement(matte, frame)
        return Person(self.placement(plate, frame), matte, surface, depth)

    def size(self, number: int) -> tuple[int, int]:
        """(H, W) of the picture of a frame, in pixels."""
        if self.kept is not None:
            return self.kept.read(number).size
        height, width = np.shape(self.person(number).plate)[:2]
        return height, width

    def backdrop(self, number: int, lights: Iterable[Light], size: tuple[int, int]) -> Background | None:
        """What is behind the person of a frame, in a picture of `size` (H, W) and this frame's lights."""
        if self._sees_lights:
            skies = [light for light in lights if isinstance(light, EnvironmentLight)]
            return np.sum([sky.view(size, self.field_of_view) for sky in skies], axis=0)
        found: Any = self._backdrops.read(number)
        found = found.at(number) if isinstance(found, MovingLight) else found
        return found.view(size, self.field_of_view) if isinstance(found, EnvironmentLight) else found

    def borrowed(self, number: int, size: tuple[int, ...]) -> list[EnvironmentLight]:
        """The light of the background of a frame, in a picture of `size` (H, W), if it is matched."""
        return [self._plate_light.at(number, size)] if self._matching.plate else []

    @property
    def borrows_once(self) -> bool:
        """Whether the light of the background is the same in all frames."""
        return self._backdrops.numbers is None


def _refuse_decided(source: Source, given: Mapping[str, object]) -> None:
    """ValueError where something is given that a kept analysis was made with."""
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{name}: {source} is analysed already; give it to `relight analyse`")


def _surfaces(normals: Surface | None, axes: str) -> Still | Files | movies.Movie:
    """Where the normals of a frame come from."""
    if normals is None:
        if axes != CAMERA:
            raise ValueError("axes: those of which normals? expected normals as well")
        return Still(None)
    if not isinstance(normals, str | os.PathLike) or Path(normals).suffix.lower() in (
        "",
        ".pt",
        ".onnx",
        ".safetensors",
    ):
        made_of = Path(normals) if isinstance(normals, str | os.PathLike) else normals
        return Still(normals if axes == CAMERA else normals_module.load(normals, axes=axes), made_of)
    return _opened(normals, lambda path: images.read_normals(path, axes=axes), _no_movie)


def _depths(depth: Source | os.PathLike | None) -> Still | Files | movies.Movie:
    """Where the depth of a frame comes from."""
    if isinstance(depth, str | os.PathLike) and Path(depth).suffix.lower() == ".onnx":
        return Still(depth, Path(depth))
    return _opened(depth, images.read_depth, _no_movie)


def _no_movie(path: Path, **_: object) -> Still:
    raise ValueError(f"normals, depth: expected images, got the movie {path}")


def _opened(
    value: object, read: Callable, read_movie: Callable, colour_space: str | None = None
) -> Still | Files | movies.Movie:
    """What has `read(number)` for the frames of an argument: a still, a sequence or a movie."""
    if not isinstance(value, str | Path):
        return Still(value)
    if movies.is_movie(value):
        return read_movie(value, colour_space=colour_space)
    sequence = Frames.of(value)
    return Still(read(value), path=Path(value)) if sequence is None else Files(sequence, read)


class _MatteMovie(movies.Movie):
    """A movie as mattes: its alpha, or its grey as it is stored."""

    def read(self, number: int) -> np.ndarray:
        pixels = super().read(number)
        return pixels[..., 3] if pixels.shape[-1] == 4 else pixels.mean(axis=-1)
