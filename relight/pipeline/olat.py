"""One light at a time (OLAT): the person lit from each direction of the set, to mix in another program."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from relight.lights.directional import DirectionalLight
from relight.lights.files import write_lights
from relight.media import images, nuke
from relight.media.content_hash import content_hash
from relight.media.sequences import FrameRange, FrameSequence
from relight.pipeline.delivery import Delivery
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Compute, Output, Source
from relight.pipeline.outputs import is_exr
from relight.pipeline.shot import Shot
from relight.pipeline.sinks import FileSink, ScriptSink, SingleFile, file_of
from relight.rendering import Layers
from relight.subject import Subject
from shadow import directions

if TYPE_CHECKING:
    from relight.pipeline.options import Picture

EXR = {"depth": "half", "autocrop": False}


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
    report = progress or (lambda done, total, what: None)
    paths, picture, scripts = _outputs(output)
    sequence, lights = FrameSequence.of(picture), olat_lights(behind)
    description = picture.with_suffix(".json") if sequence is None else sequence.beside(".json")
    with Shot.open(source, compute=compute) as shot:
        shot.check_outputs(Output(paths, save_lights=description))
        number = shot.shown_frame(frame)
        shot.prepare(report)
        delivery = Delivery(shot)
        writer = FileSink(file_of(picture), resume=False, display={}, exr=EXR, delivery=delivery)
        subject, plate = shot.subject(number), delivery.metadata(number)
        made = shot.content_hash(number, as_read=True)
        if sequence is None:
            together, layers, directions_of = _light_groups(subject, lights, report)
            writer.write(0, together, layers, content_hash(made, lights), {**plate, **directions_of})
        else:
            for done, light in enumerate(lights, 1):
                metadata = {**plate, "relight:direction": light.direction}
                writer.write(done, subject.relit(light), {}, content_hash(made, light), metadata)
                report(done, len(lights), "Lights")
        for path in scripts:
            ScriptSink(path, _script_groups(picture, lights), False, delivery).write(
                FrameRange((0,)) if sequence is None else FrameRange.of((1, len(lights)))
            )
    write_lights(description, lights)
    pictures = [picture] if sequence is None else [sequence.path(n) for n in range(1, len(lights) + 1)]
    return [*pictures, description, *scripts]


def _light_groups(
    subject: Subject, lights: list[DirectionalLight], report: Report
) -> tuple[np.ndarray, Layers, images.Metadata]:
    """Return the sum of all lights (H, W, 4), a layer for each, and their directions for the header."""
    layers: Layers = {}
    total: Any = 0
    for done, light in enumerate(lights, 1):
        relit = subject.relit(light)
        layers[f"C_{light.name}"] = relit[..., :3].astype(np.float16)
        total = total + layers[f"C_{light.name}"].astype(np.float32)
        report(done, len(lights), "Lights")
    metadata: images.Metadata = {f"relight:{light.name}": light.direction for light in lights}
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


def _script_groups(picture: Path, lights: list[DirectionalLight]) -> dict[str, Any]:
    """Return {light: (its file, the layer in it)} for a script; of a sequence, each light has a file."""
    files = file_of(picture)
    if not isinstance(files, FrameSequence):
        return {light.name: (files, f"C_{light.name}") for light in lights if light.name}
    return {light.name: (SingleFile(files.path(n)), None) for n, light in enumerate(lights, 1) if light.name}
