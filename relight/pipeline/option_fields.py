"""What options are made of: the kinds of their values, the texts and the JSON that they are read from.

See `relight.pipeline.options`, and `relight.arguments` for how a kind is stated. Nothing heavy is imported.
"""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self, TypeAlias, TypeGuard, TypeVar

from annotated_types import Ge

from relight.arguments import About, Checked, Converted, Converts, about, parameters, shown, unknown
from relight.quantities import File, background_of, file_name

if TYPE_CHECKING:
    import numpy as np
    import torch

    from relight.compositing.floor import Floor
    from relight.lights.environment import EnvironmentLight
    from relight.lights.light import Light
    from relight.lights.moving import MovingLight

BACKGROUND = "background"  # as a size: the background's own

Report = Callable[[int, int, str], None]  # frames done, frames in all, what is done

# What a run does of a shot whose frames are made in chunks: all of it; the frames of a chunk, no movie and no
# script; or movies and scripts, from the frames that the chunks have made.
Phase = Literal["all", "frames", "finalize"]
Pass = Literal["albedo", "N", "Z", "P", "visibility", "shading", "gloss", "confidence"]


def _is_array(value: object) -> TypeGuard[np.ndarray]:
    return hasattr(value, "shape") and hasattr(value, "dtype")


def _is_light(value: object) -> bool:
    return hasattr(value, "rays") or hasattr(value, "at")  # of whatever class; it may move


def _wrong(expected: str, value: object) -> TypeError:
    return TypeError(f"expected {expected}, got {shown(value)}")


def _path(value: object) -> Path:
    return Path(file_name(value))


def _paths(value: object) -> tuple[Path, ...]:
    """Return a path or several as a tuple."""
    several = [value] if isinstance(value, str | os.PathLike) or not isinstance(value, Iterable) else value
    return tuple(map(_path, several))


def _plate(value: object) -> object:
    if _is_array(value):
        if len(value.shape) not in (2, 3) or 0 in value.shape or "object" in str(value.dtype):
            raise _wrong("a picture (H, W, 3|4), a matte (H, W), or the name of a file", value)
        return value
    if not isinstance(value, str | os.PathLike):
        raise _wrong("a picture, which is an array, or the name of a file", value)
    return file_name(value)


def _photograph(value: object) -> object:
    if _is_array(value) and (len(value.shape) != 3 or value.shape[-1] not in (3, 4)):
        raise ValueError(f"expected a picture (H, W, 3|4), got {shown(value)}")
    return _plate(value)


def _normals(value: object) -> object:
    return value if callable(value) else _plate(value)


def _lights(value: object) -> object:
    """Return lights as a tuple, also of entries as JSON has them; the path of a lights file unchanged."""
    if isinstance(value, str | os.PathLike):
        return file_name(value)
    if isinstance(value, list | tuple) and value and all(isinstance(each, Mapping) for each in value):
        from relight.lights.files import from_entries

        return tuple(from_entries(value))
    if _is_light(value):
        return (value,)
    if isinstance(value, Mapping) or not isinstance(value, Iterable):
        raise _wrong("lights or the path of a lights file", value)
    several = tuple(value)
    for each in several:
        if not _is_light(each):
            raise _wrong("lights, e.g. DirectionalLight", each)
    return several


def _added_lights(value: object) -> tuple[object, ...]:
    """Return lights, and texts of lights, as a tuple."""
    if isinstance(value, str) or _is_light(value) or not isinstance(value, Iterable):
        value = (value,)
    several = tuple(value)
    for each in several:
        if not isinstance(each, str) and not _is_light(each):
            raise _wrong("lights or their texts", each)
    return several


def _background(value: object) -> object:
    if isinstance(value, list | tuple):
        numbers = [each for each in value if isinstance(each, int | float) and not isinstance(each, bool)]
        if len(numbers) != 3 or len(value) != 3:
            raise ValueError(f"expected an image or three finite numbers, got {shown(value)}")
        return tuple(value)
    if isinstance(value, str):
        file_name(value)
        return background_of(value)
    return value if _is_light(value) else _plate(value)


def _floor(value: object) -> Floor:
    """Return a floor, also of {parameter: value} or of a text such as `height=1.5`."""
    from relight.compositing.floor import Floor

    if isinstance(value, Mapping):
        return Floor(**value)
    if isinstance(value, Floor):
        return value
    if not isinstance(value, str):
        raise _wrong("a relight.Floor or height=METRES,horizon=SHARE", value)
    return Floor.parse(value)


def _preset(text: str) -> str:
    from relight.lights.preset_table import known

    return known(text)


def _size(text: str) -> tuple[int, int] | str:
    """Parse `1920x1080` as (height, width); `background` is returned unchanged."""
    if text == BACKGROUND:
        return text
    try:
        width, height = map(int, text.lower().split("x"))
    except ValueError:
        raise ValueError(f"expected WIDTHxHEIGHT or background, got {text!r}") from None
    return height, width


def _offset(text: str) -> tuple[int, int]:
    """Parse `120/-40` as (right, up)."""
    try:
        right, up = map(int, text.split("/"))
    except ValueError:
        raise ValueError(f"expected RIGHT/UP in pixels, such as 120/-40, got {text!r}") from None
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
        raise ValueError(f"expected a number, X/Y, X/Y/RADIUS or all, got {text!r}")
    return values[0] if len(values) == 1 else values


def _place(text: str) -> tuple[float, ...] | str:
    """Parse `1/0.9/2` as three numbers; return the path of a prim or the name of a node unchanged."""
    try:
        numbers = tuple(map(float, text.split("/")))
    except ValueError:
        return text
    return numbers if len(numbers) == 3 else text


