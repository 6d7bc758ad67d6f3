"""Files that are read: a device or a pipe, which would never end, is refused, and errors name the file."""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from relight.errors import UnsupportedFileError


def check_regular_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of a file that can be read to its end.

    Raises FileNotFoundError, and UnsupportedFileError for a device, a pipe, a socket or a folder.

    >>> check_regular_file("pyproject.toml").name
    'pyproject.toml'
    """
    path = Path(path)
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise FileNotFoundError(f"{path}: no such file") from error
    if not stat.S_ISREG(mode):
        raise UnsupportedFileError(f"{path}: is no regular file")
    return path


@contextmanager
def naming(path: str | os.PathLike[str]) -> Iterator[None]:
    """Begin the message of each ValueError with the file's name, unless it does."""
    try:
        yield
    except ValueError as error:
        if str(error).startswith(str(path)):
            raise
        raise ValueError(f"{path}: {error}") from error
