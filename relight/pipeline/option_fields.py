"""What options are made of: the declaration of a field, the texts and the JSON that it is read from.

See `relight.pipeline.options`. Nothing heavy is imported.
"""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, TypeVar, cast, get_args, get_origin

if TYPE_CHECKING:
    from relight.compositing.floor import Floor

BACKGROUND = "background"  # as a size: the background's own

Report = Callable[[int, int, str], None]  # frames done, frames in all, what is done

Screen = Literal["green", "blue"]  # the colour of a screen that a person is keyed from
Fitting = Literal["fit", "fill", "centre"]  # how a photograph lies in a picture of another size
Alpha = Literal["straight", "premultiplied"]  # whether colours are multiplied by alpha
Filling = Literal["background"]  # what gives the light that fills the shadows of others
ExrType = Literal["half", "float"]  # the type of an OpenEXR file's channels
# What a run does of a shot whose frames are made in chunks: all of it; the frames of a chunk, no movie and no
# script; or movies and scripts, from the frames that the chunks have made.
Phase = Literal["all", "frames", "finalize"]


def option(
    help: str,  # as in typer.Option
    default: Any = None,
    *,
    text: Any = str,
    parse: Callable[[str], Any] | None = None,
    flags: tuple[str, ...] = (),
    path: bool = False,
    **limits: Any,
) -> Any:
    """Declare a field that is an option of the command line as well.

    `help`: one or two sentences. `default`: of the field and of the option; MISSING for what must be given.
    `text`: the type in which the command line takes it: str, int, float, bool, list[str], or a Literal;
    `parse`: from there to the field's value. `flags`: names of the option, where `--field-name` is not the
    one. `path`: whether a text may name a file or a sequence of files. `limits`: further arguments of
    `typer.Option`, such as min.
    """
    metadata = {"help": help, "text": text, "parse": parse, "flags": flags, "path": path, "limits": limits}
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


class Options:
    """What the four kinds of options have in common."""

    def __post_init__(self) -> None:
        """Make lists tuples, and refuse words that are none of those to choose from."""
        for each in fields(cast(Any, self)):
            value, kind = getattr(self, each.name), each.metadata["text"]
            if isinstance(value, list):
                self._set(each.name, tuple(value))
            elif get_origin(kind) is Literal and value is not None and value not in get_args(kind):
                raise ValueError(f"{each.name}: expected one of {', '.join(get_args(kind))}, got {value!r}")

    @classmethod
    def of(cls, given: Any) -> Self:
        """Return options unchanged, or make them of the plate, the lights or the paths alone."""
        return given if isinstance(given, cls) else cls(given)  # type: ignore[call-arg]

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)  # as frozen dataclasses initialise themselves

    def given(self) -> dict[str, Any]:
        """{field: value} of the fields that do not have their default."""
        return {
            each.name: getattr(self, each.name)
            for each in fields(cast(Any, self))
            if not _is_default(getattr(self, each.name), each.default)
        }

    def absolute(self) -> Self:
        """Return the same options with absolute paths, which are valid in another working directory."""
        changed = {
            each.name: _absolute(getattr(self, each.name))
            for each in fields(cast(Any, self))
            if each.metadata["path"] and not _is_default(getattr(self, each.name), each.default)
        }
        return dataclasses.replace(cast(Any, self), **changed)


def parse_size(text: str) -> tuple[int, int] | str:
    """Parse `1920x1080` as (height, width); `background` is returned unchanged."""
    if text == BACKGROUND:
        return text
    try:
        width, height = map(int, text.lower().split("x"))
    except ValueError as error:
        raise ValueError(f"--size: expected WIDTHxHEIGHT or background, got {text!r}") from error
    return height, width


def parse_offset(text: str) -> tuple[int, int]:
    """Parse `120/-40` as (right, up)."""
    try:
        right, up = map(int, text.split("/"))
    except ValueError as error:
        raise ValueError(f"--offset: expected RIGHT/UP in pixels, such as 120/-40, got {text!r}") from error
    return right, up


