"""The command line. Each command parses text and calls one public function.

Heavy modules are imported inside the commands, so that `relight --help` answers at once.
"""

import sys
from typing import NoReturn

INTERRUPTED = 130  # the exit status of a program that Ctrl C ends, as shells have it


def end_interrupted() -> NoReturn:
    """Say in one line that Ctrl C ended the program, and end it."""
    print("relight: interrupted", file=sys.stderr)
    sys.exit(INTERRUPTED)
