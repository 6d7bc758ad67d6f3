"""Where the frames of a shot go: pictures, movies, scripts, mattes, a report; each complete or not there."""

import contextlib
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

import numpy as np

from relight.media import images, movies
from relight.media.colour import Display
from relight.media.content_hash import HASH_ATTRIBUTE, content_hash
from relight.media.pixel_aspect import squeeze_pixels
from relight.media.resampling import resize, size_within
from relight.media.sequences import FrameRange, FrameSequence
from relight.pipeline.delivery import Delivery
from relight.pipeline.option_fields import Phase, Report
from relight.pipeline.options import Output
from relight.pipeline.outputs import held_frames, is_exr
from relight.pipeline.persons import FramePerson
from relight.pipeline.rendered_frame import RenderedFrame
from relight.pipeline.shot_report import ShotReport
from relight.scene import nuke
from relight.scene.nuke.relight_node import LiveLight

Made = Mapping[int, str]  # {frame number: content hash of what the frame is made from}


@dataclass(frozen=True)
class Sinks:
    """The outputs of a shot."""

    frames: list["FileSink | MovieSink"]  # all that take pictures, movies among them
    movies: list["MovieSink"]  # complete only when all frames are there, as scripts are
    scripts: list["ScriptSink"]
    mattes: "MatteSink | None"
    report: ShotReport | None
    resume: bool  # whether frames that are right are kept

    @property
    def of_persons(self) -> list["MatteSink | ShotReport"]:
        """What takes persons, without their light."""
        return [each for each in (self.mattes, self.report) if each is not None]

    def begin(self, made: Made) -> None:
        """Prepare for these frames. Files are kept until those that replace them are complete.

        A run that resumes warns of files that were made from something else.
        """
        for movie in self.movies:
            movie.begin(made)
        if not self.resume:
            return
        others = sum(any(s.exists(n) and not s.has(n, each) for s in self.frames) for n, each in made.items())
        if others:
            warnings.warn(
                f"resume: {others} of {len(made)} frames were made with other lights, sources, options, "
                "weights or by another version, and are made again",
                stacklevel=5,
            )

    def assemble(self, numbers: FrameRange, made: Made, problems: dict, report: Report) -> None:
        """Write movies and scripts, since all frames are there."""
        for movie in self.movies:
            movie.encode(numbers, made, problems, report)
        for script in self.scripts:
            script.write(numbers)
        if self.report is not None:
            self.report.write_only(numbers, problems)


@dataclass(frozen=True)
class SingleFile:
    """The one file of a still, as a `FrameSequence` of one."""

    file: Path

    def path(self, number: int) -> Path:
        return self.file

    def __str__(self) -> str:
        return str(self.file)


class ExrForm(TypedDict, total=False):
    """How an OpenEXR file is written, as `images.write` takes it."""

    depth: str
    autocrop: bool
    colour_space: str | None


def file_of(path: Path) -> FrameSequence | SingleFile:
    """Return the sequence, or the single file, that a path names."""
    return FrameSequence.of(path) or SingleFile(path)


def open_sinks(
    output: Output,
    display: Display,
    *,
    moving: bool,
    resume: bool,
    phase: Phase,
    delivery: Delivery,
    groups: list[str],
) -> Sinks:
    """Open the outputs of a shot.

    `display`: how light becomes what displays show. `moving`: whether the shot has frames, see
    `relight.pipeline.outputs`. `resume`: whether frames that are right are kept. `delivery`: what the outputs
    keep of the source. `groups`: the light groups that a script mixes. Raises ValueError for layers that a
    script cannot tell apart.
    """
    exr: ExrForm = {
        "depth": output.exr_type,
        "autocrop": output.autocrop,
        "colour_space": output.output_colour_space,
    }
    kept = resume or phase == "finalize"
    frames: list[FileSink | MovieSink] = []
    movie_sinks: list[MovieSink] = []
    for path in output.paths:
        if nuke.is_script(path):
            continue
        if movies.is_movie(path):
            movie_sinks.append(MovieSink(path, resume or phase != "all", display, delivery))
            frames.append(movie_sinks[-1])
        else:
            frames.append(
                FileSink(file_of(path), kept, display, exr, delivery, output.quality, output.longest_side)
            )
    exrs = [path for path in output.paths if is_exr(path)]
    scripts = []
    for path in (path for path in output.paths if nuke.is_script(path)):
        read = {name: (file_of(exrs[0]), f"C_{name}") for name in groups}
        live = {"albedo", "N", "P"} <= set(output.passes)
        scripts.append(ScriptSink(path, read, moving, delivery, live=live))
    mattes = None
    if output.save_matte is not None and phase != "finalize":
        mattes = MatteSink(file_of(output.save_matte), resume, delivery.pixel_aspect)
    report = None if output.report is None else ShotReport(output.report, resume)
    return Sinks(frames, movie_sinks, scripts, mattes, report, resume)