def parse_person(text: str) -> int | tuple[int, ...] | str:
    """Parse `2` as a number, `640/300` as a point, `640/300/90` as a circle; `all` is returned unchanged."""
    if text == "all":
        return text
    try:
        values = tuple(map(int, text.split("/")))
    except ValueError:
        values = ()
    if not 1 <= len(values) <= 3:
        raise ValueError(f"--person: expected a number, X/Y, X/Y/RADIUS or all, got {text!r}")
    return values[0] if len(values) == 1 else values


def parse_background(text: str) -> tuple[float, ...] | str:
    """Parse a colour such as `0.2/0.2/0.2`; return other text, a path or `environment`, unchanged."""
    from relight.compositing.composite import parse_background

    return parse_background(text)


def parse_place(text: str) -> tuple[float, ...] | str:
    """Parse `1/0.9/2` as three numbers.

    Return other text, the path of a prim or the name of a node, unchanged.
    """
    try:
        numbers = tuple(map(float, text.split("/")))
    except ValueError:
        return text
    return numbers if len(numbers) == 3 else text


def parse_floor(text: str) -> Floor:
    """Parse `height=1.5,horizon=0.45` or `feet=X/Y/X/Y` as a Floor."""
    from relight.compositing.floor import Floor

    return Floor.parse(text)


def parse_passes(text: str) -> tuple[str, ...]:
    """Parse `albedo,N` as ("albedo", "N")."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _is_default(value: Any, default: Any) -> bool:
    """Return whether a value is the default; an array never is."""
    if value is default:
        return True
    return type(value) is type(default) and not hasattr(value, "shape") and value == default


def _absolute(value: Any) -> Any:
    """Return a path made absolute; other values, such as a colour or the name of a model, are unchanged."""
    if isinstance(value, tuple) and value and all(isinstance(each, Path) for each in value):
        return tuple(each.absolute() for each in value)
    if isinstance(value, Path):
        return value.absolute()
    if not isinstance(value, str):
        return value
    if os.path.exists(value):
        return os.path.abspath(value)
    # The format of a matting model follows its path, and a layer that of a picture.
    for path, separator, rest in (value.partition(","), value.rpartition(":")):
        if separator and os.path.exists(path):
            return f"{os.path.abspath(path)}{separator}{rest}"
    return os.path.abspath(value) if re.search(r"%0?\d*d|#+", os.path.basename(value)) else value


AnyOptions = TypeVar("AnyOptions", bound=Options)


def to_json(options: Options) -> dict[str, Any]:
    """Convert options to JSON types: {field: value} of all values that are not the default.

    Raises TypeError, naming the field, for what is in memory alone: arrays and functions.

    >>> from relight.pipeline.options import Source
    >>> source = Source("plate.%04d.exr", mask="matte.%04d.png", height=1.8)
    >>> from_json(Source, to_json(source)) == source
    True
    """
    return {name: _plain(name, value) for name, value in options.given().items()}


def from_json(kind: type[AnyOptions], document: Mapping[str, Any]) -> AnyOptions:
    """Convert the result of `to_json` to options. Raises ValueError for unknown fields."""
    known = {each.name for each in fields(cast(Any, kind))}
    for name in document:
        if name not in known:
            raise ValueError(f"{name}: unknown option; expected any of {', '.join(sorted(known))}")
    values = dict(document)
    if isinstance(values.get("lights"), list):
        from relight.lights.files import from_entries

        values["lights"] = from_entries(values["lights"])
    if isinstance(values.get("floor"), Mapping):
        from relight.compositing.floor import Floor

        values["floor"] = Floor(**{name: _tuples(value) for name, value in values["floor"].items()})
    return kind(**{name: _tuples(value) for name, value in values.items()})


def _plain(name: str, value: Any) -> Any:
    """Convert a value to JSON types."""
    if name == "lights" and isinstance(value, tuple):
        from relight.lights.files import to_entries

        return to_entries(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, tuple | list):
        return [_plain(name, each) for each in value]
    if dataclasses.is_dataclass(value) and name == "floor":
        return {each.name: _plain(each.name, getattr(value, each.name)) for each in fields(value)}
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise TypeError(f"{name}: expected a path or a number, which JSON can hold, got {type(value).__name__}")


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
