"""Compile PyMatting in a process of its own, so that what needs no matting does not wait for it.

Numba keeps each compiled function on the disk at once: what an ended process has done is not done again.
"""

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable

from relight.matting import chroma_key

NICENESS = 5  # others come first
PROGRAM = """
import os, signal, threading, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
parent = os.getppid()
def follow():
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)
threading.Thread(target=follow, daemon=True).start()
import pymatting
"""  # it ends with the process that started it

_process: subprocess.Popen | None = None


def begin() -> None:
    """Start to compile unless that has been done on this machine, or is being done."""
    global _process
    if _process is None and not chroma_key.is_compiled():
        with contextlib.suppress(OSError):  # the task that needs it compiles it itself
            _process = subprocess.Popen([sys.executable, "-c", PROGRAM], stderr=subprocess.DEVNULL)
            if hasattr(os, "setpriority"):
                os.setpriority(os.PRIO_PROCESS, _process.pid, NICENESS)


def is_running() -> bool:
    """Return whether it is still being compiled."""
    return _process is not None and _process.poll() is None


def wait(report: Callable[[str], None]) -> None:
    """Wait until it is compiled, and say so."""
    if _process is not None and is_running():
        report(chroma_key.COMPILING)
        _process.wait()
