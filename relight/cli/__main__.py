"""The program `relight`, also as `python -m relight.cli` and as `torchrun -m` starts it."""

import gc

from relight.cli import end_interrupted

COLLECTION_THRESHOLD = 20_000  # new objects, instead of Python's 700, between searches for garbage


def main() -> None:
    """Run a command. Ctrl C is one line, also while the modules of the commands load."""
    # The 200,000 objects of the modules live on. Searching them again and again takes 0.2 s of a still.
    gc.set_threshold(COLLECTION_THRESHOLD)
    try:
        from relight.cli.commands import app

        app()
    except KeyboardInterrupt:
        end_interrupted()
    finally:
        gc.disable()  # Python would search them once more, just before it deletes the modules


if __name__ == "__main__":
    main()
