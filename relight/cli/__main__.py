"""The program `relight`, also as `python -m relight.cli` and as `torchrun -m` starts it."""

from relight.cli import end_interrupted


def main() -> None:
    """Run a command. Ctrl C is one line, also while the modules of the commands load."""
    try:
        from relight.cli.commands import app

        app()
    except KeyboardInterrupt:
        end_interrupted()


if __name__ == "__main__":
    main()
