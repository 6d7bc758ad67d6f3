"""`python -m helpers.small_app app`: the application, whose worker has the networks on a small canvas."""

from relight.cli.__main__ import main

if __name__ == "__main__":
    main()
else:  # the worker, a process of its own that begins by importing this module too
    import helpers.small_worker  # noqa: F401
