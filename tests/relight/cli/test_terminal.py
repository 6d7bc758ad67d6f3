"""What stands in names is printed, and a terminal obeys none of it."""

import subprocess
import sys

import pytest

from relight.cli import printable
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


@pytest.mark.parametrize("command", ["apply", pytest.param("analyse", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", [HOSTILE[0], pytest.param(HOSTILE[1], marks=pytest.mark.slow)])
def test_errors_and_warnings_of_a_command_are_escaped(tmp_path, command, name):
    (tmp_path / name).write_bytes(b"no picture")
    out = {"apply": ["-o", "o.exr", "--light", "azimuth=3"], "analyse": ["-o", "o.relight"]}[command]
    words = [sys.executable, "-m", "relight.cli", command, name, *out]
    ran = subprocess.run(words, capture_output=True, cwd=tmp_path)
    assert ran.returncode in (1, 2)
    assert printable(name).encode() in ran.stderr
    assert not any(byte in ran.stderr for byte in (b"\x1b", b"\x07", b"\r"))
