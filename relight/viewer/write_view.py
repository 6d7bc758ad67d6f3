"""Write the page of a frame of a shot, from files to a file; `relight view` calls it."""

import re
from collections.abc import Iterable
from pathlib import Path

from relight import quantities
from relight.arguments import checks_arguments
from relight.lights.light import Light
from relight.lights.moving import MovingLight
from relight.lights.rig import as_lights
from relight.media.sequences import FrameRange, GivenFrames
from relight.pipeline.frame_numbers import shown_frame
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Compute, GivenLighting, GivenSource
from relight.pipeline.run import Job, Problems, run
from relight.pipeline.shot import Shot
from relight.viewer import SUFFIXES
from relight.viewer.initial_state import COMMAND, DEFAULT_LIGHT, checked_lights
from shadow import files
from shadow.torch_settings import isolated

# The folders of an absolute path, which a page that is sent away should not tell
ABSOLUTE = re.compile(r"(^|[=:])(?:/|[A-Za-z]:[\\/])(?:[^/\\]*[/\\])*")


@isolated
@checks_arguments
def write_view(
    output: quantities.File,
    source: GivenSource,
    lighting: GivenLighting = (),
    *,
    frame: int | None = None,
    command: quantities.Words = COMMAND,
    compute: Compute | None = None,
    progress: Report | None = None,
) -> Path:
    """Write an interactive page for relighting: one HTML file that needs no server and no network.

    Parameters
    ----------
    output
        The file, .html.
    source
        Source, or a plate or analysis cache, see `relight.render_shot`.
    lighting
        Lighting, or lights: the initial lights, and the background, which is the photograph itself if it has
        no alpha and there is no other. Up to eight `DirectionalLight` and `PointLight`, and one
        `EnvironmentLight`; a soft key light by default.
    frame
        The frame of a sequence, a movie or an analysis cache; the first by default.
    command
        The words of the command that relights this source, without lights, which the page adds.
    compute
        Compute: device, precision and threads.
    progress
        Called with (steps done, number of steps, name of the step).

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    FileNotFoundError, OSError
        A file cannot be read or written.
    TypeError, ValueError
        Bad arguments, lights that the page cannot show. They are refused before the networks run.

    Examples
    --------
    >>> import relight
    >>> key = relight.DirectionalLight(azimuth=-40, elevation=30, name="key")
    >>> relight.write_view("person.html", "examples/person.png", key).name
    'person.html'
    """
    job = Viewing(files.check_writable(output, SUFFIXES), command)
    with Shot.open(source, lighting, compute) as shot:
        return run(job, shot, frame, progress)


class Viewing(Job[Path]):
    """Writes the page of one frame."""

    step = "Analysing"

    def __init__(self, path: Path, command: Iterable[str]) -> None:
        super().__init__()
        self._path, self._command = path, [ABSOLUTE.sub(r"\1", word) for word in command]

    def check(self, shot: Shot, frames: GivenFrames | None) -> FrameRange:
        """Refuse lights that the page cannot show, and a frame or a background that is not there."""
        _initial(shot, shot.lights.stated())
        number = shown_frame(shot, frames)
        shot.check_lights(number)
        shot.backgrounds.check_plate()
        return FrameRange((number,))

    def prepare(self, shot: Shot, numbers: FrameRange, report: Report) -> None:
        """Say that the analysis begins."""
        report(0, 1, self.step)

    def frame(self, shot: Shot, number: int) -> None:
        """Analyse the person."""
        self._subject = shot.persons.shown(number, filtered=False)

    def finish(self, shot: Shot, numbers: FrameRange, problems: Problems, report: Report) -> Path:
        """Write the page."""
        plate, lighting = shot.source.plate, shot.lighting
        behind, kept = lighting.background, shot.backgrounds.keeps_plate
        name = quantities.PLATE if kept else Path(behind).name if files.is_path(behind) else None
        self._subject.view(
            self._path,
            _initial(shot, shot.lights.exposed()),
            background=shot.backgrounds.behind(numbers[0], self._subject, kept),
            title=Path(plate).name if files.is_path(plate) else "relight",
            command=self._command,
            background_name=name,
            gloss=lighting.effective_gloss,
            amount=lighting.amount,
            fill=lighting.fill_amount * lighting.intensity if lighting.fill else 0.0,
            background_blur=lighting.background_blur,
            background_light=lighting.background_light,
        )
        return self._path


def _initial(shot: Shot, lights: list[Light | MovingLight]) -> list[Light]:
    """Return the lights that a page begins with; raises for those that it cannot show."""
    return list(checked_lights(as_lights(lights) if shot.lighting.has_lights else DEFAULT_LIGHT).values())
