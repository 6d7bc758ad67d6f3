"""What the page sends, and what it is answered: the shapes of their JSON.

Nothing checks that a page sends these: who reads a value converts it, and what raises refuses the request.
"""

from typing import Any, Literal, TypeAlias, TypedDict

Object: TypeAlias = dict[str, Any]  # an object of JSON, before anybody knows what it is
Answer: TypeAlias = dict[str, Any]  # what a function of `relight.app.tasks` returned, and its "notes"
Points: TypeAlias = list[list[float]]  # places (x, y), as shares of width and height


class DrawnStroke(TypedDict):
    """A stroke over what is the person, or is not; its radius is a share of the picture's width."""

    person: bool
    points: Points
    radius: float


class Drawing(TypedDict, total=False):
    """An outline, or what corrects the matte of `model`; `shift` and `feather`: of the edge, as shares."""

    model: str | None
    lasso: Points | None
    strokes: list[DrawnStroke] | None
    holes: list[Points] | None
    shift: float | None
    feather: float | None


class Picture(TypedDict):
    """A file beside the photograph, as a background."""

    file: str


class Place(TypedDict, total=False):
    """Where the photograph is in the picture, see `relight.Source`; empty where it fills it."""

    scale: float
    offset: tuple[int, int]


class Look(TypedDict, total=False):
    """The light that a page asks for, and what is behind the person; see `relight.Lighting`."""

    lights: list[str] | None  # texts, as `relight apply --light` takes them
    environment: str | None  # likewise
    background: Picture | list[float] | str | None
    plate: bool  # whether a file holds the photograph's own background
    floor: str | None
    exposure: float | None
    gloss: float | None
    amount: float | None
    fill: float | None
    blur: float | None
    backgroundLight: float | None
    placement: Place | None
    size: list[int]  # (height, width) of the photograph


class Form(TypedDict, total=False):
    """How a picture is written, see `relight.Output`."""

    quality: int
    longest_side: int


class PersonOutline(TypedDict):
    """Somebody in the photograph: their number, from 1, and closed lines around them."""

    number: int
    lines: list[Points]


class Progress(TypedDict):
    """What is done of a task, and the share of it that is done, if that is known."""

    what: str
    share: float | None


Said: TypeAlias = (  # what the worker's process sends
    tuple[Literal["progress"], Progress] | tuple[Literal["done"], Answer] | tuple[Literal["refused"], str]
)

IN_PLACE: Place = {}
NO_LOOK: Look = {}
AS_IT_IS: Form = {}  # of full resolution
