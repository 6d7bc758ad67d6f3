"""The options that commands share, generated from the dataclasses of `relight.pipeline.options`."""

import inspect
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, wraps
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, cast, get_args, get_origin, get_type_hints

import typer
from rich.console import Console

from relight.arguments import About, Annotation, about, members, parameters, read, shown
from relight.cli import INTERRUPTED, printable
from relight.cli.help import SHOT, Panels, grouped
from relight.pipeline.option_fields import Options, from_json
from relight.pipeline.options import GROUPS

WIDEST = 17  # characters of the words to choose from, or their column would be wider than the help


class _Console(Console):
    """A terminal that obeys nothing that stands in a name."""

    def print(self, *objects: object, **options: Any) -> None:
        super().print(*(printable(each) if isinstance(each, str) else each for each in objects), **options)


console = _Console(stderr=True, markup=False, highlight=False)

Frames = Annotated[
    str | None,
    typer.Option(
        help="1-100, 1-100x2, 1-10,20,30-40, or timecodes such as 01:00:04:12. Default: the source's, "
        "or from the first to the last keyframe of the lights."
    ),
]
Frame = Annotated[
    int | None, typer.Option(help="Frame of a sequence, movie or analysis cache. Default: the first.")
]
OptionsFile = Annotated[
    Path | None,
    typer.Option(
        "--options",
        help="Further options from a JSON file, as `relight job` writes it; the command line takes "
        "precedence.",
    ),
]


def with_options(panels: Panels = SHOT, **subsets: tuple[str, ...]) -> Callable[[Callable], Callable]:
    """Give a command the fields of the option classes that its parameters are annotated with.

    Each parameter such as `lighting: Lighting` is replaced by the fields of its class on the command line,
    and gets them as one object. `panels`: of the help. `subsets` names the fields of a class that a command
    takes, where not all.
    """

    def decorate(command: Callable) -> Callable:
        hints, own = get_type_hints(command, include_extras=True), inspect.signature(command)
        groups = {
            name: [each for each in options_of(kind) if each.name in subsets.get(name, (each.name,))]
            for name, kind in GROUPS.items()
            if hints.get(name) is kind
        }
        taken = []
        for parameter in own.parameters.values():
            if parameter.name in groups:
                taken += [each.parameter() for each in groups[parameter.name]]
            else:
                taken.append(
                    parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[parameter.name])
                )
        if "context" not in own.parameters:
            keyword = inspect.Parameter.KEYWORD_ONLY
            taken.append(inspect.Parameter("context", keyword, annotation=typer.Context))

        @wraps(command)
        def run(**arguments: Any) -> object:
            context = arguments["context"]
            stored = _stored(arguments.get("options_file"))
            for name, chosen in groups.items():
                values = {each.name: arguments.pop(each.name) for each in chosen}
                arguments[name] = _build(GROUPS[name], chosen, values, context, stored.get(name, {}))
            return command(**{name: value for name, value in arguments.items() if name in own.parameters})

        taken = grouped(taken, panels)
        run.__signature__ = own.replace(parameters=taken)  # type: ignore[attr-defined]  # for typer
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in taken}
        return run

    return decorate


def given_words(context: typer.Context, options: type[Options]) -> list[str]:
    """Return the words of a command line that set the fields of an option class, apart from its argument."""
    words = []
    for each in options_of(cast(Callable[..., object], options)):
        if not each.is_argument and is_given(context, each.name):
            value = context.params[each.name]
            name = each.flags[0]
            if isinstance(value, bool):
                words.append(name if value else f"--no-{name[2:]}")
            else:
                words += [name, str(value)]
    return words


def is_given(context: typer.Context, name: str) -> bool:
    """Return whether an option is on the command line."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


@contextmanager
def progress_bars(interrupted: str = "") -> Iterator[Callable[[int, int | None, str], None]]:
    """Show the steps of a run, one bar for each kind of step; nothing before the first step.

    A total of None is not known. `interrupted`: what Ctrl C prints, where the run can be continued.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    progress = Progress(*columns, console=console)
    tasks: dict[str, TaskID] = {}

    def report(done: int, total: int | None, what: str) -> None:
        progress.start()
        if what not in tasks:
            tasks[what] = progress.add_task(printable(what), total=total)
        progress.update(tasks[what], completed=done, total=total)

    try:
        yield report
    except KeyboardInterrupt as interruption:
        if not interrupted:
            raise
        console.print(f"interrupted; {interrupted}")
        raise typer.Exit(INTERRUPTED) from interruption
    finally:
        if tasks:
            progress.stop()


