"""One light at a time (OLAT): the person lit from each direction of the set, to mix in another program."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from relight.lights.directional import DirectionalLight
from relight.lights.files import write_lights
from relight.media.content_hash import content_hash
from relight.media.sequences import FrameRange, FrameSequence
from relight.pipeline.delivery import Delivery
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Compute, Output, Source
from relight.pipeline.outputs import is_exr
from relight.pipeline.rendered_frame import cut_out
from relight.pipeline.shot import Shot
from relight.pipeline.sinks import FileSink, ScriptSink, SingleFile, file_of
from relight.rendering import Layers
from relight.scene import nuke
from shadow import directions
from shadow.torch_settings import isolated


def olat_lights(behind: bool = False) -> list[DirectionalLight]:
    """Return lights of intensity 1, `olat_01`, `olat_02`..., from 64 directions, or 96 with `behind`."""
    return [
        DirectionalLight(direction, name=f"olat_{number:02d}")
        for number, direction in enumerate(directions.olat(behind).tolist(), 1)
    ]


@isolated
def write_olat(
    source: Source | Any,
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
    paths = Output.of(output).paths
    scripts = [path for path in paths if nuke.is_script(path)]
    pictures = [path for path in paths if path not in scripts]
    if others := [path for path in pictures if not is_exr(path)]:
        raise ValueError(f"{others[0]}: expected a file name that ends in .exr")
    if len(pictures) != 1 or len(scripts) > 1:
        raise ValueError("output: expected one .exr and at most one .nk")
    files, lights = file_of(pictures[0]), olat_lights(behind)
    groups: dict[str, Any] = {f"{light.name}": (files, f"C_{light.name}") for light in lights}
    description, numbers = pictures[0].with_suffix(".json"), FrameRange((0,))
    if isinstance(files, FrameSequence):  # each light has a file
        description, numbers = files.beside(".json"), FrameRange.of((1, len(lights)))
        groups = {name: (SingleFile(files.path(n)), None) for n, name in enumerate(groups, 1)}
    with Shot.open(source, compute=compute) as shot:
        shot.check_outputs(Output(paths, save_lights=description))
        number = shot.shown_frame(frame)
        shot.prepare(report)
        delivery, exr = Delivery(shot), {"depth": "half", "autocrop": False}
        writer = FileSink(files, resume=False, display={}, exr=exr, delivery=delivery)
        subject, plate = shot.subject(number), delivery.metadata(number)
        made, layers = shot.content_hash(number, as_read=True), Layers()
        for done, light in enumerate(lights, 1):
            relit = subject.relit(light)
            if len(numbers) > 1:
                header = {**plate, "relight:direction": light.direction}
                writer.write(done, cut_out(relit, {}), content_hash(made, light), header)
            else:
                layers[f"C_{light.name}"] = relit[..., :3].astype(np.float16)
            report(done, len(lights), "Lights")
        if layers:
            header = {**plate, **{f"relight:{light.name}": light.direction for light in lights}}
            total = sum(layer.astype(np.float32) for layer in layers.values())
            summed = cut_out(np.dstack([total, relit[..., 3]]), layers)
            writer.write(0, summed, content_hash(made, lights), header)
        for path in scripts:
            ScriptSink(path, groups, False, delivery).write(numbers)
    write_lights(description, lights)
    return [*map(files.path, numbers), description, *scripts]
