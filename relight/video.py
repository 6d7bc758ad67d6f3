"""Relit sequences and movies: moving lights on a still, a still light on a moving person, or both."""

import contextlib
import math
from pathlib import Path

import numpy as np

from relight import rendering
from relight.keying import key as cut_out
from relight.lights.directional import by_name
from relight.lights.moving import MovingLight, lights_at
from relight.media import images, movies, nuke
from relight.media.sequences import Files, Sequence, Still
from relight.rendering import render_subject
from relight.steadying import AROUND
from relight.subject import Subject

RATE = 24  # frames a second, where nothing says otherwise


def render_video(
    source,
    lights,
    outputs,
    *,
    frames=None,
    mask=None,
    key=None,
    background=None,
    colour_space=None,
    passes=(),
    steady=True,
    rate=None,
    view=None,
    exposure=0.0,
    white=movies.WHITE,
    resume=False,
    progress=None,
):
    """Relight a person frame by frame.

    Parameters
    ----------
    source: the photograph, as an image or a file; or a sequence, such as `plate.%04d.exr` or
        `plate.####.exr`; or a movie, whose frames count from 1.
    lights: a light, or any number of them; a relight.MovingLight changes with the frame number.
    outputs: a path or several: sequences of files that `relight.write` writes; movies, .mp4 (which needs a
        background) or .mov; and with an .exr sequence, whose files have light groups and passes as
        `relight.rendering` describes them, a Nuke script, .nk.
    frames: (first, last). Unless given, those of the source; of a still, those of the mask or the background,
        or from the first keyframe of the lights to the last.
    mask: the person's matte, as a mask, or a file, sequence or movie of the same frame numbers; needed unless
        the source has alpha.
    key: "green" or "blue": cut the person out of a screen, see `relight.key`; the mask then says where
        there is one.
    background: as of `relight.apply`; or a file, sequence or movie; or an environment that moves.
    colour_space: of the source, where its files do not say; see `relight.read`.
    passes: further layers of an .exr, of relight.rendering.PASSES.
    steady: average what the networks find of a moving person over 5 frames, where it is alike.
    rate: frames a second of the movies. Unless given, the source's, or 24.
    view, exposure, white: how light becomes what a display shows, see `relight.media.colour.encode`.
        White is one for all frames, so that they do not pump.
    resume: keep the frames that are there. Otherwise all are made anew.
    progress: called with (frames done, frames in all, what is done) after every frame.

    Where nobody is in the frame, the picture is empty. Until a movie is whole, its frames are half-float
    files in a folder beside it, `relit.mp4.frames`: so an interruption loses none.

    Returns
    -------
    {frame number: what is wrong}: the frames that could not be made. The others are there; in a movie the
    frame before stands for them, and its folder of frames is kept, for `resume` when they are mended.

    Raises
    ------
    FileNotFoundError: no such file or frames. OSError: a frame cannot be written.
    TypeError, ValueError: bad arguments, outputs that need frame numbers or a background, no frames to make,
    or none that could be made.
    """
    plates = _opened(
        source, lambda path: images.read(path, colour_space=colour_space), movies.Movie, colour_space
    )
    mattes = _opened(mask, images.read_mask, _MatteMovie, "lin_rec709")
    backdrops = _opened(background, images.read, movies.Movie)
    lights = [lights] if hasattr(lights, "at") or hasattr(lights, "samples") else list(lights)
    numbers = _numbers(frames, (plates, mattes, backdrops), lights)
    names = [*by_name(lights_at(lights, numbers[0])), *([] if background is None else ["background"])]
    rendering.check(passes)
    outputs = [Path(path) for path in ([outputs] if isinstance(outputs, str | Path) else outputs)]
    display = {"view": view, "exposure": exposure, "white": white}
    scripts = [path for path in outputs if path.suffix.lower() == ".nk"]
    sinks = [
        _sink(path, source, background is None, resume, display) for path in outputs if path not in scripts
    ]
    sinks += [_ScriptSink(path, sinks, names) for path in scripts]
    people = _People(plates, mattes, key, steady)
    report = progress or (lambda done, total, what: None)

    problems = {}
    for done, number in enumerate(numbers, 1):
        wanted = [sink for sink in sinks if not sink.has(number)]
        if wanted:
            try:
                backdrop = backdrops.read(number)
                backdrop = backdrop.at(number) if isinstance(backdrop, MovingLight) else backdrop
                lit = lights_at(lights, number)
                picture, stack = render_subject(people.at(number), lit, background=backdrop, passes=passes)
            except (OSError, ValueError) as error:
                problems[number] = str(error)
            else:
                for sink in wanted:
                    sink.write(number, picture, stack)
        report(done, len(numbers), "Relighting")
    if len(problems) == len(numbers):
        first = f"frame {numbers[0]}: {problems[numbers[0]]}"
        raise ValueError(f"none of {len(numbers)} frames could be made; {first}")
    for sink in sinks:
        sink.finish(numbers, rate or plates.rate or RATE, problems, report)
    return problems