@dataclass
class FileSink:
    """A file a frame."""

    path: FrameSequence | SingleFile
    resume: bool
    display: Display
    exr: ExrForm
    delivery: Delivery
    quality: int | None = None
    longest_side: int | None = None  # pixels, of display formats

    def has(self, number: int, made: str) -> bool:
        """Return whether the frame exists, and was made from exactly these inputs."""
        path = self.path.path(number)
        return self.resume and images.read_content_hash(path) == self._hash(path, made)

    def exists(self, number: int) -> bool:
        """Return whether the frame exists, from whatever inputs."""
        return self.path.path(number).exists()

    def write(self, number: int, frame: RenderedFrame, made: str, metadata: images.Metadata) -> None:
        path = self.path.path(number)
        metadata = {HASH_ATTRIBUTE: self._hash(path, made), **metadata}
        if is_exr(path):
            self.delivery.warn_of_timecode(path, metadata)
            picture, layers, metadata = self.delivery.squeeze_layers(
                *frame.layered(self.exr["depth"]), metadata, self.exr["depth"]
            )
            images.write(path, picture, layers=layers, metadata=metadata, **self.exr)
        else:
            picture, background = frame.shown()
            images.write(
                path,
                self._reduced(path, picture),
                background=None if background is None else self._reduced(path, background),
                metadata=metadata,
                quality=self.quality,
                **self.display,
            )

    def _reduced(self, path: Path, picture: np.ndarray) -> np.ndarray:
        """Return a picture (H, W, C) in the size in which a display format has it."""
        if self.longest_side is None or path.suffix.lower() == ".hdr":
            return picture
        return resize(picture, size_within(picture.shape, self.longest_side), "triangle")

    def _hash(self, path: Path, made: str) -> str:
        if is_exr(path):
            space = [self.exr["colour_space"]] if self.exr.get("colour_space") else []
            return content_hash(made, self.exr["depth"], *space)  # cropped or not, it is the same picture
        form = {"quality": self.quality, "longest side": self.longest_side}
        return content_hash(made, self.display, *([form] if any(form.values()) else []))


@dataclass
class MatteSink:
    """The person's matte, a file a frame; an .exr has pixels of the plate's shape."""

    path: FrameSequence | SingleFile
    resume: bool
    pixel_aspect: float

    def has(self, number: int, made: str) -> bool:
        return self.resume and images.read_content_hash(self.path.path(number)) == made

    def write(self, number: int, person: FramePerson, made: str) -> None:
        path, matte = self.path.path(number), person.subject.matte
        metadata: images.Metadata = {HASH_ATTRIBUTE: made}
        if is_exr(path) and self.pixel_aspect != 1:
            matte = squeeze_pixels(matte, self.pixel_aspect).clip(0, 1)
            metadata = {**metadata, "PixelAspectRatio": self.pixel_aspect}
        images.write_mask(path, matte, metadata=metadata)


@dataclass
class ScriptSink:
    """A Nuke script, written once the frames that it reads are there."""

    path: Path
    # {light: (its file or sequence, the layer in it)}; all frames have all groups
    groups: Mapping[str, tuple[FrameSequence | SingleFile, str | None]]
    moving: bool
    delivery: Delivery
    live: bool = False  # whether the files have the passes that Nuke's own light needs

    def __post_init__(self) -> None:
        nuke.check_layers(layer for _, layer in self.groups.values() if layer is not None)

    def write(self, numbers: FrameRange) -> None:
        """Write the script of these frames, some of which may be missing."""
        files = [file.path(number) for number in numbers for file, _ in self.groups.values()]
        files = [path for path in files if path.exists()]
        size = images.read_size(files[0])
        cameras = (images.read_camera(path) for path in files) if self.live else iter(())
        live = next((LiveLight(*camera) for camera in cameras if camera is not None), None)
        frames = (numbers[0], numbers[-1]) if self.moving else None
        groups = {name: (str(file), layer) for name, (file, layer) in self.groups.items()}
        nuke.write_script(
            self.path, groups, size, frames=frames, rate=self.delivery.rate,
            pixel_aspect=self.delivery.pixel_aspect, live=live,
        )  # fmt: skip


