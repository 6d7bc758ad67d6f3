"""Write the page of a frame of a shot, from files to a file; `relight view` calls it."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from relight.compositing.composite import PLATE
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Compute, Lighting, Source
from relight.pipeline.shot import Shot
from relight.viewer.initial_state import COMMAND, DEFAULT_LIGHT, checked_lights
from relight.viewer.page import SUFFIXES
from shadow import files
from shadow.torch_settings import isolated

# The folders of an absolute path, which a page that is sent away should not tell
ABSOLUTE = re.compile(r"(^|[=:])(?:/|[A-Za-z]:[\\/])(?:[^/\\]*[/\\])*")


@isolated
def write_view(
    output: str | Path,
    source: Source | Any,
    lighting: Lighting | Any = (),
    *,
    frame: int | None = None,
    command: Sequence[str] = COMMAND,
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
    lighting, report = Lighting.of(lighting), progress or (lambda done, total, what: None)
    path = files.check_writable(output, SUFFIXES)
    with Shot.open(source, lighting, compute) as shot:
        lights: Any = shot.all_lights() if lighting.has_lights else DEFAULT_LIGHT
        shown = list(checked_lights(lights).values())
        number = shot.shown_frame(frame)
        shot.check_lights(number)
        shot.check_background()
        shot.prepare(report)
        report(0, 1, "Analysing")
        subject = shot.subject(number, filtered=False)
        report(1, 1, "Analysing")
        background = shot.behind(number, subject, shot.keeps_plate)
        keeps_plate = shot.keeps_plate
        if lighting.has_lights:
            lights = shot.all_lights(shot.preset_gain)
            shown = list(checked_lights(lights).values())
    plate = shot.source.plate
    title = Path(plate).name if files.is_path(plate) else "relight"
    behind = lighting.background
    name = PLATE if keeps_plate else Path(behind).name if files.is_path(behind) else None
    subject.view(
        path,
        shown,
        background=background,
        title=title,
        command=[ABSOLUTE.sub(r"\1", word) for word in command],
        background_name=name,
        gloss=lighting.effective_gloss,
        amount=lighting.amount,
        fill=lighting.fill_amount * lighting.intensity if lighting.fill else 0.0,
    )
    return path
