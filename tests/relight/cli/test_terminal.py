"""What stands in names is printed, and a terminal obeys none of it."""

import pytest
from typer.testing import CliRunner

from relight.cli import printable
from relight.cli.commands import app
from relight.cli.options import console

HOSTILE = ("a\x1b]0;owned\x07.png", "b\x1b[2J.png", "c\r.png", "d\x9bm.png", "e\u202egpj.png", "f\u2028.png")


@pytest.mark.parametrize("name", HOSTILE)
def test_controls_are_escaped(name):
    shown = printable(name)
    assert shown.isprintable()
    assert shown == name.encode("unicode_escape").decode()


@pytest.mark.parametrize("text", ["Zoë.png", "写真 1.png", "👩‍🎨.png", "two\nlines", "a b.png"])
def test_other_text_stays(text):
    assert printable(text) == text


@pytest.mark.parametrize("name", HOSTILE)
def test_progress_and_failures_are_escaped(name, capsys):
    console.print(f"frame 1: {name}: no such file", soft_wrap=True)
    assert printable(name) in capsys.readouterr().err


@pytest.mark.parametrize("command", ["apply", "analyse"])
@pytest.mark.parametrize("name", HOSTILE)
def test_errors_of_a_command_are_escaped(here, command, name):
    (here / name).write_bytes(b"no picture")
    out = {"apply": ["-o", "o.exr", "--light", "azimuth=3"], "analyse": ["-o", "o.relight"]}[command]
    ran = CliRunner().invoke(app, [command, name, *out])
    assert ran.exit_code in (1, 2)
    (said,) = ran.stderr.splitlines()
    assert said.isprintable()
    assert printable(" ".join(name.split())) in said  # a line break is a space
