"""One light at a time (OLAT): the person lit from each direction of the set, to mix in another program."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from relight.arguments import checks_arguments
from relight.lights.directional import DirectionalLight
from relight.lights.files import write_lights
from relight.media.colour import Display
from relight.media.content_hash import content_hash
from relight.media.sequences import FrameRange, FrameSequence, GivenFrames
from relight.pipeline.delivery import Delivery
from relight.pipeline.frame_numbers import shown_frame
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Compute, GivenSource, Output
from relight.pipeline.outputs import is_exr
from relight.pipeline.rendered_frame import cut_out
from relight.pipeline.run import Job, Problems, run
from relight.pipeline.shot import Shot
from relight.pipeline.sinks import ExrForm, FileSink, ScriptSink, SingleFile, file_of
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
@checks_arguments
def write_olat(
    source: GivenSource,
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
    job = SeparateLights(Output.of(output).paths, behind)
    with Shot.open(source, compute=compute) as shot:
        return run(job, shot, frame, progress)


class SeparateLights(Job[list[Path]]):
    """Writes the person of one frame in each OLAT light alone: the frames of this job are its lights."""

    step = "Lights"

    def __init__(self, paths: Sequence[Path], behind: bool) -> None:
        super().__init__()
        self._scripts = [path for path in paths if nuke.is_script(path)]
        pictures = [path for path in paths if path not in self._scripts]
        if others := [path for path in pictures if not is_exr(path)]:
            raise ValueError(f"{others[0]}: expected a file name that ends in .exr")
        if len(pictures) != 1 or len(self._scripts) > 1:
            raise ValueError("output: expected one .exr and at most one .nk")
        self._paths, self._lights, self._files = paths, olat_lights(behind), file_of(pictures[0])
        self._lights_file = pictures[0].with_suffix(".json")
        if isinstance(self._files, FrameSequence):  # each light has a file
            self._lights_file = self._files.beside(".json")
        self._layers = Layers()  # of a single file

    def check(self, shot: Shot, frames: GivenFrames | None) -> FrameRange:
        """Refuse outputs that are read, and a frame that is not there; return the numbers of the lights."""
        shot.check_outputs(Output(self._paths, save_lights=self._lights_file))
        self._frame = shown_frame(shot, frames)
        return FrameRange.of((1, len(self._lights)))

    def prepare(self, shot: Shot, numbers: FrameRange, report: Report) -> None:
        """Analyse the person."""
        self._delivery, exr = Delivery(shot), ExrForm(depth="half", autocrop=False)
        self._sink = FileSink(self._files, resume=False, display=Display(), exr=exr, delivery=self._delivery)
        self._subject, self._plate = shot.persons.shown(self._frame), self._delivery.metadata(self._frame)
        self._made = shot.content_hash(self._frame, as_read=True)

    def frame(self, shot: Shot, number: int) -> None:
        """Write the person in one light, or keep the layer for the single file."""
        light = self._lights[number - 1]
        relit = self._subject.relit(light)
        if isinstance(self._files, FrameSequence):
            header = {**self._plate, "relight:direction": light.direction}
            self._sink.write(number, cut_out(relit, {}), content_hash(self._made, light), header)
        else:
            self._layers[f"C_{light.name}"] = relit[..., :3].astype(np.float16)

    def finish(self, shot: Shot, numbers: FrameRange, problems: Problems, report: Report) -> list[Path]:
        """Write the single file, the script and the lights file; return the paths of all."""
        written = FrameRange((0,)) if self._layers else numbers
        if self._layers:
            header = {**self._plate, **{f"relight:{light.name}": light.direction for light in self._lights}}
            total = sum(layer.astype(np.float32) for layer in self._layers.values())
            alpha = self._subject.matte
            summed = cut_out(np.dstack([total, alpha]), self._layers)
            self._sink.write(0, summed, content_hash(self._made, self._lights), header)
        for path in self._scripts:
            ScriptSink(path, self._groups(), False, self._delivery).write(written)
        write_lights(self._lights_file, self._lights)
        return [*map(self._files.path, written), self._lights_file, *self._scripts]

    def _groups(self) -> dict[str, tuple[FrameSequence | SingleFile, str | None]]:
        """Return the file and the layer of each light, for a script."""
        names = [f"{light.name}" for light in self._lights]
        if isinstance(self._files, FrameSequence):
            return {name: (SingleFile(self._files.path(n)), None) for n, name in enumerate(names, 1)}
        return {name: (self._files, f"C_{name}") for name in names}
