"""Checks of a shot's outputs. Everything that can be refused is refused before the networks run."""

import re
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from relight.lights.environment import Panorama
from relight.lights.moving import FILES, MovingLight
from relight.media import images, movies
from relight.media.colour import Display, encode, linear_space
from relight.media.photometry import PhotometricProfile
from relight.media.sequences import TOKEN, FrameSequence
from relight.pipeline.options import Output
from relight.scene import nuke
from relight.scene.lights import SUFFIXES
from shadow import files

FRAME_NUMBER = "a movie, or a frame number in the name, such as relit.%04d.exr"


def check_outputs(output: Output, sources: Iterable[object], sidecar: Path | None = None) -> None:
    """Refuse what could not be written, or would overwrite what is read or written as well.

    Of the sources, which are read, paths count, and the images of environments; arrays do not. `sidecar`: the
    image that is written beside the lights file. Raises ValueError or OSError, which names the path.
    """
    if not output.paths:
        raise ValueError("output: expected at least one file to write (-o FILE)")
    for path in output.paths:
        if movies.is_movie(path):
            files.check_writable(path, movies.WRITTEN)
            form_of(output).codec_of(path)
        elif not nuke.is_script(path):
            images.check_writable(path)
        elif not any(is_exr(other) for other in output.paths):
            raise ValueError(f"{path}: a Nuke script needs an .exr to read; add one with -o")
    if output.passes:
        from relight.rendering import check_names  # it imports torch, and a command's first checks do not

        check_names(output.passes, output.paths)
    if output.rate is not None:
        movies.frame_rate(output.rate)
    if output.save_matte is not None:
        images.check_matte(output.save_matte)
    if output.save_lights is not None:
        files.check_writable(output.save_lights, SUFFIXES)
    if output.report is not None:
        files.check_writable(output.report, (".json",))
    if output.plot is not None:
        files.check_writable(output.plot, (".svg",))
    sources = list(sources)
    written: list[Path] = []
    further = [
        path
        for path in (output.save_matte, output.save_lights, output.report, output.plot, sidecar)
        if path is not None
    ]
    for path in (*output.paths, *further):
        check_not_read([path], sources)
        if any(_same(place, other) for place in _places(path) for other in written):
            raise ValueError(f"{path}: is written twice")
        written += _places(path)


def form_of(output: Output) -> movies.Form:
    """Return the form of the movies."""
    return movies.Form(output.codec, output.hdr)


def check_form(output: Output, size: Callable[[], Sequence[int]], source: object) -> None:
    """Check the form of the movies, and what becomes of HLG, PQ and the metadata of HDR10.

    `size`: returns the size (H, W) of the pictures; it is called for movies alone, since it reads a picture.
    `source`: the reader of the plates. Raises ValueError for a form that cannot be. Warns of light that is
    converted to BT.709, and of metadata that describes the old light.
    """
    shown = [path for path in output.paths if movies.is_movie(path)]
    for path in shown:
        form_of(output).check_size(path, size())
    if (output.codec or output.hdr) and not shown:
        option = "codec" if output.codec else "hdr"
        raise ValueError(f"{option}: is that of movies; expected one, .mp4 or .mov, among the outputs")
    if output.hdr is not None and (output.view is not None or output.white is not None):
        option = "view" if output.view is not None else "white"
        raise ValueError(f"{option}: expected none with hdr, whose light is not compressed")
    if not isinstance(source, movies.Movie):
        return
    if output.hdr is not None and source.has_mastering_metadata():
        warnings.warn(
            f"{source.path}: its HDR10 metadata (mastering display, light levels) is not passed on, as it is "
            "that of the old light; have it measured again where the movie is mastered",
            stacklevel=2,
        )
    if output.hdr is not None or not shows_backgrounds(output):
        return
    if (name := source.hdr_name()) is not None:
        warnings.warn(
            f"{source.path}: {name} is converted to BT.709, unless it is kept in movies "
            f"(hdr={name.lower()}); an .exr keeps all light",
            stacklevel=2,
        )


def shows_backgrounds(output: Output) -> bool:
    """Return whether any output shows the photograph behind a person cut out of it: all but .exr and .nk."""
    return any(not nuke.is_script(path) and not is_exr(path) for path in output.paths)


