"""Where pictures go: files, sequences, movies and Nuke scripts. All that can be refused is refused first."""

import contextlib
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from fractions import Fraction
from pathlib import Path

import numpy as np

from relight.lights.environment import Panorama
from relight.lights.files import SUFFIXES
from relight.lights.moving import MovingLight
from relight.media import images, movies, nuke
from relight.media.colour import encode
from relight.media.identity import NAME, identity
from relight.media.sequences import TOKEN, Frames, Sequence
from relight.rendering import Layers
from shadow import files

Report = Callable[[int, int, str], None]  # frames done, frames in all, what is done
PARTS = ALL, FRAMES, END = "all", "frames", "end"  # of a run: a chunk's frames, or what ends a shot in chunks
Made = Mapping[int, str]  # {frame number: the identity of what it is made of}, see relight.media.identity


def check(
    outputs: Iterable[Path],
    sources: Iterable[object],
    *,
    mattes: Path | None = None,
    lights: Path | None = None,
    maps: Path | None = None,
) -> None:
    """Refuse what could not be written, or would overwrite what is read or written as well.

    Parameters
    ----------
    outputs: pictures, sequences, movies and scripts.
    sources: what is read. Paths count, and the maps of environments; arrays do not.
    mattes: where the matte goes, a file or a sequence.
    lights: the lights file to write. maps: the map that goes with it.

    Raises
    ------
    ValueError, OSError that names the path.
    """
    outputs = list(outputs)
    for path in outputs:
        if movies.is_movie(path):
            movies.check_writable(path)
        elif path.suffix.lower() != ".nk":
            images.check_writable(path)
        elif not any(other.suffix.lower() == ".exr" for other in outputs):
            raise ValueError(f"{path}: a Nuke script needs an .exr to read; add one with -o")
    if mattes is not None:
        images.check_writable(mattes)
    if lights is not None:
        files.check_writable(lights, SUFFIXES)
    read = [found for source in sources if (found := _path(source)) is not None]
    written: list[Path] = []
    further = [path for path in (mattes, lights, maps) if path is not None]
    for path in (*outputs, *further):
        places = [path, Path(str(held_frames(path)))] if movies.is_movie(path) else [path]
        if any(_same(place, source) for place in places for source in read):
            raise ValueError(f"{path}: is read as well, and would be overwritten")
        if any(_same(place, other) for place in places for other in written):
            raise ValueError(f"{path}: is written twice")
        written += places


def held_frames(movie: Path) -> Sequence:
    """The half-float files that a movie's frames are kept in until the movie is whole."""
    return Sequence(movie.with_name(f"{movie.name}.frames"), "", 6, ".exr")


def _path(source: object) -> Path | None:
    """The file or the sequence that a source is read from; None of what is in memory."""
    if isinstance(source, MovingLight):
        source = source.rests
    image = source.get("image") if isinstance(source, dict) else getattr(source, "image", source)
    image = image.path if isinstance(image, Panorama) else image
    return Path(image) if isinstance(image, str | os.PathLike) else None


def _same(first: Path, second: Path) -> bool:
    """Whether two paths, of files or sequences, mean a file in common. Symbolic links count as what they
    point to, since they are written through."""
    if not _files(first).isdisjoint(_files(second)):
        return True
    first, second = (path.parent.resolve() / path.name for path in (first, second))
    if first.parent != second.parent:
        return False
    return any(_pattern(one).fullmatch(_example(other)) for one, other in ((first, second), (second, first)))


def _files(path: Path) -> set[Path]:
    """A path's file, or the files that there are of its sequence, without links."""
    sequence = Sequence.of(path)
    if sequence is None:
        return {path.resolve()}
    return {sequence.path(number).resolve() for number in sequence.numbers()}


def _pattern(path: Path) -> re.Pattern:
    """What the names of a path's files match: a frame number is any digits."""
    parts = [re.escape(part) for part in TOKEN.sub("\0", path.name).split("\0")]
    return re.compile(r"\d+".join(parts))


def _example(path: Path) -> str:
    """The name of a path's file, or of the first of a sequence."""
    return TOKEN.sub("1", path.name)


def check_display(display: dict) -> None:
    """ValueError for a view, exposure or white that `relight.write` would refuse."""
    encode(np.zeros((1, 1, 3), np.float32), **display)


def open_outputs(
    outputs: Iterable[Path],
    *,
    transparent: bool,
    resume: bool,
    part: str,
    display: dict,
    exr: dict,
    rate: float | Fraction,
    names: list[str],
) -> list["FileSink | MovieSink | ScriptSink"]:
    """Where the frames of outputs go, scripts last. `names` are the layers that a script mixes; `display`
    what `relight.write` and `write_movie` take; `exr` what the former takes for .exr. Raises ValueError for
    what holds no frames or no alpha."""
    outputs = list(outputs)
    check_display(display)
    scripts = [path for path in outputs if path.suffix.lower() == ".nk"]
    sinks: list[FileSink | MovieSink] = []
    for path in (path for path in outputs if path not in scripts):
        sequence = Sequence.of(path)
        if movies.is_movie(path):
            if transparent and path.suffix.lower() == ".mp4":
                raise ValueError(f"{path}: .mp4 holds no alpha; give a background, or write a .mov")
            sinks.append(MovieSink(path, resume or part != ALL, display, rate))
        elif sequence is None:
            expected = "a movie, or a frame number in the name, such as relit.%04d.exr"
            raise ValueError(f"{path}: expected {expected}")
        else:
            sinks.append(FileSink(sequence, resume or part == END, display, exr))
    return sinks + [ScriptSink(path, sinks, names, rate) for path in scripts]


