"""Errors that callers may want to tell apart. Each is also an error of Python's, so that older handlers work.

>>> import relight
>>> from relight.errors import RelightError
>>> try:
...     relight.Subject.load("pyproject.toml")
... except RelightError as error:
...     print(type(error).__name__)
DamagedFileError
"""

from shadow.errors import EmptyMatteError, RelightError

__all__ = [
    "DamagedFileError",
    "EmptyMatteError",
    "MissingFramesError",
    "MissingNetworksError",
    "RelightError",
    "StaleAnalysisError",
    "UnsupportedFileError",
]


class DamagedFileError(RelightError, ValueError):
    """A file is truncated, damaged or inconsistent, or is not of the kind that its name claims."""


class UnsupportedFileError(RelightError, ValueError):
    """A file is intact but holds what this version does not read, or it is not a regular file."""


class StaleAnalysisError(RelightError, ValueError):
    """An analysis does not fit its plate, its options or this version any more: analyse the plate again."""


class MissingFramesError(RelightError, FileNotFoundError):
    """Frames of a sequence are missing on disk."""


class MissingNetworksError(RelightError, ImportError):
    """The networks that find a person have not been fetched; the message names the command that does it."""
