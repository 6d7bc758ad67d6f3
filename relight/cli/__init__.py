"""The command line. Each command parses text and calls one public function.

Heavy modules are imported inside the commands, so that `relight --help` answers at once.
"""

import sys
import unicodedata
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


def end_interrupted() -> NoReturn:
    """Say in one line that Ctrl C ended the program, and end it."""
    print("relight: interrupted", file=sys.stderr)
    sys.exit(INTERRUPTED)
