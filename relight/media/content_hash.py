"""What a picture is made of, as a short text: a resumed run tells by it which frames are still right.

A picture's file carries it as EXIF's ImageUniqueID, a movie as its comment.
"""

import dataclasses
import enum
import functools
import hashlib
import numbers
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

if TYPE_CHECKING:
    import OpenImageIO as oiio

# Size and channels of an OpenEXR file: a program that changes them keeps HASH_ATTRIBUTE.
CONTENTS_ATTRIBUTE = "relight:holds"
HASH_ATTRIBUTE = "Exif:ImageUniqueID"  # EXIF 2.32, section 4.6.6 G: 128 bits as 32 hexadecimal digits


def content_hash(*parts: object) -> str:
    """Return the first 32 hexadecimal digits of the SHA-256 of `parts`.

    A part is None, a number, a text, an array, or a sequence, mapping or dataclass of these. A path is hashed
    by the content of its file, a member of an enumeration by its value. Any other object is hashed by its
    attribute `content_hash` if it has one, otherwise by the name of its class or function.
    """
    sha = hashlib.sha256()
    _feed(sha, parts)
    return sha.hexdigest()[:32]


def describe_contents(spec: "oiio.ImageSpec") -> str:
    """Describe the size and the channels of an OpenImageIO ImageSpec."""
    size = f"{spec.width} x {spec.height} of {spec.full_width} x {spec.full_height}"
    return f"{size}: {', '.join(sorted(spec.channelnames))}"


def _feed(sha: "hashlib._Hash", part: object) -> None:
    """Hash a part: its kind and its length first, so that no two lists of parts read the same."""
    part = part.value if isinstance(part, enum.Enum) else part
    if isinstance(part, Path):
        text = file_state(part)
    elif isinstance(part, np.ndarray):
        sha.update(f"{part.dtype.str}{part.shape}".encode())
        sha.update(np.ascontiguousarray(part).data)
        return
    elif part is None or isinstance(part, str | numbers.Number | np.generic):
        text = repr(part)
    elif isinstance(part, Mapping):
        return _feed(sha, sorted(part.items()))
    elif isinstance(part, list | tuple):
        sha.update(f"{len(part)} parts".encode())
        for one in part:
            _feed(sha, one)
        return
    elif dataclasses.is_dataclass(part) and not isinstance(part, type):
        fields = [getattr(part, field.name) for field in dataclasses.fields(part)]
        return _feed(sha, [type(part).__qualname__, *fields])
    else:
        own, kind = getattr(part, "content_hash", None), part if hasattr(part, "__name__") else type(part)
        module = getattr(kind, "__module__", "numpy")  # NumPy 2.0's functions have none
        text = own if isinstance(own, str) else f"{module}.{kind.__name__}"
    sha.update(f"{type(part).__name__} {len(text)} {text}".encode())


def hash_file(path: Path) -> str:
    """Return the SHA-256 of a file. Raises OSError if it cannot be read, or is a device or a pipe."""
    state = path.stat()
    if not stat.S_ISREG(state.st_mode):  # it would never end
        raise OSError(f"{path}: is no regular file")
    return _hashed(path, (state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns))


def file_state(path: Path) -> str:
    """Return the SHA-256 of a file, or the name of the error that reading it raises.

    A frame can be made although the file of its neighbour is not there.
    """
    try:
        return hash_file(path)
    except OSError as error:
        return type(error).__name__


@functools.lru_cache(maxsize=64)
def _hashed(path: Path, state: tuple[int, ...]) -> str:
    """Return the SHA-256 of a file. `state` is a part of the cache's key: it changes with the file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


class FileRecord(NamedTuple):
    """What tells a file from another, and from what it becomes later."""

    path: Path
    size: int  # bytes
    modified: int  # nanoseconds since 1970
    sha256: str  # of its bytes

    @classmethod
    def of(cls, path: Path) -> Self:
        """Return the record of a file as it is now. Raises OSError if it cannot be read."""
        state = path.stat()
        return cls(path, state.st_size, state.st_mtime_ns, hash_file(path))

    def differs(self) -> bool:
        """Return whether the file has changed since the record was made.

        Equal size and time count as equal content, as in make and rsync; otherwise the content is compared.
        Raises OSError if the file cannot be read.
        """
        state = self.path.stat()
        if (state.st_size, state.st_mtime_ns) == (self.size, self.modified):
            return False
        return state.st_size != self.size or hash_file(self.path) != self.sha256