def check_alpha(output: Output, *, transparent: bool) -> None:
    """Raise ValueError for an output that cannot hold alpha, if the pictures are transparent."""
    form = form_of(output)
    for path in output.paths:
        movie = movies.is_movie(path)
        opaque = not form.holds_alpha(path) if movie else path.suffix.lower() in images.OPAQUE_SUFFIXES
        if transparent and opaque:
            instead = ", or write a .mov" if path.suffix.lower() == ".mp4" else ""
            kind = path.suffix if output.codec is None or not movie else output.codec
            raise ValueError(f"{path}: {kind} holds no alpha; give a background (background=FILE){instead}")


def check_display(output: Output, *, moving: bool) -> Display:
    """Return how light becomes what displays show, as `images.write` takes it; ValueError out of range."""
    # All frames of a sequence share one white, so that they do not pump.
    white = movies.WHITE if output.white is None and moving else output.white
    display: Display = {"view": output.view, "exposure": output.exposure, "white": white}
    encode(np.zeros((1, 1, 3), np.float32), **display)
    if output.output_colour_space is not None:
        linear_space(output.output_colour_space)
        if not any(is_exr(path) for path in output.paths):
            raise ValueError("--output-colour-space: is that of .exr files; expected one among the outputs")
    return display


def check_not_read(paths: Iterable[Path], sources: Iterable[object]) -> None:
    """Refuse to write what is read: ValueError that names the path. `sources` as for `check_outputs`."""
    read = [source_path for source in sources if (source_path := _path(source)) is not None]
    for path in paths:
        if any(_same(place, source) for place in _places(path) for source in read):
            raise ValueError(f"{path}: is read as well, and would be overwritten")


def _places(path: Path) -> list[Path]:
    """Return where an output is written: itself, and a movie's frames until it is complete."""
    return [path, Path(str(held_frames(path)))] if movies.is_movie(path) else [path]


def has_frames(output: Output) -> bool:
    """Return whether the outputs are sequences and movies, not single files.

    Raises ValueError for a mixture.
    """
    pictures = [path for path in output.paths if not nuke.is_script(path)]
    moving = [movies.is_movie(path) or FrameSequence.of(path) is not None for path in pictures]
    if any(moving) and not all(moving):
        raise ValueError(f"{pictures[moving.index(False)]}: expected {FRAME_NUMBER}")
    matte = output.save_matte
    if matte is not None and (FrameSequence.of(matte) is not None) is not any(moving):
        expected = "a frame number in the name, such as matte.%04d.png" if any(moving) else "a single file"
        raise ValueError(f"{matte}: expected {expected}, as {pictures[0]} has it")
    return any(moving)


def is_exr(path: Path) -> bool:
    """Return whether a file name is that of an OpenEXR file, which can hold layers."""
    return path.suffix.lower() == ".exr"


def held_frames(movie: Path) -> FrameSequence:
    """Return the files of a movie's frames, code values, which exist until the movie is complete."""
    return FrameSequence(movie.with_name(f"{movie.name}.frames"), "", 6, images.CODES_SUFFIX)


def _path(source: object) -> Path | None:
    """Return the file or sequence of a source; None for a source in memory."""
    if isinstance(source, MovingLight):
        source = source.rests
    if not isinstance(source, dict):
        held = [getattr(source, key, None) for key in FILES]
        image = next((each for each in held if each is not None), source)
    else:
        image = next((source[key] for key in FILES if source.get(key) is not None), None)
    image = image.path if isinstance(image, Panorama | PhotometricProfile) else image
    return images.split_layer(image)[0] if files.is_path(image) else None


def _same(first: Path, second: Path) -> bool:
    """Return whether two paths, of files or sequences, have a file in common.

    Symbolic links are followed, as in writing.
    """
    if not _files(first).isdisjoint(_files(second)):
        return True
    first, second = (path.parent.resolve() / path.name for path in (first, second))
    if first.parent != second.parent:
        return False
    # The name of the file, or of a sequence's first one.
    examples = ((first, TOKEN.sub("1", second.name)), (second, TOKEN.sub("1", first.name)))
    return any(_pattern(one).fullmatch(name) for one, name in examples)


def _files(path: Path) -> set[Path]:
    """Return the file of a path, or the existing files of its sequence, with links resolved."""
    sequence = FrameSequence.of(path)
    if sequence is None:
        return {path.resolve()}
    return {sequence.path(number).resolve() for number in sequence.numbers()}


def _pattern(path: Path) -> re.Pattern:
    """Return a pattern that matches the file names of a path; any digits match a frame number."""
    parts = [re.escape(part) for part in TOKEN.sub("\0", path.name).split("\0")]
    return re.compile(r"-?\d+".join(parts))
