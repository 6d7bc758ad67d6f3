"""Files that are whole or not there."""

import os
import secrets
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

AnyPath = str | os.PathLike[str]


@contextmanager
def replacing(path: AnyPath) -> Iterator[Path]:
    """A path to write to, perhaps of another suffix, whose file takes `path`'s place when the block ends.

    It is flushed to the disk first: a reader finds the old file or the new one, whole. If the block raises,
    or the process is killed, the old file is left as it was and nothing beside it: where the system can
    (Linux, on most file systems), what is being written has no name. Elsewhere a kill leaves a hidden file.
    """
    path = Path(path)
    beside = path.with_name(f".{path.stem}-{secrets.token_hex(4)}{path.suffix}")
    unnamed = _unnamed(path.parent)
    try:
        if unnamed is None:
            yield beside
            with beside.open("rb+") as whole:
                os.fsync(whole.fileno())
        else:
            yield Path(f"/proc/self/fd/{unnamed}")
            os.fsync(unnamed)
            # A directory descriptor, though not needed for an absolute path, makes Python follow the link.
            os.link(f"/proc/self/fd/{unnamed}", beside, src_dir_fd=unnamed)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
        if unnamed is not None:
            os.close(unnamed)


def check_writable(path: AnyPath, suffixes: Collection[str]) -> Path:
    """`path` as a Path. ValueError if it ends in none of `suffixes`, FileNotFoundError without its folder."""
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise ValueError(f"{path}: expected a file name that ends in {', '.join(suffixes)}")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path}: the folder {path.parent} does not exist")
    return path


def _unnamed(folder: Path) -> int | None:
    """The descriptor of a new file without a name, or None where there are none."""
    try:
        return os.open(folder, os.O_TMPFILE | os.O_RDWR, 0o666)
    except (AttributeError, OSError):  # not Linux; or a file system without it, such as NFS
        return None
