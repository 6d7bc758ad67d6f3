"""What a picture is made of, as a short text: a resumed run tells by it which frames are still right.

A picture's file carries it as EXIF's ImageUniqueID, a movie as its comment.
"""

import dataclasses
import enum
import functools
import hashlib
import numbers
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

HOLDS = "relight:holds"  # in an OpenEXR file, its size and channels: programs that change them keep NAME
NAME = "Exif:ImageUniqueID"  # EXIF 2.32, section 4.6.6 G: 128 bits as 32 hexadecimal digits


def identity(*parts: Any) -> str:
    """32 hexadecimal digits, which differ where the parts do (SHA-256).

    Parts are None, numbers, texts and arrays; members of enumerations, which count as their value; paths,
    which count by what is in the file; sequences, mappings and dataclasses of these. Whatever else there is
    counts by its `identity`, if it has one, else by the name of its class or function.
    """
    sha = hashlib.sha256()
    _feed(sha, parts)
    return sha.hexdigest()[:32]


def contents(spec: Any) -> str:
    """The size and the channels of a picture, of its OpenImageIO ImageSpec."""
    size = f"{spec.width} x {spec.height} of {spec.full_width} x {spec.full_height}"
    return f"{size}: {', '.join(sorted(spec.channelnames))}"


def _feed(sha: Any, part: Any) -> None:
    """Hash a part: its kind and its length first, so that no two lists of parts read the same."""
    part = part.value if isinstance(part, enum.Enum) else part
    if isinstance(part, Path):
        text = of_file(part)
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
        own, kind = getattr(part, "identity", None), part if hasattr(part, "__name__") else type(part)
        text = own if isinstance(own, str) else f"{kind.__module__}.{kind.__name__}"
    sha.update(f"{type(part).__name__} {len(text)} {text}".encode())


def of_file(path: Path) -> str:
    """The SHA-256 of what is in a file; "" where none can be read."""
    try:
        state = path.stat()
        return _hashed(path, (state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns))
    except OSError:
        return ""


@functools.lru_cache(maxsize=64)
def _hashed(path: Path, state: tuple[int, ...]) -> str:
    """The SHA-256 of a file; `state` is there to tell a file that has changed."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
