"""A subject with the light in one's hand: a page, or a widget; what `Subject.view` calls."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from relight.canvas import check_outside
from relight.lights.light import Light, as_lights
from relight.lights.near import NearLight
from relight.viewer.page import write_page
from relight.viewer.scene import COMMAND, scene_of
from shadow.files import AnyPath

if TYPE_CHECKING:
    from relight.subject import Subject


def show(
    subject: "Subject",
    path: AnyPath | None,
    lights: Light | Iterable[Light] | None,
    background: Any,
    title: str,
    command: Sequence[str] | None,
) -> Any:
    """The path of a page that was written, or a widget; arguments and errors are those of `Subject.view`."""
    several = None if lights is None else as_lights(lights)
    scene = scene_of(subject.size, several, background, title=title, command=command or COMMAND)
    canvas = subject._canvas
    for light in several or []:
        if isinstance(light, NearLight):
            check_outside(light, canvas.space, canvas.known)
    if path is not None:
        return write_page(path, scene, subject)
    try:
        from relight.viewer.widget import Viewer
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "a view in a notebook needs anywidget: pip install 'relight[notebook]'"
        ) from error
    return Viewer(subject, scene)
