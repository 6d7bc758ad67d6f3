"""The help of a command can be read: options in groups, wide columns, examples at the end."""

import re

import pytest
from typer.testing import CliRunner

from relight.cli import app
from relight.cli.options import PANELS

WIDTH, LEAST = 100, 40


def shown(command, monkeypatch):
    monkeypatch.setenv("TERMINAL_WIDTH", str(WIDTH))
    monkeypatch.setenv("COLUMNS", str(WIDTH))
    return CliRunner().invoke(app, [command, "--help"]).output


@pytest.mark.parametrize(
    "command", ["apply", "view", "analyse", "export", "olat", "job", "app", "stage", "train"]
)
def test_no_column_is_narrow(command, monkeypatch):
    continued = [
        len(line) - len(line[1:].lstrip()) - 1
        for line in shown(command, monkeypatch).splitlines()
        if re.match(r"│ {10,}\S", line)
    ]
    assert WIDTH - max(continued) - 2 >= LEAST


def test_options_stand_in_groups_and_examples_at_the_end(monkeypatch):
    text = shown("apply", monkeypatch)
    titles = re.findall(r"╭─ ([\w ]+?) ─", text)
    assert titles == ["Arguments", "Options", *PANELS]
    examples = text[text.rindex("╰") :]
    assert examples.count("relight apply") == 3
    assert "--preset golden-hour -o out.jpg" in examples
