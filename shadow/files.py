"""Atomic writing: a file is complete, or it is not there."""

import os
import secrets
import stat
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing_extensions import TypeIs

AnyPath = str | os.PathLike[str]
PROBE_BYTES = 16384  # written after a file to prove that the disk is not full: more than a library's buffer


def is_path(value: object) -> "TypeIs[AnyPath]":
    """Return whether a value is the path of a file, and no picture or parameters."""
    return isinstance(value, str | os.PathLike)


@contextmanager
def replacing(path: AnyPath) -> Iterator[Path]:
    """Yield a temporary path to write to; the file there replaces `path` when the block ends.

    The temporary path may have another suffix. The file is flushed to the disk first, so a reader finds
    either the old file or the new one, complete. If the block raises, or the process is killed, the old file
    stays as it was and nothing else is left: on most file systems of Linux, the new file has no name until it
    is complete. Elsewhere a killed process leaves a hidden file. A symbolic link stays, and the file that it
    points to is replaced. The new file has the mode of the one that it replaces.

    Raises OSError, which names `path` and not the temporary file, for a pipe, a device or a folder, or if the
    system refuses, for example because the disk is full.
    """
    path = Path(path)
    target = Path(os.path.realpath(path))
    mode = _mode(path, target)
    beside = target.with_name(f".{secrets.token_hex(8)}{path.suffix}")  # short, where a long name is legal
    unnamed = unnamed_file(target.parent)
    written = beside if unnamed is None else Path(f"/proc/self/fd/{unnamed}")
    try:
        yield written
        if unnamed is None:
            with beside.open("rb+") as file:
                _flush(file.fileno())
            if mode is not None:
                beside.chmod(mode)
        else:
            _flush(unnamed)
            if mode is not None:
                os.fchmod(unnamed, mode)
            # Python follows the link only if a directory descriptor is given, though the path is absolute.
            os.link(written, beside, src_dir_fd=unnamed)
        os.replace(beside, target)
    except Exception as error:
        renamed = _about(path, error, (str(written), str(beside)))
        if renamed is None:
            raise
        raise renamed from error
    finally:
        beside.unlink(missing_ok=True)
        if unnamed is not None:
            os.close(unnamed)


def _mode(path: Path, target: Path) -> int | None:
    """Return the mode of the file that is to be replaced; None without one. OSError for another kind."""
    try:
        mode = target.stat().st_mode
    except OSError:
        return None
    if not stat.S_ISREG(mode):
        raise OSError(f"{path}: is no regular file, expected one or none")
    return stat.S_IMODE(mode)


def _flush(descriptor: int) -> None:
    """Flush a file to the disk; raises OSError if the disk is full.

    OpenEXR and libtiff report no error if a full disk loses what they write on closing. In that case another
    write fails too, so this function tries one.
    """
    size = os.lseek(descriptor, 0, os.SEEK_END)
    with open(descriptor, "r+b", closefd=False) as file:
        file.seek(size)
        file.write(bytes(PROBE_BYTES))
        file.flush()
    os.ftruncate(descriptor, size)
    os.fsync(descriptor)


def check_writable(path: AnyPath, suffixes: Collection[str]) -> Path:
    """Return `path` as a Path if a file can be written there.

    Raises ValueError if the name ends in none of `suffixes`, FileNotFoundError if the folder does not exist,
    IsADirectoryError for a folder, PermissionError for a folder that takes no new files.
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise ValueError(f"{path}: expected a file name that ends in {', '.join(suffixes)}")
    folder = Path(os.path.realpath(path)).parent if path.is_symlink() else path.parent
    if not folder.is_dir():
        raise FileNotFoundError(f"{path}: the folder {folder} does not exist")
    if path.is_dir():
        raise IsADirectoryError(f"{path}: is a folder, expected the name of a file")
    if path.exists() and not path.is_file():
        raise OSError(f"{path}: is no regular file, expected the name of one")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(f"{path}: the folder {folder} is not writable")
    return path


def _about(path: Path, error: Exception, temporary: tuple[str, ...]) -> OSError | None:
    """Return the error with `path` in place of the temporary names; None if it contains none of them."""
    words = str(error)
    if isinstance(error, OSError) and error.errno and error.filename in (None, *temporary):
        words = str(error.strerror)
    elif not any(name in words for name in temporary):
        return None
    for name in temporary:
        words = words.replace(name, str(path))
    if str(path) not in words:
        words = f"{path}: cannot be written: {words}"
    number = getattr(error, "errno", None)
    renamed = type(OSError(number, words))(words) if isinstance(number, int) else OSError(words)
    renamed.errno = number  # the class that Python has for it, such as PermissionError
    return renamed


def unnamed_file(folder: Path) -> int | None:
    """Return the descriptor of a new file without a name, or None if the system does not support these."""
    try:
        return os.open(folder, os.O_TMPFILE | os.O_RDWR, 0o666)
    except (AttributeError, OSError):  # not Linux, or a file system without O_TMPFILE, such as NFS
        return None


def file_version(path: AnyPath) -> tuple[int, ...]:
    """Return numbers that change when a file is replaced or written again: keys of caches."""
    file = Path(path).stat()
    return file.st_dev, file.st_ino, file.st_size, file.st_mtime_ns
