"""A frame of a shot: read, cut out and placed in the picture, as `relight.Subject` takes it.

A source is an image in memory, a file, a sequence, a movie or an analysis cache.
"""

import functools
import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from relight.analysis.depth import MAX_DEPTH, MIN_COVERAGE
from relight.arguments import checked_number
from relight.compositing.placement import place
from relight.lights.environment import FIELD_OF_VIEW
from relight.matting import chroma_key, refine
from relight.matting.networks import AUTO
from relight.matting.people.track import KeptTrack, Track
from relight.matting.sequence import MattingOptions, SequenceMatting
from relight.media import images, movies, optical_flow
from relight.media import scenes as scene_cuts
from relight.media.content_hash import FileRecord, content_hash
from relight.media.images.arrays import as_array
from relight.media.pixel_aspect import is_square, square_pixels
from relight.media.sequences import Held
from relight.pipeline import preview, reference
from relight.pipeline.cache import AnalysisCache, is_cache
from relight.pipeline.option_fields import BACKGROUND
from relight.pipeline.options import MAX_TEMPORAL_RADIUS, Source
from relight.pipeline.plate_metadata import PlateMetadata, PlateMetadataReader
from relight.pipeline.readers import (
    Reader,
    ReadLog,
    depth_reader,
    matte_reader,
    normals_reader,
    person_reader,
)
from shadow.files import is_path
from shadow.installing import install_command

if TYPE_CHECKING:
    from relight.pipeline.options import Normals
    from relight.scene.camera_view import CameraView

NETWORK_SUFFIXES = (".onnx", ".pt")
SCENE_ROWS = 256  # rows and columns that are enough to see a cut
MAX_PICTURE_PIXELS = 2**28  # 4 GiB as RGBA floats


@dataclass(frozen=True)
class Placement:
    """Where the photograph lies in the picture; see `relight.place`, whose errors it raises."""

    size: tuple[int, int] | str | None = None  # (H, W); "background" for its own; None for the photograph's
    mode: str = "fit"  # or "fill" or "centre"
    scale: float = 1.0  # of the photograph, after that
    offset: tuple[int, int] = (0, 0)  # (right, up) in pixels

    def __post_init__(self) -> None:
        size = (1, 1) if self.size is None or isinstance(self.size, str) else self.size
        if isinstance(self.size, str) and self.size != BACKGROUND:
            raise ValueError(f"size: expected (height, width) or {BACKGROUND!r}, got {self.size!r}")
        if np.prod(size, dtype=object) > MAX_PICTURE_PIXELS:
            raise ValueError(f"size: expected up to {MAX_PICTURE_PIXELS} pixels in all, got {size}")
        place(np.zeros((1, 1), np.float32), size, mode="centre", offset=self.offset)  # refuses bad values
        place(np.zeros((1, 1), np.float32), (1, 1), mode=self.mode, scale=self.scale)

    def size_of(self, photograph: tuple[int, ...], background: Held) -> tuple[int, ...] | None:
        """Return the size (H, W) of the picture in which a photograph (H, W) is placed.

        None if it is not placed.
        """
        if self.size is None and self.scale == 1 and tuple(self.offset) == (0, 0):
            return None
        if self.size is None:
            return photograph
        if not isinstance(self.size, str):
            return self.size
        if getattr(background, "ndim", 0) != 3:
            raise ValueError("size: 'background' expected a background that is an image")
        return background.shape[:2]

    def __call__(self, image: np.ndarray, size: tuple[int, ...] | None) -> np.ndarray:
        """Place an image (h, w, C) or a mask (h, w) in a picture of `size`."""
        if size is None:
            return image
        return place(image, (size[0], size[1]), mode=self.mode, scale=self.scale, offset=self.offset)


class FrameInputs(NamedTuple):
    """What `relight.Subject` takes, for one frame."""

    plate: np.ndarray
    matte: np.ndarray | None
    normals: "Normals | None"
    depth: np.ndarray | str | os.PathLike | None