class FileSink:
    """A file a frame."""

    def __init__(self, sequence: Sequence, resume: bool, display: dict, exr: dict) -> None:
        self.sequence, self.resume, self.display, self.exr = sequence, resume, display, exr
        self.path = sequence

    def begin(self, made: Made) -> None:
        """A file stays until the one that replaces it is whole."""

    def has(self, number: int, made: str) -> bool:
        """Whether the frame is there, and made of just that."""
        return self.resume and images.read_identity(self.sequence.path(number)) == self._identity(made)

    def holds_another(self, number: int, made: str) -> bool:
        """Whether the frame is there, but made of something else."""
        return self.there(number) and not self.has(number, made)

    def there(self, number: int) -> bool:
        """Whether there is any such frame."""
        return self.sequence.path(number).exists()

    def write(
        self, number: int, picture: np.ndarray, layers: Layers, made: str, metadata: images.Metadata
    ) -> None:
        carried = {NAME: self._identity(made), **metadata}
        write_picture(self.sequence.path(number), picture, layers, self.display, self.exr, carried)

    def finish(self, numbers: Frames, made: Made, problems: dict, report: Report) -> None:
        """Nothing is left to do."""

    def _identity(self, made: str) -> str:
        if self.sequence.after.lower().endswith(".exr"):
            return identity(made, self.exr["depth"])  # cropped or not it is the same picture
        return identity(made, self.display)


class ScriptSink:
    """A Nuke script, once the frames that it reads are there."""

    def __init__(self, path: Path, sinks: list, names: list[str], rate: float | Fraction) -> None:
        found = [sink.sequence for sink in sinks if getattr(sink, "sequence", None)]
        found = [sequence for sequence in found if sequence.after.lower().endswith(".exr")]
        if not found:
            raise ValueError(f"{path}: a Nuke script needs a sequence of .exr files to read")
        self.path, self.frames, self.rate = path, found[0], rate
        self.groups = {name: (str(self.frames), f"C_{name}") for name in names}
        nuke.check_layers(layer for _, layer in self.groups.values())

    def begin(self, made: Made) -> None:
        """The script stays until the one that replaces it is whole."""

    def has(self, number: int, made: str) -> bool:
        return True

    def holds_another(self, number: int, made: str) -> bool:
        return False

    def finish(self, numbers: Frames, made: Made, problems: dict, report: Report) -> None:
        first = next(path for path in map(self.frames.path, numbers) if path.exists())
        size = images.read(first).shape[:2]
        nuke.write_script(self.path, self.groups, size, frames=(numbers[0], numbers[-1]), rate=self.rate)


class MovieSink:
    """A movie, and until it is whole its frames as half-float files in a folder beside it."""

    def __init__(self, path: Path, resume: bool, display: dict, rate: float | Fraction) -> None:
        self.path, self.resume, self.display, self.rate = path, resume, display, rate
        self.frames = held_frames(path)
        self.whole = False

    def begin(self, made: Made) -> None:
        """Drop the frames of an interrupted run, unless this one goes on from them."""
        if not self.resume:
            self._clear()
        held = self.frames.folder.exists()
        self.whole = self.resume and not held and movies.read_comment(self.path) == self._identity(made)

    def has(self, number: int, made: str) -> bool:
        return self.whole or images.read_identity(self.frames.path(number)) == identity(made)

    def holds_another(self, number: int, made: str) -> bool:
        return self.there(number) and not self.has(number, made)

    def there(self, number: int) -> bool:
        """Whether there is any such frame."""
        held = self.frames.path(number).exists()
        return held or (self.path.exists() and not self.frames.folder.exists())

    def write(
        self, number: int, picture: np.ndarray, layers: Layers, made: str, metadata: images.Metadata
    ) -> None:
        self.frames.folder.mkdir(exist_ok=True)
        shown = picture.clip(-images.HALF_MAX, images.HALF_MAX)
        images.write(self.frames.path(number), shown, autocrop=True, metadata={NAME: identity(made)})

    def finish(self, numbers: Frames, made: Made, problems: dict, report: Report) -> None:
        if not self.whole:
            others = [n for n in numbers if n not in problems and not self.has(n, made[n])]
            if others:
                raise ValueError(
                    f"{self.path}: frame {others[0]} is not there as this run made it; "
                    "does another run write the same movie?"
                )
            held, comment = self._held(numbers, report), None if problems else self._identity(made)
            movies.write_movie(self.path, held, rate=self.rate, comment=comment, **self.display)
            if not problems:
                self._clear()

    def _identity(self, made: Made) -> str:
        return identity(sorted(made.items()), self.display, self.rate)

    def _held(self, numbers: Frames, report: Report) -> Iterator[np.ndarray]:
        """All frames; one that is missing is the frame before it, or the first there is."""
        shown, size = next(number for number in numbers if self.frames.path(number).exists()), None
        for done, number in enumerate(numbers, 1):
            shown = number if self.frames.path(number).exists() else shown
            picture = images.read(self.frames.path(shown))
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
        with contextlib.suppress(OSError):  # there is none, or it holds what is not ours
            self.frames.folder.rmdir()


def write_picture(
    path: Path,
    picture: np.ndarray,
    layers: Layers,
    display: dict,
    exr: dict,
    metadata: images.Metadata | None = None,
) -> None:
    """A picture in a file; an .exr holds its layers too."""
    if path.suffix.lower() == ".exr":
        images.write(path, picture, layers=layers, metadata=metadata, **exr)
    else:
        images.write(path, picture, metadata=metadata, **display)
