"""The program `relight`, also as `python -m relight.cli` and as `torchrun -m` starts it."""

import sys

from relight.cli import INTERRUPTED


def main() -> None:
    """Run a command. Ctrl C is one line, also while the modules of the commands load."""
    try:
        from relight.cli.commands import app

        app()
    except KeyboardInterrupt:
        print("relight: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
