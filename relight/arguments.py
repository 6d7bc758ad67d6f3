"""What an argument is, stated once in its annotation, and checked for whoever gives it.

    Gloss = Annotated[float, Interval(ge=0, le=1), About("Reflection at grazing angles.")]

Ranges are those of `annotated_types`; `About` adds the rest. Functions (`checks_arguments`), dataclasses of
lights and options (`Checked`), texts (`read`), files, the command's options and the nodes' widgets all use
the same annotations. Pydantic checks them. It is imported at the first check: `relight --help` needs none.
"""

import dataclasses
import difflib
import functools
import inspect
import math
import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Generic,
    Literal,
    NamedTuple,
    ParamSpec,
    Self,
    TypeAlias,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)  # fmt: skip

from annotated_types import Interval

from shadow.errors import refuse_gradient

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, TypeAdapter
    from pydantic_core import CoreSchema, ErrorDetails

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
Annotation: TypeAlias = Any  # a class, a union, `Annotated`...: what `typing` takes apart
Given = TypeVar("Given", contravariant=True)  # what a constructor takes
Held = TypeVar("Held", covariant=True)  # what the object has

MIN_SIMILARITY = 0.7  # of a word that is meant
MOST_SHOWN = 120  # characters of a value in an error
SUFFIXES = {  # of numbers in texts, by unit
    "degrees": ("degrees", "degree", "deg", "°"), "kelvin": ("kelvin", "K", "k"), "metres": ("metres", "m"),
    "stops": ("stops", "stop", "EV", "ev"),
}  # fmt: skip


@dataclasses.dataclass(frozen=True, repr=False)
class About:
    """What an annotation says of an argument beside its type and its range.

    `help`: one or two sentences. `unit`: of a number. `expected`: words for an error, where the type's own do
    not do. `parse`: makes the value of a text, and `check` returns the value or another for it; both raise
    ValueError, whose text follows the argument's name. `words`: (word, number) pairs, of texts that stand for
    numbers. `path`: a text may name a file or a sequence of files.
    `flags`, `metavar` and `repeatable`: of the command's option.
    """

    help: str = ""
    _: dataclasses.KW_ONLY
    unit: str = ""
    expected: str = ""
    parse: Callable[[str], object] | None = None
    check: Callable[[Any], object] | None = None
    words: tuple[tuple[str, float], ...] = ()
    path: bool = False
    flags: tuple[str, ...] = ()
    metavar: str | None = None
    repeatable: bool = False

    def __repr__(self) -> str:
        return f"About({self.help!r})"

    def __get_pydantic_core_schema__(self, source: object, handler: "GetCoreSchemaHandler") -> "CoreSchema":
        from pydantic_core import core_schema

        schema = handler(source)
        if self.check is not None:
            schema = core_schema.no_info_after_validator_function(self.check, schema)
        if self.parse is not None:
            schema = core_schema.no_info_before_validator_function(self._parsed, schema)
        return schema

    def _parsed(self, value: object) -> object:
        return self.parse(value) if self.parse is not None and isinstance(value, str) else value


class Converts:
    """In an annotation: lists, arrays and other iterables become the tuple that it names."""

    def __get_pydantic_core_schema__(self, source: object, handler: "GetCoreSchemaHandler") -> "CoreSchema":
        return {**handler(source), "strict": False}


class Converted(Generic[Given, Held]):
    """A field that takes something else than it has, as type checkers see it.

    "Descriptor-typed fields" in the documentation of `dataclasses`.
    """

    def __get__(self, instance: object, kind: type) -> Held:
        raise NotImplementedError

    def __set__(self, instance: object, value: Given) -> None:
        raise NotImplementedError


def required() -> Any:
    """Say that a `Converted` field has no default: mypy takes it for what it is where one is assigned."""
    return dataclasses.field()


def default(value: Result) -> Converted[object, Result]:
    """Return the default of a `Converted` field, for which mypy takes it; in fact it is the value."""
    return cast("Converted[object, Result]", value)


class Parameter(NamedTuple):
    """A parameter of a function or a class: its annotation, and its default or `inspect.Parameter.empty`."""

    kind: object
    default: object

    @property
    def is_required(self) -> bool:
        return self.default is inspect.Parameter.empty


