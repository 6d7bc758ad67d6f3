"""Pictures from and to file objects, such as the uploads of a service: by way of a temporary file."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from typing_extensions import TypeIs

NAME = "stream"  # what errors call it
STARTS = {b"\x76\x2f\x31\x01": ".exr", b"#?": ".hdr"}  # formats that OpenImageIO tells by the suffix too


def is_stream(value: object) -> "TypeIs[BinaryIO]":
    """Return whether a value is a file object that is read or written."""
    return hasattr(value, "read") or hasattr(value, "write")


@contextmanager
def as_file(stream: BinaryIO) -> Iterator[Path]:
    """Give a file with the rest of a stream; ValueErrors of the block call it by `NAME`.

    Raises TypeError for a stream of text.
    """
    content = stream.read()
    if not isinstance(content, bytes | bytearray | memoryview):
        raise TypeError(f"path: expected a stream of bytes, got one of {type(content).__name__}")
    content = bytes(content)
    suffix = next((suffix for start, suffix in STARTS.items() if content.startswith(start)), "")
    with _named(suffix) as path:
        path.write_bytes(content)
        yield path


@contextmanager
def to_stream(stream: BinaryIO, suffix: str) -> Iterator[Path]:
    """Give a file of a suffix to write, whose content goes to a stream when the block ends."""
    with _named(suffix) as path:
        yield path
        stream.write(path.read_bytes())


@contextmanager
def _named(suffix: str) -> Iterator[Path]:
    """Give the path of a temporary file, which ValueErrors of the block call by `NAME`."""
    with tempfile.TemporaryDirectory(prefix="relight-") as folder:
        path = Path(folder) / f"{NAME}{suffix}"
        try:
            yield path
        except ValueError as error:
            raise type(error)(str(error).replace(str(path), NAME)) from error
