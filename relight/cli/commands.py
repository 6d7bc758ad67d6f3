"""All commands under one name, `relight`."""

import os
import warnings
from pathlib import Path
from typing import Annotated, Any

import typer

from relight.cli import end_interrupted, in_options, printable
from relight.cli.analyse import analyse
from relight.cli.app import app as app_command
from relight.cli.apply import apply
from relight.cli.comfyui import comfyui
from relight.cli.evaluation import evaluate
from relight.cli.export import export
from relight.cli.fetch import fetch
from relight.cli.help import PlainCommand, PlainGroup, described
from relight.cli.job import job
from relight.cli.olat import olat
from relight.cli.presets import presets
from relight.cli.stage import stage
from relight.cli.track import track
from relight.cli.training import shrink, train
from relight.cli.view import view
from relight.version import __version__

EXTRAS = {  # of modules that only some commands need
    "anny": "stage", "embreex": "stage", "numba": "stage", "trimesh": "stage",
    "kornia": "train", "matplotlib": "train",
}  # fmt: skip
APP_WORDS = ("browser", "gui", "open", "server", "start", "ui", "web")  # that people try for the application


class _OneLineErrors(PlainGroup):
    """Bad input is one line and exit code 2, a warning one line. Anything else is a bug with its trace."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and args[0] not in self.commands and (hint := _hint(args[0])):
            typer.echo(printable(f"relight: {args[0]} is no command; {hint}"), err=True)
            raise typer.Exit(2)
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        before = warnings.formatwarning
        warnings.formatwarning = self._one_line
        try:
            return super().invoke(ctx)
        except (ImportError, OSError, TypeError, ValueError) as error:
            message = " ".join(str(error).split())
            if isinstance(error, ModuleNotFoundError) and (extra := EXTRAS.get(error.name or "")):
                from shadow.installing import install_command  # with torch, which --help does without

                message = f"needs {error.name}; install it with: {install_command(extra)}"
            typer.echo(printable(f"relight: {in_options(message, self._options)}"), err=True)
            raise typer.Exit(2) from error
        except MemoryError as error:
            typer.echo(f"relight: not enough memory: {error}", err=True)
            raise typer.Exit(2) from error
        except KeyboardInterrupt:
            end_interrupted()
        finally:
            warnings.formatwarning = before

    @property
    def _options(self) -> set[str]:
        """Return the names of all options of all commands, as the library has them."""
        commands = [self.commands[name] for name in self.commands]
        return {each.name or "" for command in commands for each in command.params}

    def _one_line(self, message: Warning | str, *place: object, **line: object) -> str:
        """Return a warning without the place in the source, which tells a user nothing."""
        said = in_options(" ".join(str(message).split()), self._options)
        return printable(f"relight: warning: {said}\n")


def _hint(word: str) -> str | None:
    """Return what to type instead of a word that is no command; None where that is not known."""
    if word.lower() in APP_WORDS:
        return "the application opens by: relight app"
    if Path(word).suffix or os.path.exists(word):
        return f"to relight a picture: relight apply {word} --preset golden-hour -o out.jpg; or: relight app"
    return None


app = typer.Typer(cls=_OneLineErrors, no_args_is_help=True, pretty_exceptions_enable=False)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"relight {__version__}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Relight a photographed person, light by light, in scene-linear colour."""


# The order of the help: for pictures and movies, for other programs, for networks of one's own.
PANELS = {
    "Pictures and movies": (apply, app_command, view, presets, fetch),
    "Shots and other programs": (analyse, track, export, olat, job, comfyui),
    "Networks of your own": (stage, train, evaluate, shrink),
}

for panel, commands in PANELS.items():
    for command in commands:
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=command.info.name, rich_help_panel=panel)
        else:
            add = app.command(cls=PlainCommand, help=described(command), rich_help_panel=panel)
            add(command)
app.command("video", cls=PlainCommand, help="The same as `relight apply`.", hidden=True)(apply)