def parameters(function: Callable[..., object]) -> dict[str, Parameter]:
    """Return the parameters of a function, or of a class's constructor, by name."""
    return _parameters(function)


@functools.cache
def _parameters(function: Callable[..., object]) -> dict[str, Parameter]:
    made = function.__init__ if isinstance(function, type) else function  # type: ignore[misc]
    hints = get_type_hints(made, include_extras=True)
    taken = list(inspect.signature(made).parameters.values())[isinstance(function, type) :]  # without self
    variable = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    return {
        each.name: Parameter(hints.get(each.name, Any), each.default)
        for each in taken
        if each.kind not in variable
    }


class Checked:
    """A dataclass whose arguments are what its annotations say."""

    def __new__(cls, *_: object, **named: object) -> Self:
        for name in named:
            if name not in parameters(cls):
                raise TypeError(f"{unknown(name, parameters(cls))} ({cls.__name__})")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        """Check and convert all fields; TypeError or ValueError with the field's name."""
        made: Callable[..., object] = type(self)
        for name, kind in _fields(made).items():
            object.__setattr__(self, name, checked(name, getattr(self, name), kind))


@functools.cache
def _fields(kind: Callable[..., object]) -> dict[str, object]:
    hints = get_type_hints(kind, include_extras=True)
    return {each.name: hints[each.name] for each in dataclasses.fields(kind)}  # type: ignore[arg-type]


