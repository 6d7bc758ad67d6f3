"""The command line. Each command parses text and calls one public function.

Heavy modules are imported inside the commands, so that `relight --help` answers at once.
"""

import re
import sys
import unicodedata
from collections.abc import Set
from typing import NoReturn

OBEYED = ("Cc", "Cs", "Zl", "Zp")  # categories of Unicode: controls, halves of characters, line breaks
TURNING = "\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
INTERRUPTED = 130  # the exit status of a program that Ctrl C ends, as shells have it


def printable(text: str) -> str:
    """Return a text as a terminal may print it: what it would obey, such as ESC and BEL, is escaped.

    Names of files, layers and lights come from anywhere. Marks that turn the direction of writing, and bytes
    that are no UTF-8, are escaped too. Line breaks stay.
    """
    return "".join(
        character.encode("unicode_escape", "surrogatepass").decode()
        if character != "\n" and (unicodedata.category(character) in OBEYED or character in TURNING)
        else character
        for character in text
    )


def in_options(message: str, known: Set[str]) -> str:
    """Return an error's message with the command's options for the library's arguments, of which `known` are.

    >>> known = {"mask", "allow_external", "preset", "light"}
    >>> in_options("give the matte (mask=FILE)", known), in_options("allow it (allow_external=True)", known)
    ('give the matte (--mask FILE)', 'allow it (--allow-external)')
    >>> in_options("expected one (preset or light)", known)
    'expected one (--preset or --light)'
    """

    def option(match: re.Match[str]) -> str:
        if match[1] not in known:
            return match[0]
        value = match[2] or ""
        return f"--{match[1].replace('_', '-')}{'' if value == '=True' else value.replace('=', ' ', 1)}"

    def inside(match: re.Match[str]) -> str:
        words = re.split(", | or | and ", match[1])
        if len(words) > 1 and known >= {*words}:
            return re.sub(r"([a-z_]+)()", option, match[0])
        return re.sub(r"([a-z_]+)(=[^\s,)]+)", option, match[0])

    return re.sub(r"\(([^()]*)\)", inside, message)


def end_interrupted() -> NoReturn:
    """Say in one line that Ctrl C ended the program, and end it."""
    print("relight: interrupted", file=sys.stderr)
    sys.exit(INTERRUPTED)