def print_written(path: Path) -> None:
    """Print the name of a written file to standard output, as bytes where the system has it so."""
    if sys.stdout.isatty():
        typer.echo(printable(str(path)))
    else:
        typer.echo(os.fsencode(path) if os.name == "posix" else str(path))


def report_failures(problems: Mapping[int, str], outputs: Iterable[Path]) -> None:
    """Print which frames could not be made, and what was written; exit with code 1 if there are any."""
    for number, problem in problems.items():
        console.print(f"frame {number}: {problem}")
    for path in outputs:
        print_written(path)
    if problems:
        raise typer.Exit(1)


class Option(NamedTuple):
    """A field of an option class as the command line has it, where what is no flag is a text."""

    name: str
    kind: object
    default: object
    about: About

    @property
    def is_flag(self) -> bool:
        return self.kind_without_range is bool

    @property
    def kind_without_range(self) -> Annotation:
        return next(kind for kind, _ in members(self.kind))

    @property
    def is_argument(self) -> bool:
        return self.default is inspect.Parameter.empty and not self.about.repeatable

    @property
    def flags(self) -> tuple[str, ...]:
        """The names of the option."""
        name = self.name.replace("_", "-")
        return self.about.flags or ((f"--{name}", f"--no-{name}") if self.is_flag else (f"--{name}",))

    @property
    def metavar(self) -> str | None:
        """What stands for the value in the help."""
        kind = self.kind_without_range
        if get_origin(kind) is Literal:
            words = f"[{'|'.join(get_args(kind))}]"
            return words if len(words) <= WIDEST else "<word>"
        number = {int: "<integer>", float: "<float>"}.get(kind)
        return self.about.metavar or (None if self.about.parse else number)

    def parameter(self) -> inspect.Parameter:
        """Return the parameter of a command."""
        about, keyword = self.about, inspect.Parameter.KEYWORD_ONLY
        if self.is_argument:
            argument = typer.Argument(help=about.help, metavar=about.metavar)
            return inspect.Parameter(self.name, keyword, annotation=Annotated[str, argument])
        text: Annotation = bool if self.is_flag else list[str] if about.repeatable else str
        flags = ("/".join(self.flags),) if self.is_flag and not about.flags else self.flags
        option = typer.Option(*flags, help=about.help, metavar=self.metavar)
        if self.default is inspect.Parameter.empty:
            needed: Annotation = Annotated[text, option]
            return inspect.Parameter(self.name, keyword, annotation=needed)
        default: object = None
        if isinstance(self.default, bool | int | float | str):
            default = self.default if self.is_flag else f"{self.default}"
        taken: Annotation = text if default is not None else text | None
        annotation = Annotated[taken, option]
        return inspect.Parameter(self.name, keyword, default=default, annotation=annotation)

    def value(self, given: object) -> object:
        """Return what the option class takes of what the command line gives."""
        return read(self.name, given, self.kind) if isinstance(given, str) else given


@cache
def options_of(kind: Callable[..., object]) -> tuple[Option, ...]:
    """Return the options of a class."""
    return tuple(
        Option(name, each.kind, each.default, about(each.kind) or About())
        for name, each in parameters(kind).items()
    )


def _build(
    kind: type[Options],
    chosen: Iterable[Option],
    values: Mapping[str, object],
    context: typer.Context,
    stored: Mapping[str, object],
) -> Options:
    """Build an object of an option class from the command line, then stored options, then defaults."""
    known = dict(stored)
    for each in chosen:
        if each.default is inspect.Parameter.empty or is_given(context, each.name):
            known[each.name] = each.value(values[each.name])
    return from_json(kind, known)


def _stored(path: Path | None) -> dict[str, dict[str, object]]:
    """Read the groups of options in a JSON file."""
    if path is None:
        return {}
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"))  # with or without its mark
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{path}: no such file") from error
    except (RecursionError, ValueError) as error:
        raise ValueError(f"{path}: expected JSON, as `relight job` writes it: {error}") from error
    if not isinstance(document, dict) or not set(document) <= set(GROUPS):
        raise ValueError(f"{path}: expected an object of {', '.join(GROUPS)}")
    for name, stored in document.items():
        if not isinstance(stored, dict):
            raise ValueError(f"{path}: {name}: expected an object of options, got {shown(stored)}")
    return document
