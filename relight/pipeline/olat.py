"""One light at a time (OLAT): the person lit from each direction of the set, to mix in another program."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from relight.lights.directional import DirectionalLight
from relight.lights.files import write_lights
from relight.lights.light import Light
from relight.media import images, nuke
from relight.media.sequences import FrameRange, FrameSequence
from relight.pipeline.cache import check_not_analysed
from relight.pipeline.delivery import Delivery
from relight.pipeline.frames import FrameAnalyser, computing
from relight.pipeline.inputs import ShotInputs
from relight.pipeline.option_fields import Phase
from relight.pipeline.options import Compute, Lighting, Output, Source
from relight.pipeline.outputs import Report, check_outputs, has_frames, is_exr
from relight.pipeline.render import ShotRenderer
from relight.pipeline.sinks import FileSink, ScriptSink, SingleFile, Sink, file_of
from relight.rendering import Layers
from relight.subject import Subject
from shadow import directions
from shadow import inputs as checks

if TYPE_CHECKING:
    from relight.pipeline.options import Picture


def olat_lights(behind: bool = False) -> list[DirectionalLight]:
    """Return lights of intensity 1 named `olat_01`, `olat_02`..., from 64 directions.

    With `behind` 32 more.
    """
    return [
        DirectionalLight(direction, name=f"olat_{number:02d}")
        for number, direction in enumerate(directions.olat(behind).tolist(), 1)
    ]


def write_olat(
    source: "Source | Picture",
    output: str | Path | Iterable[str | Path],
    *,
    behind: bool = False,
    frame: int | None = None,
    compute: Compute | None = None,
    progress: Report | None = None,
) -> list[Path]:
    """Write the person in each OLAT light alone.

    Parameters
    ----------
    source
        Source, or a plate or analysis cache.
    output
        An .exr file with a layer `C_olat_01.R`... for each light, whose picture is their sum; or a sequence
        such as `olat.%04d.exr`, whose frame 1 is the first light. Also a Nuke script, .nk, with a Multiply
        for each light, and their sum.
    behind
        Whether to add 32 directions behind the person.
    frame
        The frame of a sequence, a movie or an analysis cache; the first by default.
    compute
        Compute: device, precision and threads.
    progress
        Called with (lights done, number of lights, name of the step).

    Returns
    -------
    list[Path]
        The paths written.

    Raises
    ------
    TypeError, ValueError
        As in `relight.Subject`; an output that is not .exr, or is also an input.
    OSError
        As `relight.write`.

    Notes
    -----
    A lights file (see `relight.read_lights`) with the directions is written beside the output, with the same
    name and the suffix .json. The headers have them as vectors, `relight:direction` or `relight:olat_01`. For
    a single file all lights are in memory, 6 bytes for each pixel and light; for a sequence, one light is.

    Examples
    --------
    >>> paths = relight.write_olat("examples/person.png", "olat.exr")
    """
    source, compute, report = Source.of(source), compute or Compute(), progress or (lambda *step: None)
    paths, picture, scripts = _outputs(output)
    sequence, lights = FrameSequence.of(picture), olat_lights(behind)
    description = picture.with_suffix(".json") if sequence is None else sequence.beside(".json")
    written = Output(paths, save_lights=description)
    check_outputs(written, (source.plate, source.mask, source.normals, source.depth))
    check_not_analysed(source, compute)
    checks.device("device", compute.device)
    with computing(compute):
        inputs = ShotInputs(source)
        shown = first_frame(inputs, frame)
        inputs.compile_matting(report)
        delivery = Delivery(inputs)
        sinks = _sinks(picture, scripts, lights, delivery)
        shot = _OlatRenderer(inputs, lights, shown, written, compute, sinks, delivery, report)
        numbers = FrameRange((0,)) if sequence is None else FrameRange.of((1, len(lights)))
        shot.render(numbers, report)
    write_lights(description, lights)
    pictures = [picture] if sequence is None else [sequence.path(number) for number in numbers]
    return [*pictures, description, *scripts]


def first_frame(inputs: ShotInputs, frame: int | None) -> int:
    """Return the frame of a source to show: the given or the first one.

    Raises ValueError if it does not exist.
    """
    numbers = inputs.numbers
    if numbers is None:
        if frame is not None:
            raise ValueError("frame: a still has none")
        return 0
    if frame is not None and frame not in numbers:
        raise ValueError(f"frame: expected a frame of the source, {numbers[0]} to {numbers[-1]}, got {frame}")
    return numbers[0] if frame is None else frame


class _OlatRenderer(ShotRenderer):
    """The frames of a shot whose light goes through the OLAT directions, or one frame that holds them all."""

    def __init__(
        self,
        inputs: ShotInputs,
        lights: list[DirectionalLight],
        shown: int,
        output: Output,
        compute: Compute,
        sinks: list[Sink],
        delivery: Delivery,
        report: Report,
    ) -> None:
        super().__init__(
            inputs, FrameAnalyser(inputs, compute.device), [*lights], Lighting(), output, compute, sinks,
            resume=False, phase=Phase.all, delivery=delivery,
        )  # fmt: skip
        self._shown, self._report, self.raises = shown, report, True
        self._single = not has_frames(output)
        self._subject = self.analyser.person(shown)

    def source_frame(self, number: int) -> int:
        return self._shown

    def subject(self, number: int) -> Subject:
        return self._subject

    def lights_at(self, number: int) -> list[Light]:
        lights: list[Any] = self.lights
        return lights if self._single else [lights[number - 1]]

    def picture(self, subject: Subject, number: int) -> tuple[Any, Layers, images.Metadata]:
        lights: list[Any] = self.lights_at(number)
        if not self._single:
            return subject.relit(lights), {}, {"relight:direction": lights[0].direction}
        layers: Layers = {}
        total: Any = 0
        for done, light in enumerate(lights, 1):
            relit = subject.relit(light)
            layers[f"C_{light.name}"] = relit[..., :3].astype(np.float16)
            total = total + layers[f"C_{light.name}"].astype(np.float32)
            self._report(done, len(lights), "Lights")
        metadata = {f"relight:{light.name}": light.direction for light in lights}
        return np.concatenate([total, relit[..., 3:]], axis=-1), layers, metadata


def _outputs(output: str | Path | Iterable[str | Path]) -> tuple[tuple[Path, ...], Path, list[Path]]:
    """Return the paths, the picture and the scripts among them.

    Raises ValueError unless there is one .exr.
    """
    paths = Output.of(output).paths
    scripts = [path for path in paths if nuke.is_script(path)]
    pictures = [path for path in paths if path not in scripts]
    for path in pictures:
        if not is_exr(path):
            raise ValueError(f"{path}: expected a file name that ends in .exr")
    if len(pictures) != 1 or len(scripts) > 1:
        raise ValueError("output: expected one .exr and at most one .nk")
    return paths, pictures[0], scripts


def _sinks(
    picture: Path, scripts: list[Path], lights: list[DirectionalLight], delivery: Delivery
) -> list[Sink]:
    """Return the sinks of the picture and of the scripts that mix its layers."""
    files = file_of(picture)
    exr = {"depth": "half", "autocrop": False}
    sinks: list[Sink] = [FileSink(files, resume=False, display={}, exr=exr, delivery=delivery)]
    groups: dict[str, Any] = {light.name: (files, f"C_{light.name}") for light in lights if light.name}
    if isinstance(files, FrameSequence):
        groups = {
            light.name: (SingleFile(files.path(n)), None) for n, light in enumerate(lights, 1) if light.name
        }
    return [*sinks, *(ScriptSink(path, groups, False, delivery) for path in scripts)]
