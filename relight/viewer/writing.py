"""A photograph's page, from files to a file; what `relight view` calls."""

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from relight import keying
from relight.cutting import Cutting
from relight.lights.environment import FIELD_OF_VIEW
from relight.lights.light import Light
from relight.media import movies
from relight.media.sequences import Sequence as Frames
from relight.preparation import Preparation, Source
from relight.rendering import Background
from relight.subject import Subject
from relight.viewer.page import SUFFIXES
from relight.viewer.scene import COMMAND, KEY, checked_lights
from shadow import files, inputs


def write_view(
    output: str | Path,
    image: Source,
    lights: Light | Iterable[Light] | None = None,
    *,
    mask: Source | None = None,
    key: str | None = None,
    cutting: Cutting | None = None,
    background: Background | str | Path | None = None,
    colour_space: str | None = None,
    depth: np.ndarray | str | os.PathLike | None = None,
    height: float | None = None,
    field_of_view: float = FIELD_OF_VIEW,
    command: Sequence[str] = COMMAND,
    device: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write the page in which one holds the light: one HTML file that needs no server and no network.

    Parameters
    ----------
    output: the file, .html.
    image, mask, key, cutting, colour_space, depth, height, field_of_view: as of `relight.render_still`.
    lights: what the page begins with: up to eight `DirectionalLight` and `PointLight`, and one
        `EnvironmentLight`; a soft key light unless given.
    background: as of `relight.render_still`.
    command: the words of the command that relights this photograph, without its lights: the page completes
        and copies it.
    device: where the networks run, such as "cuda"; the CPU unless given.
    progress: called with what is being done, before each step.

    Returns
    -------
    The path written.

    Raises
    ------
    FileNotFoundError, OSError: a file cannot be read or written. TypeError, ValueError: bad arguments, lights
    that the page cannot show. All is refused before the networks run.
    """
    report = progress or (lambda what: None)
    path = files.check_writable(output, SUFFIXES)
    for source in (image, mask, background):
        if isinstance(source, str | os.PathLike) and (
            movies.is_movie(source) or Frames.of(source) is not None
        ):
            raise ValueError(f"{source}: expected one picture's file; the page shows a still")
    shown = list(checked_lights(KEY if lights is None else lights).values())
    inputs.device("device", device)
    prepared = Preparation(
        image, mask=mask, key=key, cutting=cutting, colour_space=colour_space, background=background,
        depth=depth, height=height, field_of_view=field_of_view,
    )  # fmt: skip
    prepared.check_lights(shown)
    if (key is not None or cutting is not None) and not keying.is_compiled():
        report(keying.COMPILING)
    person = prepared.person(0)
    report("Analysing")
    subject = Subject(
        person.plate, person.matte, depth=person.depth, height=height, field_of_view=field_of_view,
        device=device,
    )  # fmt: skip
    backdrop = prepared.backdrop(0, shown, subject.size)
    title = Path(image).name if isinstance(image, str | os.PathLike) else "relight"
    report(f"Writing {path}")
    subject.view(path, shown, background=backdrop, title=title, command=command)
    return path