def _words(text: str) -> tuple[str, ...]:
    """Parse `albedo,N` as ("albedo", "N")."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


if TYPE_CHECKING:
    Picture: TypeAlias = np.ndarray | torch.Tensor | File  # in memory, a file, a sequence or a movie
    Photograph: TypeAlias = Picture
    Normals: TypeAlias = np.ndarray | Callable[..., object] | File
    AnyLights: TypeAlias = Light | MovingLight | Iterable[Light | MovingLight] | File
    AddedLights: TypeAlias = str | Light | MovingLight | Iterable[str | Light | MovingLight]
    Texts: TypeAlias = str | Iterable[str]
    BackgroundSource: TypeAlias = np.ndarray | tuple[float, ...] | EnvironmentLight | MovingLight | File
    AnyFloor: TypeAlias = Floor
    Paths: TypeAlias = Converted[File | Iterable[File], tuple[Path, ...]]
    OptionalPath: TypeAlias = Converted[File | None, Path | None]
    Passes: TypeAlias = Converted[Iterable[str], tuple[Pass, ...]]
    Size: TypeAlias = tuple[int, int] | str
    Person: TypeAlias = int | tuple[int, ...] | str
    Offset: TypeAlias = tuple[int, int]
    Place: TypeAlias = tuple[float, ...] | str
    Preset: TypeAlias = str
else:
    Picture = Annotated[object, About(expected="a picture or the name of a file", check=_plate)]
    Photograph = Annotated[object, About(expected="a picture or the name of a file", check=_photograph)]
    Normals = Annotated[object, About(expected="normals, a network or the name of a file", check=_normals)]
    AnyLights = Annotated[object, About(expected="lights or the path of a lights file", check=_lights)]
    AddedLights = Annotated[object, About(expected="lights or their texts", check=_added_lights)]
    Texts = Annotated[tuple[str, ...], Converts(), About(expected="texts", parse=lambda text: (text,))]
    BackgroundSource = Annotated[object, About(expected="a picture, a colour or a file", check=_background)]
    AnyFloor = Annotated[object, About(expected="a relight.Floor", check=_floor)]
    Paths = Annotated[object, About(expected="a path or several", check=_paths)]
    OptionalPath = Annotated[object, About(expected="the name of a file", check=_path)] | None
    Passes = Annotated[tuple[Pass, ...], Converts(), About(parse=_words)]
    Size = Annotated[
        Annotated[tuple[Annotated[int, Ge(1)], Annotated[int, Ge(1)]], Converts()] | Literal["background"],
        About(expected="(height, width) of at least 1, or background", parse=_size),
    ]
    Person = Annotated[
        int
        | Annotated[tuple[int, int], Converts()]
        | Annotated[tuple[int, int, int], Converts()]
        | Literal["all"],
        About(expected="a number, (x, y), (x, y, radius) or all", parse=parse_person),
    ]
    Offset = Annotated[tuple[int, int], Converts(), About(unit="pixels", parse=_offset)]
    Place = Annotated[
        Annotated[tuple[float, float, float], Converts()] | str,
        About(expected="a path, a name or (x, y, z)", parse=_place),
    ]
    Preset = Annotated[str, About(check=_preset)]


class Options(Checked):
    """What the four kinds of options have in common, which are dataclasses."""

    if TYPE_CHECKING:
        __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[object]]]

    @classmethod
    def of(cls, given: object) -> Self:
        """Return options unchanged, or make them of the plate, the lights or the paths alone."""
        try:
            return given if isinstance(given, cls) else cls(given)
        except TypeError as error:
            raise TypeError(f"{cls.__name__.lower()}: {error}") from error
        except ValueError as error:
            raise ValueError(f"{cls.__name__.lower()}: {error}") from error

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)  # as frozen dataclasses initialise themselves

    def given(self) -> dict[str, object]:
        """{field: value} of the fields that do not have their default."""
        return {
            each.name: getattr(self, each.name)
            for each in fields(self)
            if not _is_default(getattr(self, each.name), each.default)
        }

    def absolute(self) -> Self:
        """Return the same options with absolute paths, which are valid in another working directory."""
        files = file_options(type(self))
        changed = {name: _absolute(value) for name, value in self.given().items() if name in files}
        return dataclasses.replace(self, **changed)


def _is_default(value: object, default: object) -> bool:
    """Return whether a value is the default; an array never is."""
    if value is default:
        return True
    return type(value) is type(default) and not hasattr(value, "shape") and value == default


def _absolute(value: object) -> object:
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


def to_json(options: Options) -> dict[str, object]:
    """Convert options to JSON types: {field: value} of all values that are not the default.

    Raises TypeError, naming the field, for what is in memory alone: arrays and functions.

    >>> from relight.pipeline.options import Source
    >>> source = Source("plate.%04d.exr", mask="matte.%04d.png", height=1.8)
    >>> from_json(Source, to_json(source)) == source
    True
    """
    return {name: _plain(name, value) for name, value in options.given().items()}


def from_json(kind: type[AnyOptions], document: Mapping[str, object]) -> AnyOptions:
    """Convert the result of `to_json` to options. Raises ValueError for unknown fields."""
    known = [each.name for each in fields(kind)]
    for name in document:
        if name not in known:
            raise ValueError(unknown(name, known))
    return kind(**document)


def file_options(kind: type[Options]) -> list[str]:
    """Return the names of options whose texts may name files or sequences of files."""
    return [name for name, each in parameters(kind).items() if (said := about(each.kind)) and said.path]


def _plain(name: str, value: object) -> object:
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
