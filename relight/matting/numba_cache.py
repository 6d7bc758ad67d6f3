"""A folder for what Numba compiles of PyMatting, where the installation and the user's home are read-only.

Numba keeps compiled code beside the source, or below the user's home. In a container that runs as another
user, a farm's image or a Nix store it finds neither, and raises an error. It then compiles into a temporary
folder of this process, which takes some seconds in each.
"""

import atexit
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"


def ensure_numba_cache(usual: Iterable[Path] | None = None) -> None:
    """Give Numba a folder for PyMatting's compiled code, unless it has one. Changes the environment then.

    `usual`: the folders that Numba tries by itself, if they are others than `usual_folders`.
    """
    if os.environ.get(VARIABLE) or any(map(_can_be_written, usual_folders() if usual is None else usual)):
        return
    folder = tempfile.mkdtemp(prefix="relight-numba-")  # nobody else may put code there
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ[VARIABLE] = folder
    if "numba" in sys.modules:  # which has read its environment
        sys.modules["numba"].config.CACHE_DIR = folder


def usual_folders() -> list[Path]:
    """Return the folders that Numba tries: beside the source, and below the home of the user."""
    found = find_spec("pymatting")
    beside = [] if found is None else [Path(each) for each in found.submodule_search_locations or ()]
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return [*beside, Path(home) / "numba"]


def _can_be_written(folder: Path) -> bool:
    """Return whether a file can be made below a folder, as Numba tries it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
