"""What ComfyUI offers while it runs: its folders and its progress bar.

ComfyUI's own modules are looked up where it has loaded them and never imported, so that the nodes also work
in a program of your own, and in tests.
"""

import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Literal, TypeVar

Item = TypeVar("Item")


def folder(kind: Literal["input", "output", "temp"]) -> Path:
    """Return ComfyUI's folder of that kind.

    Outside ComfyUI it is the working folder, and the system's own for "temp".
    """
    paths = sys.modules.get("folder_paths")
    if paths is not None:
        return Path(getattr(paths, f"get_{kind}_directory")())
    return Path(tempfile.gettempdir()) if kind == "temp" else Path.cwd()


def progress(items: Iterable[Item], total: int) -> Iterator[Item]:
    """Yield the items and move the node's progress bar, at which ComfyUI's Cancel stops the node."""
    utils = sys.modules.get("comfy.utils")
    bar = None if utils is None else utils.ProgressBar(total)
    for done, item in enumerate(items, 1):
        yield item
        if bar is not None:
            bar.update_absolute(done)