def _opened(value, read, read_movie, colour_space=None):
    """What has `read(number)` for the frames of an argument: a still, a sequence or a movie."""
    if not isinstance(value, str | Path):
        return Still(value)
    if movies.is_movie(value):
        return read_movie(value, colour_space=colour_space)
    sequence = Sequence.of(value)
    return Still(read(value)) if sequence is None else Files(sequence, read)


def _numbers(frames, sources, lights):
    """The numbers of the frames to make, in order."""
    spans = [light.span for light in lights if isinstance(light, MovingLight) and light.span]
    for source in sources:
        if frames is None and source.numbers:
            frames = source.numbers[0], source.numbers[-1]
    if frames is None and spans:
        frames = math.floor(min(first for first, _ in spans)), math.ceil(max(last for _, last in spans))
    if frames is None:
        raise ValueError("frames: expected (first, last), as neither source nor lights say how many")
    first, last = frames
    if not 0 <= first <= last:
        raise ValueError(f"frames: expected (first, last) with 0 <= first <= last, got {frames}")
    return range(first, last + 1)


class _MatteMovie(movies.Movie):
    """A movie as mattes: its alpha, or its grey as it is stored."""

    def read(self, number):
        pixels = super().read(number)
        return pixels[..., 3] if pixels.shape[-1] == 4 else pixels.mean(axis=-1)


class _People:
    """The person of each frame; of a moving one the last few frames are kept, to steady the next."""

    def __init__(self, plates, mattes, key, steady):
        self._plates, self._mattes, self._key = plates, mattes, key
        self._there = plates.numbers or mattes.numbers
        self._reach = AROUND if steady else 0
        self._analysed = {}

    def at(self, number):
        """A Subject, or the like of one; raises as reading and `Subject` do."""
        if self._there is None:  # a still: one for all frames
            number, around = 0, [0]
        else:
            around = range(number - self._reach, number + self._reach + 1)
        self._analysed = {n: found for n, found in self._analysed.items() if n in around}
        for n in around:
            if n not in self._analysed and (n == number or n in self._there):
                self._analysed[n] = self._analyse(n)
        subject = self._analysed[number]
        if isinstance(subject, Exception):
            raise subject
        others = [found for found in self._analysed.values() if isinstance(found, Subject)]
        if not isinstance(subject, Subject) or len(others) == 1:
            return subject
        return subject.steadied([other for other in others if other is not subject])

    def _analyse(self, number):
        """The Subject of a frame, nobody, or what is wrong with it."""
        try:
            plate, matte = self._plates.read(number), self._mattes.read(number)
            if self._key is not None:
                plate, matte = cut_out(plate, self._key, mask=matte), None
            coverage = plate[..., 3:] if matte is None else matte
            if self._there is not None and coverage.size and coverage.max() <= 0.5:
                return _Nobody(plate.shape[:2])
            return Subject(plate, matte)
        except (OSError, ValueError) as error:
            return error


