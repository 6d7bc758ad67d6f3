"""The options that commands share, generated from the dataclasses of `relight.pipeline.options`."""

import inspect
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, Field, fields
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from relight.cli import INTERRUPTED, printable
from relight.cli.help import SHOT, Panels, grouped
from relight.pipeline.option_fields import Options, from_json
from relight.pipeline.options import GROUPS


class _Console(Console):
    """A terminal that obeys nothing that stands in a name."""

    def print(self, *objects: Any, **options: Any) -> None:
        super().print(*(printable(each) if isinstance(each, str) else each for each in objects), **options)


console = _Console(stderr=True, markup=False, highlight=False)

Frames = Annotated[
    str | None,
    typer.Option(
        help="1-100, 1-100x2 or 1-10,20,30-40. Default: the source's, or from the first to the last keyframe "
        "of the lights."
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
            name: [each for each in fields(kind) if each.name in subsets.get(name, (each.name,))]
            for name, kind in GROUPS.items()
            if hints.get(name) is kind
        }
        parameters = []
        for parameter in own.parameters.values():
            if parameter.name in groups:
                parameters += [_parameter(each) for each in groups[parameter.name]]
            else:
                parameters.append(
                    parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[parameter.name])
                )
        if "context" not in own.parameters:
            keyword = inspect.Parameter.KEYWORD_ONLY
            parameters.append(inspect.Parameter("context", keyword, annotation=typer.Context))

        @wraps(command)
        def run(**arguments: Any) -> Any:
            context = arguments["context"]
            stored = _stored(arguments.get("options_file"))
            for name, chosen in groups.items():
                values = {each.name: arguments.pop(each.name) for each in chosen}
                arguments[name] = _build(GROUPS[name], chosen, values, context, stored.get(name, {}))
            return command(**{name: value for name, value in arguments.items() if name in own.parameters})

        parameters = grouped(parameters, panels)
        run.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]  # for typer
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return run

    return decorate


def given_words(context: typer.Context, options: type[Options]) -> list[str]:
    """Return the words of a command line that set the fields of an option class, apart from its argument."""
    words = []
    for each in fields(options):  # type: ignore[arg-type]
        if each.default is not MISSING and is_given(context, each.name):
            value = context.params[each.name]
            name = _flags(each)[0]
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
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    progress = Progress(*columns, console=console)
    tasks: dict[str, Any] = {}

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


def _flags(each: Field) -> tuple[str, ...]:
    """Return the option names of a field."""
    name = each.name.replace("_", "-")
    if each.metadata["flags"]:
        return each.metadata["flags"]
    return (f"--{name}", f"--no-{name}") if each.metadata["text"] is bool else (f"--{name}",)


def _parameter(each: Field) -> inspect.Parameter:
    """Return the parameter of a command for a field."""
    kind, about = each.metadata["text"], each.metadata
    keyword = inspect.Parameter.KEYWORD_ONLY
    if each.default is MISSING and kind is str:
        annotation: Any = Annotated[str, typer.Argument(help=about["help"], **about["limits"])]
        return inspect.Parameter(each.name, keyword, annotation=annotation)
    flags = ("/".join(_flags(each)),) if kind is bool and not about["flags"] else _flags(each)
    option = typer.Option(*flags, help=about["help"], **about["limits"])
    if each.default is MISSING:
        return inspect.Parameter(each.name, keyword, annotation=Annotated[kind, option])
    shown = each.default if isinstance(each.default, bool | int | float | str) else None
    annotation = Annotated[kind if shown is not None else kind | None, option]
    return inspect.Parameter(each.name, keyword, default=shown, annotation=annotation)


def _build(
    kind: type[Options],
    chosen: Iterable[Field],
    values: Mapping[str, Any],
    context: typer.Context,
    stored: Mapping[str, Any],
) -> Options:
    """Build an object of an option class from the command line, then stored options, then defaults."""
    known: dict[str, Any] = dict(stored)
    for each in chosen:
        value, parse = values[each.name], each.metadata["parse"]
        if each.default is not MISSING and not is_given(context, each.name):
            continue
        known[each.name] = value if parse is None or value is None else parse(value)
    return from_json(kind, known)


def _stored(path: Path | None) -> dict[str, Any]:
    """Read the groups of options in a JSON file."""
    if path is None:
        return {}
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"))  # with or without its mark
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{path}: no such file") from error
    except (UnicodeDecodeError, ValueError) as error:
        raise ValueError(f"{path}: expected JSON, as `relight job` writes it: {error}") from error
    if not isinstance(document, dict) or not set(document) <= set(GROUPS):
        raise ValueError(f"{path}: expected an object of {', '.join(GROUPS)}")
    return document