class FrameReader:
    """Reads the persons of a shot's frames, all files through a log.

    `backgrounds`: their reader, whose size the picture may have. `camera`: what the scene's camera sees,
    unless the source has a field of view of its own. `is_preview`: whether frames have half the size, and
    every fourth is there, see `relight.pipeline.preview`. Raises FileNotFoundError for no such file or
    frames, TypeError or ValueError for bad arguments.
    """

    def __init__(
        self,
        source: Source,
        backgrounds: Reader,
        log: ReadLog,
        camera: "CameraView | None" = None,
        is_preview: bool = False,
    ) -> None:
        self.source, self.is_preview = source, is_preview
        self.matting_options = MattingOptions.parse(
            source.matte, source.person, source.refine_matte, source.track, is_rough=is_preview
        )
        self.placement = Placement(source.size, source.placement, source.scale, source.offset)
        self.cache = AnalysisCache(source.plate) if is_cache(source.plate) else None
        self._camera = camera
        degrees = source.field_of_view
        self._degrees = None if degrees is None else checked_number("field_of_view", degrees, 1e-3, 170)
        self.height = None if source.height is None else checked_number("height", source.height, 0.01, 100)
        self._normals, self._depths = normals_reader(source.normals, source.axes), depth_reader(source.depth)
        self.plates: Reader = self.cache or person_reader(source.plate, source.colour_space, source.alpha)
        self._mattes = matte_reader(source.mask)
        self._backgrounds, self._log = backgrounds, log
        self._opaque: dict[int, bool] = {}  # {frame number: whether its plate is}
        self._scenes: dict[int, np.ndarray] = {}  # of the frames that were read last
        self._check_reference()
        if source.track is not None:
            KeptTrack(Path(source.track))  # raises for another file now, and not at the first frame

    def _check_reference(self) -> None:
        """Raise ValueError for a reference frame that is not there."""
        wanted = self.source.reference
        there = next((reader.numbers for reader in self.readers if reader.numbers), ())
        if wanted is not None and wanted not in there:
            span = f"{there[0]} to {there[-1]}" if there else "a still has none"
            raise ValueError(f"reference: expected a frame of the source, {span}, got {wanted}")

    @functools.cached_property
    def field_of_view(self) -> float:
        """Of the camera, vertical, in degrees: as given, or that of the scene's camera in this picture."""
        degrees = self._degrees
        if degrees is None and self._camera is not None:
            height, width = self.picture_size()
            degrees = checked_number(
                "field_of_view", self._camera.vertical_degrees(width / height), 1e-3, 170
            )
        if degrees is None:
            return FIELD_OF_VIEW if self.cache is None else self.cache.field_of_view
        return degrees

    def picture_size(self) -> tuple[int, ...]:
        """Return the size (H, W) of the picture of the first frame that can be read."""
        behind = None
        if self.placement.size == BACKGROUND:
            behind = self._log.read(self._backgrounds, (self._backgrounds.numbers or self.numbers)[0])
        for number in self.numbers:
            with suppress(OSError, ValueError):  # that frame is reported when it is its turn
                size = self.cache.read(number).size if self.cache else self.plates.read(number).shape[:2]
                return self.placement.size_of(size, behind) or size
        return 1, 1

    @functools.cached_property
    def _matting(self) -> SequenceMatting | None:
        """What makes mattes; None where the source has one, or is an analysis cache.

        With alpha in its frames, a source of which the person is to be found has one too: see `frame`.
        """
        options = self.matting_options
        given = self.source.mask is not None or self.source.key is not None or self.cache is not None
        if options is not None and options.model == AUTO and given:
            options = MattingOptions.parse(None, options.person, options.refine)
        if options is None:
            return None
        if self.source.key is not None or (options.model is not None and self.source.mask is not None):
            raise ValueError("matte: expected one of mask, key and matte")
        return SequenceMatting(options, lambda n: self._log.read(self.plates, n), self._shown(self.plates))

    def track(self, corrections: Mapping[int, tuple[int, int]] | None = None) -> Track | None:
        """Return who is found and followed through the frames; `corrections`: see `Track`.

        None where nobody is to be found, or everybody. Raises as `relight.matting.people.finder.find` does.
        """
        matting = self._matting
        if matting is None or self.plates.numbers is None or not self._finds_mattes:
            return None
        return matting.track(corrections)

    @functools.cached_property
    def _finds_mattes(self) -> bool:
        """Whether mattes are found or refined: not if the first plate has alpha. It is read unless it was."""
        return self._must_matte or self.is_opaque

    @functools.cached_property
    def is_opaque(self) -> bool:
        """Whether the first plate that can be read has no alpha, or none that is a matte."""
        for number in self.numbers:
            with suppress(OSError, ValueError):  # that frame is reported when it is its turn
                if number not in self._opaque:
                    self._opaque[number] = refine.is_opaque(self._log.read(self.plates, number))
                return self._opaque[number]
        return True

    def plate_files(self, number: int) -> set[Path]:
        """Return the files, with links resolved, from which the plate of a frame was read or analysed."""
        if self.cache is not None:
            return self.cache.source_files(number)
        path = self.plates.file(number)
        return set() if path is None else {path.resolve()}

    @property
    def _must_matte(self) -> bool:
        """Whether a matte is asked for expressly, so that alpha is refused and not taken."""
        options = self.matting_options
        assert options is not None
        return options.model != AUTO or options.person is not None or options.refine is not None

    @property
    def readers(self) -> tuple[Reader, ...]:
        """What a person is read with."""
        return self.plates, self._mattes, self._normals, self._depths

    @property
    def options_hash(self) -> str:
        """Differs where the source's options do, its pictures apart."""
        options = self.matting_options
        model = None if options is None or options.model is None else Path(options.model)
        network = [] if self._matting is None or not self._matting.network else [self._matting.network]
        axes = self.source.axes if self.source.normals is not None else None
        alpha = [] if self.source.alpha is None else [self.source.alpha]
        feather = [self.source.feather] if self.source.feather else []
        kind = ["preview"] if self.is_preview else []
        return content_hash(
            self.source.key, options, model, self.source.colour_space, axes, self.field_of_view, self.height,
            self.placement, self.temporal_radius, *alpha, *feather, *network, *kind,
        )  # fmt: skip

    @functools.cached_property
    def temporal_radius(self) -> int:
        """The number of frames before and after with which a frame is filtered; 0 for a still.

        Without OpenCV it is 0, with a warning.
        """
        radius = self.source.temporal_radius if self.source.temporal_filter else 0
        if radius == 0 or self.is_still:
            return 0
        if not optical_flow.is_installed():
            hint = install_command("video")
            warnings.warn(f"without OpenCV the light on a moving person flickers: {hint}", stacklevel=2)
            return 0
        return radius

    @functools.cached_property
    def is_still(self) -> bool:
        """Whether the person does not move: neither plate, matte, normals nor depth has frames."""
        return not any(reader.numbers for reader in self.readers)

    @functools.cached_property
    def numbers(self) -> Sequence[int]:
        """The frames that there are; (0,) for a still."""
        return next((shown for reader in self.readers if (shown := self._shown(reader))), (0,))

    def _shown(self, reader: Reader) -> Sequence[int] | None:
        """Return the numbers of a reader's frames that the shot has; None for a still."""
        return reader.numbers and reader.numbers[:: preview.EVERY if self.is_preview else 1]

    @functools.cached_property
    def pixel_aspect(self) -> float:
        """How many times as wide as high the plates' pixels are; 1 in a picture of another size."""
        if self.placement.size is not None:
            return 1.0
        if self.cache is not None:
            return self.cache.pixel_aspect
        if isinstance(self.plates, movies.Movie):
            return self.plates.upright_aspect()
        path = self.plates.file((self.plates.numbers or [0])[0])
        aspect = 1.0 if path is None else images.read_pixel_aspect(path)
        return 1.0 if is_square(aspect) else aspect

    @functools.cached_property
    def plate_metadata(self) -> Callable[[int], PlateMetadata]:
        """Returns what a frame's plate states of its scene and camera, as it is or as a cache keeps it."""
        return PlateMetadataReader(self.plates).at if self.cache is None else self.cache.plate_metadata

    @functools.cached_property
    def references(self) -> tuple[list[int], dict[int, Exception]]:
        """The frames that may be the reference, the best one first, and the errors of unreadable ones.

        See `relight.pipeline.reference`.
        """
        wanted, numbers = self.source.reference, self.numbers
        if wanted is not None:  # a preview takes the nearest of its frames
            return [min(numbers, key=lambda number: abs(number - wanted))], {}
        if self.is_still or self.cache is not None:
            return [], {}
        return reference.best_first(reference.looked_at(numbers), self._look)

    def certainty(self, number: int) -> float | None:
        """Return how certain it is that the person is in a frame, 0 to 1; None where nobody is followed."""
        if self._matting is None or self.is_still or not self._finds_mattes:
            return None
        return self._matting.certainty(number)

    def _look(self, number: int) -> reference.Look | None:
        """Look at the person of a frame, where that is cheap."""
        if self._matting is not None and self._finds_mattes and self._matting.is_followed:
            circle = self._matting.circle(number)
            if circle is None:
                return None
            return reference.Look.at_circle(number, circle, self._log.read(self.plates, number).shape)
        if self.source.mask is not None and self.source.key is None:
            matte = np.asarray(self._log.read(self._mattes, number), np.float32)
        elif self.source.key is None and not self._finds_mattes:
            matte = np.asarray(self._log.read(self.plates, number))[..., 3]
        else:
            return None
        return reference.Look.at_matte(number, matte)

    def person_hash(self, around: Iterable[int], as_read: bool = False) -> str:
        """Return a hash of the pictures of a person.

        `around`: the frames that contribute. `as_read`: whether to hash files as they were read, if they
        were, or as they are now.
        """
        pairs = self._pairs(around)
        return content_hash(self.options_hash, [self._log.content_hash(*pair, as_read) for pair in pairs])

    def records(self, around: Iterable[int]) -> list[FileRecord]:
        """Return the records, made when they were read, of the files of persons, including networks."""
        paths = [reader.file(n) for reader, n in self._pairs(around)]
        options = self.matting_options
        mattes = (options.model, options.options.get("silhouette")) if options is not None else ()
        for network in (*mattes, self.source.normals, self.source.depth):
            if is_path(network) and Path(network).suffix.lower() in NETWORK_SUFFIXES:
                paths += [Path(network)] if Path(network).is_file() else []
        return [self._log.record(path) for path in sorted({p for p in paths if p})]

    def _pairs(self, around: Iterable[int]) -> list[tuple[Reader, int]]:
        """Return the (reader, frame number) pairs from which the persons of frames are made."""
        wanted = list(around)
        pairs = [(reader, n) for n in wanted for reader in self.readers]
        if self._matting is not None and self._finds_mattes:
            pairs += [(self.plates, m) for n in wanted for m in self._matting.frames_read(n)]
        return pairs

    def read(self, number: int) -> FrameInputs:
        """Return the inputs of a frame's analysis; for a still, the same for any number.

        Raises as reading, `relight.key` and `relight.place` do; raises ValueError for a photograph without a
        matte.
        """
        plate, matte = self._log.read(self.plates, number), self._log.read(self._mattes, number)
        matte = self._squared_as_plate(matte, plate, number)
        self._check_size(matte, plate, number)
        if not self.is_still:
            self._keep_scene(number, plate)
        if self._matting is not None and not self._must_matte:
            self._opaque[number] = refine.is_opaque(plate)
        if self._matting is not None and (self._must_matte or self._opaque[number]):
            plate, matte = self._matting.matte(number, matte)
        elif self.source.key is not None:
            plate, matte = chroma_key.key(plate, self.source.key, mask=matte), None
        elif matte is None and np.shape(plate)[2:] == (3,):
            raise ValueError(
                "mask: the image has no alpha channel, so give the person's matte (mask=FILE), "
                "have it made (matte=auto, or a model), or key the person from a screen (key=green)"
            )
        behind = None
        if self.placement.size == BACKGROUND:  # a still lies in all frames as in the background's first
            first = (self._backgrounds.numbers or [number])[0]
            behind = self._log.read(self._backgrounds, first if self.is_still else number)
        size = self.placement.size_of(np.shape(plate)[:2], behind)
        normals, depth = self._log.read(self._normals, number), self._log.read(self._depths, number)
        normals = self._squared_as_plate(normals, plate, number)
        depth = self._squared_as_plate(depth, plate, number)
        if size is not None and isinstance(depth, np.ndarray) and depth.ndim == 2:
            depth = self._placed_depth(depth, size, _shows_person(plate, matte))
        if size is not None and isinstance(normals, np.ndarray):
            normals = self.placement(normals, size)
        matte = None if matte is None else self.placement(matte, size)
        placed = FrameInputs(self.placement(plate, size), matte, normals, depth)
        return _halved(placed) if self.is_preview else placed

    def is_cut(self, before: int, after: int) -> bool:
        """Return whether a cut is between two frames that were read, and follow each other."""
        scenes = self._scenes.get(before), self._scenes.get(after)
        return scenes[0] is not None and scenes[1] is not None and scene_cuts.is_cut(scenes[0], scenes[1])

    def _keep_scene(self, number: int, plate: np.ndarray) -> None:
        """Keep a small copy of a plate; of those before it, only what a window of frames needs."""
        opaque = np.asarray(plate)[..., :3]
        small = opaque[:: max(1, opaque.shape[0] // SCENE_ROWS), :: max(1, opaque.shape[1] // SCENE_ROWS)]
        self._scenes[number] = scene_cuts.reduced(refine.encoded_srgb(small))
        while len(self._scenes) > 4 * MAX_TEMPORAL_RADIUS:
            del self._scenes[next(iter(self._scenes))]

    def _check_size(self, matte: np.ndarray, plate: np.ndarray, number: int) -> None:
        """Raise ValueError for a matte (h, w) of another size than its plate."""
        if np.ndim(matte) != 2 or np.shape(matte) == np.shape(plate)[:2]:
            return
        file = self._mattes.file(number)
        found, expected = (f"{np.shape(image)[1]} x {np.shape(image)[0]}" for image in (matte, plate))
        raise ValueError(
            f"mask: {'' if file is None else f'{file}: '}expected {expected} pixels, the size of the plate, "
            f"got {found}"
        )

    def _squared_as_plate(self, values: object, plate: np.ndarray, number: int) -> Held:
        """Resample a matte, normals or depth like its plate with non-square pixels.

        It is resampled as the plate was, if it then has the plate's size.
        """
        path = self.plates.file(number)
        if not isinstance(values, np.ndarray) or values.shape[:2] == plate.shape[:2] or path is None:
            return values
        aspect = getattr(self.plates, "pixel_aspect", None) or images.read_pixel_aspect(path)
        squared = square_pixels(values, aspect, nearest=True)
        return squared if squared.shape[:2] == plate.shape[:2] else values

    def _placed_depth(self, depth: np.ndarray, size: tuple[int, ...], person: np.ndarray) -> np.ndarray:
        """Place a depth (h, w) in a picture of `size`.

        The depth behind the person, whatever it is, is not mixed with theirs. NaN where theirs is unknown.
        """
        known = np.isfinite(depth) & (np.abs(depth) <= MAX_DEPTH)
        person = person if person.shape == depth.shape else np.ones_like(known)  # which is refused later
        if not (known & person).any():
            return np.full(size, np.nan, np.float32)
        nearest = distance_transform_edt(~(known & person), return_distances=False, return_indices=True)
        missing = ~known & person
        layers = np.stack([depth[tuple(nearest)], missing, missing], axis=-1).astype(np.float32)
        placed = self.placement(layers, size)
        return np.where(placed[..., 1] > 0.5, np.nan, placed[..., 0])


def _halved(frame: FrameInputs) -> FrameInputs:
    """Return the inputs of a preview's frame."""
    plate, matte, normals, depth = frame
    normals, depth = preview.halved(normals, nearest=True), preview.halved(depth, nearest=True)
    size = np.shape(plate)[0] // 2, np.shape(plate)[1] // 2  # of odd sizes, pixels are left out
    normals, depth = (e[: size[0], : size[1]] if isinstance(e, np.ndarray) else e for e in (normals, depth))
    return FrameInputs(preview.halved(plate), preview.halved(matte), normals, depth)


def _shows_person(plate: np.ndarray, matte: np.ndarray | None) -> np.ndarray:
    """Return where the matte, or else the plate's alpha, shows the person: (H, W) bool."""
    alpha = as_array("mask", plate[..., 3] if matte is None else matte)
    most = np.iinfo(alpha.dtype).max if np.issubdtype(alpha.dtype, np.integer) else 1
    return alpha > MIN_COVERAGE * most
