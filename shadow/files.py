"""Files that are whole or not there."""

import os
import secrets
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

AnyPath = str | os.PathLike[str]
SPARE = 16384  # bytes that must fit after a file for it to count as whole: more than a library's buffer


@contextmanager
def replacing(path: AnyPath) -> Iterator[Path]:
    """A path to write to, perhaps of another suffix, whose file takes `path`'s place when the block ends.

    It is flushed to the disk first: a reader finds the old file or the new one, whole. If the block raises,
    or the process is killed, the old file is left as it was and nothing beside it: where the system can
    (Linux, on most file systems), what is being written has no name. Elsewhere a kill leaves a hidden file.
    A symbolic link is written through: the file that it points to is replaced, and the link stays.

    Raises
    ------
    OSError: what the system refuses, such as a full disk, in words that name `path` alone.
    """
    path = Path(path)
    target = Path(os.path.realpath(path))
    beside = target.with_name(f".{target.stem}-{secrets.token_hex(4)}{path.suffix}")
    unnamed = _unnamed(target.parent)
    written = beside if unnamed is None else Path(f"/proc/self/fd/{unnamed}")
    try:
        yield written
        if unnamed is None:
            with beside.open("rb+") as file:
                _flush(file.fileno())
        else:
            _flush(unnamed)
            # A directory descriptor, though not needed for an absolute path, makes Python follow the link.
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


def _flush(descriptor: int) -> None:
    """Bring a file to the disk; OSError where there is no room for more.

    What libraries write as they close a file may be lost on a full disk without a word (OpenEXR, libtiff).
    Then nothing more can be written either.
    """
    size = os.lseek(descriptor, 0, os.SEEK_END)
    with open(descriptor, "r+b", closefd=False) as file:
        file.seek(size)
        file.write(bytes(SPARE))
        file.flush()
    os.ftruncate(descriptor, size)
    os.fsync(descriptor)


def check_writable(path: AnyPath, suffixes: Collection[str]) -> Path:
    """`path` as a Path, if a file can be put there.

    Raises
    ------
    ValueError: the name ends in none of `suffixes`. FileNotFoundError: the folder does not exist.
    IsADirectoryError: `path` is a folder. PermissionError: the folder takes no new files.
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise ValueError(f"{path}: expected a file name that ends in {', '.join(suffixes)}")
    folder = Path(os.path.realpath(path)).parent if path.is_symlink() else path.parent
    if not folder.is_dir():
        raise FileNotFoundError(f"{path}: the folder {folder} does not exist")
    if path.is_dir():
        raise IsADirectoryError(f"{path}: is a folder, expected the name of a file")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(f"{path}: the folder {folder} is not writable")
    return path


def _about(path: Path, error: Exception, temporary: tuple[str, ...]) -> OSError | None:
    """An error in the words of a user, who knows `path` and no temporary name; None if it is so already."""
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


def _unnamed(folder: Path) -> int | None:
    """The descriptor of a new file without a name, or None where there are none."""
    try:
        return os.open(folder, os.O_TMPFILE | os.O_RDWR, 0o666)
    except (AttributeError, OSError):  # not Linux; or a file system without it, such as NFS
        return None
