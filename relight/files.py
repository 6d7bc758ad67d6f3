"""Files that are whole or not there."""

import os
import secrets
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path):
    """A path beside `path` to write to, which takes `path`'s place when the block ends.

    It is flushed to the disk first: a reader finds the old file or the new one, whole. If the block
    raises, the old file is left as it was and nothing beside it.
    """
    path = Path(path)
    beside = path.with_name(f".{path.stem}-{secrets.token_hex(4)}{path.suffix}")
    try:
        yield beside
        with beside.open("rb+") as whole:
            os.fsync(whole.fileno())
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