def checks_arguments(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Check the arguments of a function whose annotations say what they are; it checks the others itself.

    These are `Annotated` ones, and numbers, texts, words to choose from, and truth.
    """
    signature = inspect.signature(function)

    @functools.cache
    def kinds() -> dict[str, object]:  # at the first call: annotations may name what is imported later
        declared = parameters(function).items()
        return {name: each.kind for name, each in declared if _is_plain(each.kind)}

    @functools.wraps(function)
    def run(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        try:
            bound = signature.bind(*args, **kwargs)
        except TypeError:
            return function(*args, **kwargs)  # whose own error names the function
        for name, value in bound.arguments.items():
            if name in kinds():
                bound.arguments[name] = checked(name, value, kinds()[name])
        return function(*bound.args, **bound.kwargs)

    return run


def _is_plain(kind: object) -> bool:
    plain = (bool, int, float, str, NoneType)
    return about(kind) is not None or all(
        each in plain or get_origin(each) is Literal for each, _ in members(kind)
    )


def checked(name: str, value: Any, kind: object) -> Any:
    """Return `value` as an annotation has it; TypeError or ValueError with the argument's name otherwise.

    >>> checked("gloss", 1, Annotated[float, Interval(ge=0, le=1)])
    1.0
    """
    from pydantic import ValidationError

    for each in (value, *(value if isinstance(value, list | tuple) else ())):
        refuse_gradient(name, each)
    if getattr(value, "ndim", None) == 0 and isinstance(value.item(), int | float):  # of NumPy or torch
        value = value.item()
    try:
        return _adapter(kind).validate_python(value)
    except ValidationError as error:
        raise _refused(name, value, kind, error.errors(include_url=False)) from None
    except TypeError as error:  # of a check
        raise TypeError(f"{name}: {error}") from None


def checked_number(name: str, value: object, low: float = -math.inf, high: float = math.inf) -> float:
    """Return `value` as one finite float in [low, high]; TypeError or ValueError otherwise."""
    return checked(name, value, Annotated[float, Interval(ge=low, le=high)])


@functools.cache
def _adapter(kind: Annotation) -> "TypeAdapter[object]":
    from pydantic import ConfigDict, TypeAdapter

    rules = ConfigDict(strict=True, allow_inf_nan=False, arbitrary_types_allowed=True)
    return TypeAdapter(kind, config=rules)


def _refused(
    name: str, value: object, kind: object, problems: "list[ErrorDetails]"
) -> TypeError | ValueError:
    """Return the error of a value that pydantic refuses, in our words."""
    raised = [each["ctx"]["error"] for each in problems if each["type"] == "value_error"]
    if raised:
        return ValueError(f"{name}: {raised[0]}")
    near = next((word for each in problems if (word := meant(each["input"], _choices(kind)))), None)
    finite = any(each["type"] == "finite_number" for each in problems)
    expected = described(kind, finite)
    inner = problems[0]["input"] if len(problems) == 1 and problems[0]["loc"] else value  # of a tuple
    message = f"{name}: expected {expected}, got {shown(value if isinstance(inner, float | int) else inner)}"
    is_type = all(
        each["type"].endswith("_type")
        or each["type"] in ("none_required", "predicate_failed", "is_instance_of")
        or (each["type"] == "literal_error" and not isinstance(each["input"], str))
        for each in problems
    )
    return (TypeError if is_type else ValueError)(message + (f"; did you mean {near}?" if near else ""))


def _choices(kind: Annotation) -> list[object]:
    """Return the words among which an annotation lets one choose, also for each value of a tuple."""
    if get_origin(kind) is Literal:
        return list(get_args(kind))
    parts = [kind.__origin__] if get_origin(kind) is Annotated else get_args(kind)
    return [word for each in parts for word in _choices(each)]


def members(kind: Annotation, said: tuple[object, ...] = ()) -> Iterator[tuple[object, tuple[object, ...]]]:
    """Yield the types of a union, or the only one, each with what annotations say of it, outermost first."""
    if get_origin(kind) is Annotated:
        yield from members(kind.__origin__, (*said, *reversed(kind.__metadata__)))
    elif get_origin(kind) in (Union, UnionType):
        for each in get_args(kind):
            yield from members(each, said)
    else:
        yield kind, said


def about(kind: object) -> About | None:
    """Return what an annotation says of its argument, the outermost first; None without any."""
    said = [each for _, all_said in members(kind) for each in all_said if isinstance(each, About)]
    if not said:
        return None
    merged = said[0]
    for each in said[1:]:
        missing = {name: value for name, value in vars(each).items() if value and not getattr(merged, name)}
        merged = dataclasses.replace(merged, **missing)
    return merged


def limits(kind: object) -> tuple[float, float]:
    """Return the least and the greatest number that an annotation allows; infinities without limits."""
    said = [each for _, all_said in members(kind) for each in all_said]
    lows = [getattr(each, name, None) for each in said for name in ("ge", "gt")]
    highs = [getattr(each, name, None) for each in said for name in ("le", "lt")]
    return (
        max((each for each in lows if each is not None), default=-math.inf),
        min((each for each in highs if each is not None), default=math.inf),
    )


def described(kind: Annotation, finite: bool = False, unit: str = "", within: str = "") -> str:
    """Return what an annotation expects, in words."""
    if get_origin(kind) is Annotated:
        own = [each for each in reversed(kind.__metadata__) if isinstance(each, About)]
        if expected := next((each.expected for each in own if each.expected), ""):
            return expected
        unit = unit or next((each.unit for each in own if each.unit), "")
        return described(kind.__origin__, finite, unit, within or _range(kind))
    if get_origin(kind) in (Union, UnionType):
        kinds = [each for each in get_args(kind) if each is not NoneType]
        return " or ".join(dict.fromkeys(described(each, finite, unit, within) for each in kinds))
    if get_origin(kind) is Literal:
        return f"one of {', '.join(map(str, get_args(kind)))}"
    if get_origin(kind) is tuple and Ellipsis in get_args(kind):
        return f"several values, each {described(get_args(kind)[0], finite)}"
    if get_origin(kind) is tuple:
        each = get_args(kind)[0]
        number = "whole numbers" if each is int else "finite numbers" if finite else "numbers"
        return f"{len(get_args(kind))} {number}{f' of {unit}' if unit else ''}{_range(each)}"
    if kind in (int, float):
        number = "a whole number" if kind is int else "a finite number" if finite else "a number"
        return f"{number}{f' of {unit}' if unit else ''}{within}"
    return {bool: "True or False", str: "a text"}.get(kind) or kind.__name__


def _range(kind: object) -> str:
    low, high = limits(kind)
    above = any(getattr(each, "gt", None) == low for _, said in members(kind) for each in said)
    if math.isinf(high):
        return "" if math.isinf(low) else f" above {low:g}" if above else f" of at least {low:g}"
    if math.isinf(low):
        return f" of at most {high:g}"
    return f" above {low:g}, up to {high:g}" if above else f" from {low:g} to {high:g}"


def shown(value: object) -> str:
    """Return a value as an error shows it: short, on one line."""
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return f"{type(value).__name__} of shape {tuple(value.shape)}"
    if not isinstance(value, str | bytes | int | float | complex | tuple | list | dict | set | NoneType):
        return type(value).__name__
    try:
        text = " ".join(reprlib.repr(value).split())
    except ValueError:  # an integer of thousands of digits
        return type(value).__name__
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."


def unknown(name: object, known: Iterable[str]) -> str:
    """Return the error of a name that is not known: the one that is meant, or all that there are."""
    known = list(known)
    near = meant(name, known)
    text = name if isinstance(name, str) and name.isprintable() and len(name) <= MOST_SHOWN else shown(name)
    return f"{text}: not known; " + (f"did you mean {near}?" if near else f"expected {', '.join(known)}")


def meant(word: object, known: Iterable[object]) -> str | None:
    """Return the word that is probably meant; None for none.

    >>> meant("color", ["colour", "cone"]), meant("az", ["azimuth", "angle"]), meant("speed", ["colour"])
    ('colour', 'azimuth', None)
    """
    if not isinstance(word, str) or len(word) > MOST_SHOWN:
        return None
    plain = {each.lower().replace("-", "_"): each for each in known if isinstance(each, str)}
    wanted = word.strip().lower().replace("-", "_").replace(" ", "_")
    begun = [each for each in plain if wanted and each.startswith(wanted)]
    near = begun if len(begun) == 1 else difflib.get_close_matches(wanted, plain, 1, MIN_SIMILARITY)
    return plain[near[0]] if near else None


def read(name: str, text: str, kind: object) -> object:
    """Return what `checked` takes of a text: `2`, `5600K`, `1/0.9/0.8`, `key`; ValueError if it is no number.

    >>> read("position", "-1/0.5/2", tuple[float, float, float])
    (-1.0, 0.5, 2.0)
    """
    said = about(kind)
    kinds = [each for each, _ in members(kind)]
    if said is not None and said.parse is not None:
        return text
    if any(get_origin(each) is tuple for each in kinds):
        return tuple(_number(name, word, kind) for word in text.split("/"))
    if int in kinds:
        number = _number(name, text, kind)
        return int(number) if number.is_integer() else number
    return _number(name, text, kind) if float in kinds else text


def read_settings(settings: Iterable[str], known: Mapping[str, Parameter]) -> dict[str, Any]:
    """Return arguments that texts `parameter=value` state, see `read`; ValueError for other texts."""
    arguments: dict[str, Any] = {}
    for setting in settings:
        key, equals, value = (part.strip() for part in setting.partition("="))
        if equals and key not in known:
            raise ValueError(unknown(key, known))
        if not equals or key in arguments:
            problem = "twice" if equals else "not understood"
            expected = f"expected parameter=value,... with {', '.join(known)}"
            hint = f"did you mean {near}?" if (near := _named_by(key, known)) else expected
            raise ValueError(f"{setting!r} is {problem}; {hint}")
        near = _named_by(value, known)
        if near and value not in _words(known[key].kind):
            expected = described(known[key].kind)
            raise ValueError(f"{key}: expected {expected}, got {value!r}; did you mean {near}?")
        arguments[key] = read(key, value, known[key].kind)
    return arguments


def _named_by(word: str, known: Mapping[str, Parameter]) -> str | None:
    """Return the setting, such as azimuth=left, whose word this is; None for no such word."""
    return next((f"{name}={word}" for name, each in known.items() if word in _words(each.kind)), None)


def _words(kind: object) -> dict[str, float]:
    """Return the words that stand for numbers of an annotation."""
    said = about(kind)
    return dict(said.words) if said else {}


def _number(name: str, text: str, kind: object) -> float:
    said, bare, words = about(kind), text.strip(), _words(kind)
    if bare.lower() in words:
        return words[bare.lower()]
    for suffix in SUFFIXES.get(said.unit if said else "", ()):
        if bare.endswith(suffix):
            bare = bare.removesuffix(suffix)
            break
    try:
        return float(bare)
    except ValueError as error:
        expected = " or ".join([described(kind), *([", ".join(words)] if words else [])])
        hint = f"; did you mean {near}?" if (near := meant(bare, words)) else ""
        raise ValueError(f"{name}: expected {expected}, got {text!r}{hint}") from error
