"""The help of a command can be read: options in groups, wide columns, examples at the end."""

import functools
import re
import shlex

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import relight
from relight.arguments import parameters
from relight.cli.commands import app
from relight.cli.help import EXAMPLES, SHOT, STAGE, TRAIN

LEAST = {100: 40, 80: 20}  # characters of the narrowest column, by those of the terminal
COMMANDS = ("apply", "view", "analyse", "export", "olat", "job", "app", "stage", "train", "evaluate tables")
GROUPED = {"apply": SHOT, "stage": STAGE, "train": TRAIN}


@functools.cache
def shown(command, width=100):
    return CliRunner(env={"COLUMNS": str(width)}).invoke(app, [*command.split(), "--help"]).output


@pytest.mark.parametrize("width", LEAST)
@pytest.mark.parametrize("command", COMMANDS)
def test_no_column_is_narrow_and_no_text_is_cut(command, width):
    text = shown(command, width)
    continued = [
        len(line) - len(line[1:].lstrip()) - 1 for line in text.splitlines() if re.match(r"│ {10,}\S", line)
    ]
    assert width - max(continued, default=0) - 2 >= LEAST[width]
    assert "…" not in text


@pytest.mark.parametrize("command", GROUPED)
def test_options_stand_in_groups(command):
    text = shown(command)
    titles = re.findall(r"╭─ ([\w ]+?) ─", text)
    assert titles == ["Arguments", *GROUPED[command]]  # all options are in a group


def test_the_overview_is_one_screen_with_the_commands_of_users_first():
    text = shown("")
    assert len(text.splitlines()) <= 45
    commands = re.findall(r"^│ (\w+) ", text, re.MULTILINE)
    assert commands[:4] == ["apply", "app", "view", "presets"]
    assert set(commands[-4:]) == {"stage", "train", "evaluate", "shrink"}


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_flags_have_no_type(command):
    assert "bool" not in shown(command)


def test_ten_options_stand_first():
    text = shown("apply")
    first = text[text.index("What most people need") : text.index("╭─ Person")]
    assert len(re.findall(r"^│ [* ]? *--", first, re.MULTILINE)) == 10


def test_what_stands_in_brackets_is_shown():
    """Brackets are markup, which would swallow it."""
    text = " ".join(shown("train").replace("│", " ").split())
    assert "(field: 20; per-light: 4; paper: 1)" in text


@pytest.mark.parametrize("command", EXAMPLES)
def test_three_examples_at_the_beginning_are_understood(command):
    text = shown(command)
    assert text[: text.index("╭")].count(f"relight {command}") >= 2
    examples = EXAMPLES[command].split("\n\n")
    assert len(examples) == 3
    for example in examples:
        words = shlex.split(example.split(": ", 1)[1])
        assert words[0] == "relight"
        found, rest = get_command(app), words[1:]
        while hasattr(found, "commands"):
            found, rest = found.commands[rest[0]], rest[1:]
        found.make_context(found.name, rest)


def test_the_shortest_command_stands_in_the_help():
    assert "--preset golden-hour -o out.jpg" in shown("apply")


def test_the_help_of_apply_names_every_parameter_of_its_lights():
    """It is no table of theirs: that would import torch, and take seconds."""
    words = set(re.findall(r"\w+", shown("apply", 300)))
    for light in (relight.DirectionalLight, relight.PointLight, relight.RectLight):
        assert parameters(light).keys() - {"name"} <= words, light