class _Nobody:
    """The Subject of a frame in which nobody is."""

    def __init__(self, size):
        self._size = size
        self.albedo = self.normals = self.lighting(None)

    def relit(self, lights):
        return np.zeros((*self._size, 4), np.float32)

    def lighting(self, lights):
        return np.zeros((*self._size, 3), np.float32)

    def unshadowed(self, light):
        return np.zeros(self._size, np.float32)


def _sink(path, source, transparent, resume, display):
    """Where the frames of an output go."""
    if isinstance(source, str | Path) and path.resolve() == Path(source).resolve():
        raise ValueError(f"{path}: is the source, which would be overwritten")
    if movies.is_movie(path):
        movies.check_writable(path)
        if transparent and path.suffix.lower() == ".mp4":
            raise ValueError(f"{path}: .mp4 holds no alpha; give a background, or write a .mov")
        return _MovieSink(path, resume, display)
    images.check_writable(path)
    sequence = Sequence.of(path)
    if sequence is None:
        raise ValueError(f"{path}: expected a movie, or a frame number in the name, such as relit.%04d.exr")
    if isinstance(source, str | Path) and Sequence.of(source) == sequence:
        raise ValueError(f"{path}: is the source, which would be overwritten")
    return _FileSink(sequence, resume, display)


class _FileSink:
    """A file a frame."""

    def __init__(self, sequence, resume, display):
        self.sequence, self.resume, self.display = sequence, resume, display

    def has(self, number):
        return self.resume and self.sequence.path(number).exists()

    def write(self, number, picture, stack):
        path = self.sequence.path(number)
        groups = stack if path.suffix.lower() == ".exr" else None
        images.write(path, picture, layers=groups, **self.display)

    def finish(self, numbers, rate, problems, report):
        """Nothing is left to do."""


class _ScriptSink:
    """A Nuke script, once the frames that it reads are there."""

    def __init__(self, path, sinks, names):
        found = [sink.sequence for sink in sinks if getattr(sink, "sequence", None)]
        found = [sequence for sequence in found if sequence.after.lower().endswith(".exr")]
        if not found:
            raise ValueError(f"{path}: a Nuke script needs a sequence of .exr files to read")
        self.path, self.frames, self.names = path, found[0], names

    def has(self, number):
        return True

    def finish(self, numbers, rate, problems, report):
        first = next(path for path in map(self.frames.path, numbers) if path.exists())
        groups = {name: (str(self.frames), f"C_{name}") for name in self.names}
        size = images.read(first).shape[:2]
        nuke.write_script(self.path, groups, size, frames=(numbers[0], numbers[-1]), rate=rate)


class _MovieSink:
    """A movie, and until it is whole its frames as half-float files in a folder beside it."""

    def __init__(self, path, resume, display):
        self.path, self.display = path, display
        self.frames = Sequence(path.with_name(f"{path.name}.frames"), "", 6, ".exr")
        self.whole = resume and path.exists() and not self.frames.folder.exists()
        if not resume:
            self._clear()

    def has(self, number):
        return self.whole or self.frames.path(number).exists()

    def write(self, number, picture, stack):
        self.frames.folder.mkdir(exist_ok=True)
        images.write(self.frames.path(number), picture.clip(-images.HALF_MAX, images.HALF_MAX))

    def finish(self, numbers, rate, problems, report):
        if not self.whole:
            movies.write_movie(self.path, self._held(numbers, report), rate=rate, **self.display)
            if not problems:
                self._clear()

    def _held(self, numbers, report):
        """All frames; one that is missing is the frame before it, or the first there is."""
        shown = next(number for number in numbers if self.frames.path(number).exists())
        for done, number in enumerate(numbers, 1):
            shown = number if self.frames.path(number).exists() else shown
            yield images.read(self.frames.path(shown))
            report(done, len(numbers), f"Encoding {self.path.name}")

    def _clear(self):
        for number in self.frames.numbers():
            self.frames.path(number).unlink()
        with contextlib.suppress(OSError):  # there is none, or it holds what is not ours
            self.frames.folder.rmdir()