class MovieSink:
    """A movie, which takes frames as `FileSink` does.

    Until it is complete, the code values of its frames are files in a folder beside it.
    """

    def __init__(self, path: Path, resume: bool, display: Display, delivery: Delivery) -> None:
        self.path, self.resume, self.display, self.delivery = path, resume, display, delivery
        self.frames = held_frames(path)
        self.complete = False

    def begin(self, made: Made) -> None:
        """Drop the frames of an interrupted run, unless this run continues it and the movie is incomplete."""
        self.complete = self.resume and movies.read_comment(self.path) == self._hash(made)
        if self.complete or not self.resume:
            self._clear()

    def has(self, number: int, made: str) -> bool:
        held = self.frames.path(number)
        return self.complete or images.read_content_hash(held) == self._frame_hash(made)

    def exists(self, number: int) -> bool:
        has_frame = self.frames.path(number).exists()
        return has_frame or (self.path.exists() and not self.frames.folder.exists())

    def write(self, number: int, frame: RenderedFrame, made: str, metadata: images.Metadata) -> None:
        self.frames.folder.mkdir(exist_ok=True)
        picture, background = frame.shown()
        picture = squeeze_pixels(picture, self.delivery.pixel_aspect)
        if background is not None:
            background = squeeze_pixels(background, self.delivery.pixel_aspect)
        codes = movies.frame_codes(self.path, picture, background, **self.display, form=self.delivery.form)
        images.write_codes(self.frames.path(number), codes, {HASH_ATTRIBUTE: self._frame_hash(made)})

    def encode(self, numbers: FrameRange, made: Made, problems: dict, report: Report) -> None:
        """Write the movie from the files of its frames."""
        if self.complete:
            return
        others = [n for n in numbers if n not in problems and not self.has(n, made[n])]
        if others:
            raise ValueError(
                f"{self.path}: frame {others[0]} is not there as this run made it; "
                "does another run write the same movie?"
            )
        pictures, comment = self._held(numbers, report), None if problems else self._hash(made)
        movies.write_codes(
            self.path, pictures, rate=self.delivery.rate, comment=comment,
            pixel_aspect=self.delivery.pixel_aspect, tracks=self.delivery.tracks(numbers, self.path),
            form=self.delivery.form,
        )  # fmt: skip
        if not problems:
            self._clear()

    def _frame_hash(self, made: str) -> str:
        hdr = [] if self.delivery.form.hdr is None else [self.delivery.form.hdr]
        return content_hash(made, self.display, self.path.suffix.lower(), *hdr)

    def _hash(self, made: Made) -> str:
        form = self.delivery.form
        given = [form] if form != movies.BY_SUFFIX else []
        return content_hash(sorted(made.items()), self.display, self.delivery.rate, *given)

    def _held(self, numbers: FrameRange, report: Report) -> Iterator[np.ndarray]:
        """Yield all frames; a missing one is replaced by the previous one, or by the first that exists."""
        shown, size = next(number for number in numbers if self.frames.path(number).exists()), None
        for done, number in enumerate(numbers, 1):
            shown = number if self.frames.path(number).exists() else shown
            picture = images.read_codes(self.frames.path(shown))
            size = size or picture.shape[:2]
            if picture.shape[:2] != size:
                raise ValueError(
                    f"{self.path}: frame {shown} has another size than the first, "
                    f"{picture.shape[:2]} instead of {size}"
                )
            yield picture
            report(done, len(numbers), f"Encoding {self.path.name}")

    def _clear(self) -> None:
        for number in self.frames.numbers():
            self.frames.path(number).unlink()
        with contextlib.suppress(OSError):  # there is no such folder, or it holds other files
            self.frames.folder.rmdir()
