"""The command line. Each command parses text and calls one public function.

Heavy modules are imported inside the commands, so that `relight --help` answers at once.
"""

INTERRUPTED = 130  # the exit status of a program that Ctrl C ends, as shells have it
